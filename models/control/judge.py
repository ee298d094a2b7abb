"""The agent and what could replace it on the same unseen episodes, beside the best that any control could do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.control.episodes import Fixed, Policy, Score, play
from models.control.references import reference_powers
from models.runs import progress_bar

Floats = NDArray[np.float64]
Numbers = NDArray[np.intp]

FIXED_UM = (44, 108)
"""Between these lies the widest fixed clearance that keeps the limits; power falls with clearance up to there."""

RESAMPLES = 500


@dataclass(frozen=True)
class Bench:
    """Judged episodes with what they are measured against.

    Parameters
    ----------
    counted
        Episodes in which both references break no limit: no other says anything about control.
    references
        Mean power of each reference in the counted episodes, W.
    fixed_um, fixed
        The one fixed clearance of least power that breaks no limit in any counted episode, and its score there.
    """

    seeds: Sequence[int]
    seconds: float
    rig: str
    counted: NDArray[np.bool_]
    references: Mapping[str, Floats]
    fixed_um: float
    fixed: Score

    @classmethod
    def of(cls, seeds: Sequence[int], seconds: float, rig: str, out: Path, workers: int) -> Bench:
        """Compute the references and choose the fixed clearance.

        Raises
        ------
        ValueError
            No episode is counted, or no fixed clearance keeps the limits in all of them.
        """
        with progress_bar("references", len(seeds)) as bar:
            preview, causal = reference_powers(out, rig, seconds, seeds, workers, bar)
        counted = np.isfinite(preview) & np.isfinite(causal)
        if not counted.any():
            raise ValueError(f"no schedule keeps the limits in any of {len(seeds)} episodes; judge more episodes")
        fixed_um, fixed = _best_fixed(seeds, seconds, rig, counted)
        references = {"preview": preview[counted], "causal": causal[counted]}
        return cls(seeds, seconds, rig, counted, references, fixed_um, fixed)

    def play(self, policy: Policy, *, shielded: bool) -> Score:
        """All episodes, counted or not."""
        return play(policy, self.seeds, self.seconds, shielded=shielded, rig=self.rig)

    def figures(self, score: Score) -> dict[str, Any]:
        """What the report says of a policy; violations in episodes that are not counted stand apart."""
        counted = score.kept(self.counted)
        figures: dict[str, Any] = dict(counted.summary(self.seconds))
        figures["violation_s_not_counted"] = round(float(score.violation_s[~self.counted].sum()), 2)
        for name in self.references:
            figures[f"gap_share_{name}"] = round(self.gap_share(counted.power_W, name), 4)
            shares = [self.gap_share(counted.power_W, name, k) for k in _resampled(counted.power_W.size)]
            figures[f"gap_share_{name}_interval"] = _percentiles(shares)
        return figures

    def gap_share(self, power_W: Floats, reference: str, which: Numbers | None = None) -> float:
        """Part of what the reference saves against the fixed clearance that the policy saves, over the episodes."""
        k = np.arange(power_W.size) if which is None else which
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
            "power_W_iqm": round(interquartile_mean(power), 3),
            "power_W_iqm_interval": _percentiles([interquartile_mean(power[i][:, k]) for i, k in draws]),
        }
        for name in self.references:
            shares = [interquartile_mean(np.array([self.gap_share(p, name, k) for p in power[i]])) for i, k in draws]
            rows[f"gap_share_{name}_iqm"] = round(
                interquartile_mean(np.array([self.gap_share(p, name) for p in power])), 4)  # fmt: skip
            rows[f"gap_share_{name}_iqm_interval"] = _percentiles(shares)
        return rows

    def paired(self, a: Score, b: Score) -> dict[str, Any]:
        """Mean power of ``a`` less that of ``b`` over the counted episodes, W, with its 95 % interval."""
        difference = (a.power_W - b.power_W)[self.counted]
        means = [float(difference[k].mean()) for k in _resampled(difference.size)]
        return {"mean_W": round(float(difference.mean()), 4), "interval_W": _percentiles(means)}

    def header(self) -> dict[str, Any]:
        """What the figures rest on."""
        return {
            "plant": "rotor alone on the table film", "episodes": len(self.seeds), "seconds": self.seconds,
            "rejected_share": round(1.0 - float(self.counted.mean()), 4), "best_fixed_um": self.fixed_um,
            "best_fixed_W": round(float(self.fixed.power_W.mean()), 3),
            "references_W": {name: round(float(power.mean()), 3) for name, power in self.references.items()},
        }  # fmt: skip


def interquartile_mean(values: Floats) -> float:
    """Mean of the middle half."""
    ordered, cut = np.sort(values, axis=None), values.size // 4
    return float(ordered[cut : values.size - cut].mean())


def beats(difference: Mapping[str, Any]) -> bool:
    """Whether the first of a pair needs less power: all of the interval lies below zero."""
    return bool(difference["interval_W"][1] < 0.0)


def _best_fixed(seeds: Sequence[int], seconds: float, rig: str, counted: NDArray[np.bool_]) -> tuple[float, Score]:
    """Halve the range until the widest fixed clearance that keeps the limits is known to 1 um."""
    low, high = FIXED_UM
    best = _fixed(low, seeds, seconds, rig).kept(counted)
    if best.violation_s.any():
        raise ValueError(f"fixed clearances: {low} um breaks a limit in a counted episode already")
    with progress_bar("fixed clearances", high - low) as bar:
        while high - low > 1:
            middle = (low + high) // 2
            score = _fixed(middle, seeds, seconds, rig).kept(counted)
            if score.violation_s.any():
                high = middle
            else:
                low, best = middle, score
            bar(FIXED_UM[1] - FIXED_UM[0] - (high - low))
    return float(low), best


def _fixed(clearance_um: float, seeds: Sequence[int], seconds: float, rig: str) -> Score:
    return play(Fixed(clearance_um * 1e-6), seeds, seconds, shielded=False, rig=rig)


def _resampled(count: int) -> list[Numbers]:
    rng = np.random.default_rng(count)
    return [rng.integers(0, count, count) for _ in range(RESAMPLES)]


def _percentiles(values: Sequence[float]) -> list[float]:
    return [round(float(v), 4) for v in np.percentile(values, [2.5, 97.5])]


