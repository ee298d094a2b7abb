"""The agent and what could replace it on the same unseen episodes, beside the best that any control
could do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.control.episodes import Board, FixedSetting, Score, SettingPolicy, play_all
from models.control.references import reference_powers
from models.control.rivals import pressures
from models.runs import progress_bar

Floats = NDArray[np.float64]
Numbers = NDArray[np.intp]

FIXED = (1, 25, 3)
FINER = (3, 4)
"""Fixed clearances that are tried, in thirtieths of the range above its narrow end: from, to, how
far apart at first; then how many times closer beside the best."""

RESAMPLES = 500


@dataclass(frozen=True)
class Bench:
    """Judged episodes with what they are measured against.

    Parameters
    ----------
    counted
        Episodes in which the preview reference breaks no limit: no other says anything about
        control.
    references
        Mean power of each reference in the counted episodes, W; nan where the causal one finds no
        schedule.
    setting, fixed
        The one fixed setting of least power that breaks no limit in any counted episode, and its
        score there.
    least_s, least_depth
        Time and depth of violation of the fixed setting that breaks the limits for the shortest
        time, each episode: what stands for a reference where no schedule keeps them.
    """

    board: Board
    seeds: Sequence[int]
    counted: NDArray[np.bool_]
    references: Mapping[str, Floats]
    setting: FixedSetting
    fixed: Score
    least_s: Floats
    least_depth: Floats

    @classmethod
    def of(cls, board: Board, seeds: Sequence[int], out: Path, workers: int) -> Bench:
        """Compute the references and choose the fixed setting.

        Raises
        ------
        ValueError
            No episode is counted, or no fixed setting keeps the limits in all of them.
        """
        with progress_bar("references", len(seeds)) as bar:
            preview, causal = reference_powers(out, board, seeds, workers, bar)
        counted = np.isfinite(preview)
        if not counted.any():
            raise ValueError(
                f"no schedule keeps the limits in any of {len(seeds)} episodes; judge more episodes"
            )
        tried = _fixed_settings(board, seeds, counted, workers)
        setting, fixed = tried[_best(tried, counted)]
        times = np.stack([score.violation_s for _, score in tried])
        least, every = times.argmin(axis=0), np.arange(len(seeds))
        depth = np.stack([score.depth(board.limits) for _, score in tried])[least, every]
        references = {"preview": preview[counted], "causal": causal[counted]}
        return cls(
            board,
            seeds,
            counted,
            references,
            setting,
            fixed.kept(counted),
            times[least, every],
            depth,
        )

    def play(self, played: Sequence[tuple[SettingPolicy, bool]], workers: int) -> list[Score]:
        """Every policy, behind the shield or not, in all episodes, counted or not."""
        with progress_bar("unseen episodes", len(played)) as bar:
            return play_all(self.board, self.seeds, played, workers, bar)

    def figures(self, score: Score) -> dict[str, Any]:
        """What the report says of a policy; in episodes that are not counted, how far beyond the
        least violation."""
        counted = score.kept(self.counted)
        figures: dict[str, Any] = dict(counted.summary(self.board.seconds))
        rest = ~self.counted
        figures["rejected_violation_s_beyond"] = round(
            float((score.violation_s - self.least_s)[rest].sum()), 2
        )
        figures["rejected_depth_beyond"] = round(
            float((score.depth(self.board.limits) - self.least_depth)[rest].max(initial=0.0)), 4
        )
        for name in self.references:
            figures[f"gap_share_{name}"] = round(self.gap_share(counted.power_W, name), 4)
            shares = [
                self.gap_share(counted.power_W, name, k) for k in _resampled(counted.power_W.size)
            ]
            figures[f"gap_share_{name}_interval"] = _percentiles(shares)
        return figures

    def gap_share(self, power_W: Floats, reference: str, which: Numbers | None = None) -> float:
        """Part of what the reference saves against the fixed setting that the policy saves, over
        its episodes."""
        k = np.arange(power_W.size) if which is None else which
        k = k[np.isfinite(self.references[reference][k])]
        fixed_W, reference_W = self.fixed.power_W[k], self.references[reference][k]
        return float((fixed_W - power_W[k]).sum() / (fixed_W - reference_W).sum())

    def over_seeds(self, scores: Sequence[Score]) -> dict[str, Any]:
        """Interquartile means over agents and episodes, intervals by resampling both."""
        kept = [score.kept(self.counted) for score in scores]
        power = np.stack([score.power_W for score in kept])
        rng = np.random.default_rng(0)
        draws = [(rng.integers(0, len(kept), len(kept)), k) for k in _resampled(power.shape[1])]
        rows: dict[str, Any] = {
            "power_W_each_seed": [round(float(p), 3) for p in power.mean(axis=1)],
            "violation_s_each_seed": [round(float(score.violation_s.sum()), 2) for score in kept],
            "intervention_share_each_seed": [
                round(float(score.intervened.mean()), 3) for score in kept
            ],
            "travel_um_per_s_each_seed": [
                round(1e6 * float(score.travel_m.mean()) / self.board.seconds, 2) for score in kept
            ],
            "power_W_iqm": round(interquartile_mean(power), 3),
            "power_W_iqm_interval": _percentiles(
                [interquartile_mean(power[i][:, k]) for i, k in draws]
            ),
        }
        for name in self.references:
            shares = [
                interquartile_mean(np.array([self.gap_share(p, name, k) for p in power[i]]))
                for i, k in draws
            ]
            rows[f"gap_share_{name}_iqm"] = round(
                interquartile_mean(np.array([self.gap_share(p, name) for p in power])), 4
            )
            rows[f"gap_share_{name}_iqm_interval"] = _percentiles(shares)
        return rows

    def paired(self, a: Score, b: Score) -> dict[str, Any]:
        """Mean power of ``a`` less that of ``b`` over the counted episodes, W, with its 95 %
        interval."""
        difference = (a.power_W - b.power_W)[self.counted]
        means = [float(difference[k].mean()) for k in _resampled(difference.size)]
        return {"mean_W": round(float(difference.mean()), 4), "interval_W": _percentiles(means)}

    def header(self) -> dict[str, Any]:
        """What the figures rest on."""
        film = "fed from the groove" if self.board.pressure else "unfed"
        pressure_Pa = self.setting.pressure_Pa
        return {
            "plant": f"rotor alone on the table film, {film}",
            "episodes": len(self.seeds),
            "seconds": self.board.seconds,
            "rejected_share": round(1.0 - float(self.counted.mean()), 4),
            "best_fixed_um": round(1e6 * self.setting.clearance_m, 2),
            "best_fixed_bar": None if pressure_Pa is None else 1e-5 * pressure_Pa,
            "best_fixed_W": round(float(self.fixed.power_W.mean()), 3),
            "without_causal_share": round(float(np.isnan(self.references["causal"]).mean()), 4),
            "references_W": {
                name: round(float(np.nanmean(power)), 3) for name, power in self.references.items()
            },
        }


def interquartile_mean(values: Floats) -> float:
    """Mean of the middle half."""
    ordered, cut = np.sort(values, axis=None), values.size // 4
    return float(ordered[cut : values.size - cut].mean())


def beats(difference: Mapping[str, Any]) -> bool:
    """Whether the first of a pair needs less power: all of the interval lies below zero."""
    return bool(difference["interval_W"][1] < 0.0)


def _fixed_settings(
    board: Board, seeds: Sequence[int], counted: NDArray[np.bool_], workers: int
) -> list[tuple[FixedSetting, Score]]:
    """Settings of a coarse grid, and clearances ever closer beside the best of them, with their
    scores."""
    (narrow_m, wide_m), (low, high, apart) = board.reach[:, 0].tolist(), FIXED
    step_m = (wide_m - narrow_m) / 30.0
    grid = [
        FixedSetting(narrow_m + k * step_m, pressure)
        for pressure in pressures(board)
        for k in range(low, high + 1, apart)
    ]
    tried, apart_m = _tried(board, seeds, grid, workers), apart * step_m
    for closer in FINER:
        best = tried[_best(tried, counted)][0]
        between = apart_m / closer * np.array([k for k in range(1 - closer, closer) if k])
        near = np.clip(best.clearance_m + between, narrow_m, wide_m).tolist()
        tried += _tried(board, seeds, [FixedSetting(c, best.pressure_Pa) for c in near], workers)
        apart_m /= closer
    return tried


def _tried(
    board: Board, seeds: Sequence[int], settings: list[FixedSetting], workers: int
) -> list[tuple[FixedSetting, Score]]:
    with progress_bar("fixed settings", len(settings)) as bar:
        return list(
            zip(
                settings,
                play_all(board, seeds, [(s, False) for s in settings], workers, bar),
                strict=True,
            )
        )


def _best(tried: Sequence[tuple[FixedSetting, Score]], counted: NDArray[np.bool_]) -> int:
    """Number of the setting of least power that keeps the limits in every counted episode.

    Raises
    ------
    ValueError
        None does.
    """
    kept = [score.kept(counted) for _, score in tried]
    power = [np.inf if score.violation_s.any() else float(score.power_W.mean()) for score in kept]
    if not np.isfinite(power).any():
        raise ValueError(
            f"each of {len(tried)} fixed settings breaks a limit in a counted episode; judge others"
        )
    return int(np.argmin(power))


def _resampled(count: int) -> list[Numbers]:
    rng = np.random.default_rng(count)
    return [rng.integers(0, count, count) for _ in range(RESAMPLES)]


def _percentiles(values: Sequence[float]) -> list[float]:
    return [round(float(v), 4) for v in np.percentile(values, [2.5, 97.5])]
