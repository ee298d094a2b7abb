"""What the device would say, decision by decision: false alarms on healthy machines, delays to the
right name.

The words and their order are those of :class:`firmware_py.brain.diagnosis.Diagnoser`: whirl,
unknown, doubt, a class.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import HOP_SECONDS
from firmware_py.brain.diagnosis import CONFIRM_NS, DOUBT_BELOW, WHIRL_CLEARANCE_SHARE, WHIRL_SHARE
from models.diagnosis import recordings
from models.diagnosis.clearance_loops import LOOPS
from models.diagnosis.dataset import CLASSES, WINDOWS_PER_DECISION, Dataset, join, pooled, spans
from models.diagnosis.recordings import RecordingCase
from models.diagnosis.scores import class_probabilities, fault_log_odds, log_odds

Floats = NDArray[np.float64]
Verdicts = Callable[[NDArray[np.floating]], tuple[Floats, Floats]]
"""Features ``(n, F)`` to probabilities of the heads ``(n, 4)`` and novelty scores ``(n,)``."""

UNKNOWN: Final = len(CLASSES)
DOUBT: Final = UNKNOWN + 1
WHIRL: Final = UNKNOWN + 2
"""Words beside the classes."""

CONFIRM_HOPS: Final = round(CONFIRM_NS * 1e-9 / HOP_SECONDS)
MONTH_HOURS: Final = 720.0
POINTS_A_MONTH: Final = 720
"""A machine-month is counted in operating points, another one every hour around the clock.

What alarms is a machine at a point, entered by a run-up, a ramp, a load step or moves of the
clearance, as every watched run enters one; noise about a point that is held does next to nothing
(:func:`held`).
"""
HELD_SECONDS: Final = 100.0
TRADED: Final = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3)
"""Factors on the limits, by which false alarms are traded for delay."""


@dataclass(frozen=True)
class Rule:
    """When a word is said.

    ``novelty``: above it the word is unknown; ``named_above`` ``(5,)``: odds of each fault against
    normal from which it is named.
    """

    novelty: float
    named_above: Floats


@dataclass(frozen=True)
class Heard:
    """Decisions before they become words: class probabilities ``(n, 6)``, novelty, whirl, and whose
    they are."""

    probability: Floats
    novelty: Floats
    whirl: NDArray[np.bool_]
    rows: Dataset

    def subset(self, rows: NDArray[np.bool_]) -> Heard:
        """The decisions at ``rows``."""
        return Heard(
            self.probability[rows], self.novelty[rows], self.whirl[rows], self.rows.subset(rows)
        )

    def words(self, rule: Rule) -> NDArray[np.intp]:
        """The device's word on each decision: a class, :data:`UNKNOWN`, :data:`DOUBT` or
        :data:`WHIRL`."""
        named, best = self.probability.argmax(axis=1), self.probability.max(axis=1)
        doubt = (best < DOUBT_BELOW) | (
            best < np.r_[0.0, rule.named_above][named] * self.probability[:, 0]
        )
        word = np.where(self.novelty > rule.novelty, UNKNOWN, np.where(doubt, DOUBT, named))
        return np.asarray(np.where(self.whirl, WHIRL, word), dtype=np.intp)


def hear(
    verdicts: Verdicts, data: Dataset, step: int | None = 1, windows: int = WINDOWS_PER_DECISION
) -> Heard:
    """A decision every ``step`` windows (None: without overlap); whirl is asked of the last window
    alone."""
    rows = pooled(data, windows, step)
    last = np.array([end - 1 for _, end in spans(data, windows, step)], dtype=np.intp)
    heads, novelty = verdicts(rows.features)
    return Heard(class_probabilities(log_odds(heads)), novelty, whirls(data.features[last]), rows)


def whirls(features: NDArray[np.floating]) -> NDArray[np.bool_]:
    """:func:`firmware_py.brain.diagnosis.is_whirl` from features ``(n, F)``."""
    half, backward, rms, clearance = (
        features[:, FEATURE_NAMES.index(name)].astype(np.float64)
        for name in (
            "shaft_half_fwd_rms",
            "shaft_half_bwd_rms",
            "log_shaft_rms_m",
            "clearance_100um",
        )
    )
    share = 10.0 ** (2.0 * half) + 10.0 ** (2.0 * backward)
    return np.asarray(
        (share > WHIRL_SHARE) & (10.0 ** (half + rms) > WHIRL_CLEARANCE_SHARE * 1e-4 * clearance)
    )


def false_alarms(heard: Heard, rule: Rule) -> dict[str, object]:
    """Words on healthy machines that name a fault: per decision every hop, and confirmed by
    persistence.

    The upper 95 % limits are a bootstrap over builds of the share of decisions (nothing without any
    alarm), the exact binomial ones of the shares of builds and of watched runs that alarm, the
    latter times :data:`POINTS_A_MONTH`, and the exact Poisson one of confirmed alarms in as many
    hours as a month has, all as eventful as the watched ones.
    """
    from scipy.stats import beta, chi2

    said, builds, runs = (
        heard.words(rule),
        np.unique(heard.rows.group),
        np.unique(heard.rows.recording),
    )
    alarm = (said > 0) & (said < UNKNOWN)
    share = np.array([np.mean(alarm[heard.rows.group == build]) for build in builds])
    draws = np.random.default_rng(0).integers(0, len(builds), (4000, len(builds)))
    alarmed = int(np.sum(share > 0))
    confirmed = np.array([_confirmed(said[heard.rows.recording == run]) for run in runs])
    alarming, hours = int(np.sum(confirmed > 0)), len(said) * HOP_SECONDS / 3600.0
    return {
        "healthy_builds": len(builds),
        "decisions": len(said),
        "watched_hours": round(hours, 3),
        "false_alarms": int(alarm.sum()),
        "share_of_decisions": float(f"{share.mean():.3g}"),
        "share_upper_95_bootstrap": float(f"{np.quantile(share[draws].mean(axis=1), 0.95):.3g}"),
        "builds_with_a_false_alarm": alarmed,
        "builds_upper_95": round(float(beta.ppf(0.95, alarmed + 1, len(builds) - alarmed)), 5),
        "confirmed_alarms": int(confirmed.sum()),
        "runs": len(runs),
        "runs_with_a_confirmed_alarm": alarming,
        "confirmed_per_machine_month": round(alarming / len(runs) * POINTS_A_MONTH, 3),
        "confirmed_per_machine_month_upper_95": round(
            float(beta.ppf(0.95, alarming + 1, len(runs) - alarming)) * POINTS_A_MONTH, 3
        ),
        "confirmed_per_month_of_such_hours_upper_95": round(
            0.5 * float(chi2.ppf(0.95, 2 * int(confirmed.sum()) + 2)) / hours * MONTH_HOURS, 1
        ),
        **{
            f"called_{name}": round(float(np.mean(said == word)), 5)
            for name, word in (("unknown", UNKNOWN), ("doubt", DOUBT), ("whirl", WHIRL))
        },
    }


def held(heard: Heard, rule: Rule) -> dict[str, float]:
    """Long healthy runs: alarms, and how far noise carries a point that is held towards the limit
    of any fault.

    ``nearest_in_scatters``: smallest distance of the mean log-odds of a held point from the nearest
    limit, in standard deviations about that mean; ``largest_scatter`` of those.
    """
    said = heard.words(rule)
    beyond = fault_log_odds(heard.probability) - np.log(rule.named_above)
    still = (heard.rows.duty == recordings.DUTIES.index("hold")) & (
        heard.rows.loop == LOOPS.index("fixed")
    )
    runs, points = np.unique(heard.rows.recording), np.unique(heard.rows.recording[still])
    at = [beyond[heard.rows.recording == point] for point in points]
    away = [float(np.min(-x.mean(axis=0) / np.maximum(x.std(axis=0), 1e-6))) for x in at]
    return {
        "runs": len(runs),
        "hours": round(len(said) * HOP_SECONDS / 3600.0, 3),
        "false_alarms": int(np.sum((said > 0) & (said < UNKNOWN))),
        "confirmed_alarms": sum(_confirmed(said[heard.rows.recording == run]) for run in runs),
        "held_points": len(points),
        "nearest_in_scatters": round(min(away, default=float("nan")), 1),
        "largest_scatter": round(
            max((float(x.std(axis=0).max()) for x in at), default=float("nan")), 2
        ),
    }


def held_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy run; ``rng`` draws nothing."""
    return [RecordingCase(0, 100.0, {})]


def _confirmed(said: NDArray[np.intp]) -> int:
    """Stretches of one recording that name one and the same fault for as long as the device
    asks."""
    stretches = ((word, len(list(run))) for word, run in groupby(said.tolist()))
    return sum(0 < word < UNKNOWN and length > CONFIRM_HOPS for word, length in stretches)


def faulty_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy recording and one of every taught fault, at severities that must be found."""
    cases = [RecordingCase(0, 100.0, {})]
    for kind, name in enumerate(recordings.FAULT_OF_CLASS[1:], 1):
        severity = float(rng.choice((16.0, 40.0) if name == "unbalance" else (25.0, 0.0)))
        cases.append(RecordingCase(kind, severity, {name: severity}))
    return cases


def onsets(verdicts: Verdicts, data: Dataset) -> list[Heard]:
    """Decisions of each faulty recording after ten healthy windows of its build, the first with one
    faulty window.

    The healthy windows are of another operating point, which is harder than a fault that comes
    while all else stays.
    """
    found = []
    for recording in np.unique(data.recording[data.kind > 0]):
        rows = np.flatnonzero(data.recording == recording)
        before = np.flatnonzero((data.group == data.group[rows[0]]) & (data.kind == 0))[
            -WINDOWS_PER_DECISION:
        ]
        both = join([data.subset(before), data.subset(rows)])
        labels = {
            f.name: np.full(len(both), getattr(data, f.name)[rows[0]]) for f in fields(Dataset)[1:]
        }
        heard = hear(verdicts, replace(both, **labels))
        found.append(heard.subset(np.arange(len(heard.rows)) > 0))
    return found


def detection(heard: list[Heard], rule: Rule) -> dict[str, dict[str, float | None]]:
    """Seconds from a fault's first window to its right name, and to its confirmation; None where it
    never came."""
    delays: dict[str, list[tuple[float, float]]] = {}
    for one in heard:
        kind = int(one.rows.kind[0])
        right = one.words(rule) == kind
        held = np.convolve(right, np.ones(CONFIRM_HOPS + 1))[: len(right)] > CONFIRM_HOPS
        delays.setdefault(CLASSES[kind], []).append((_first_s(right), _first_s(held)))
    return {name: _delays(*np.array(found).T) for name, found in delays.items()}


def _delays(named: Floats, confirmed: Floats) -> dict[str, float | None]:
    """Medians, what nine of ten keep, and shares that never came."""

    def of(delays: Floats, share: float) -> float | None:
        value = float(np.quantile(delays, share, method="higher"))
        return value if np.isfinite(value) else None

    return {
        "recordings": len(named),
        "named_median_s": of(named, 0.5),
        "never_named": round(float(np.mean(np.isinf(named))), 4),
        "confirmed_median_s": of(confirmed, 0.5),
        "confirmed_p90_s": of(confirmed, 0.9),
        "never_confirmed": round(float(np.mean(np.isinf(confirmed))), 4),
    }


def _first_s(true: NDArray[np.bool_]) -> float:
    return (int(np.argmax(true)) + 1) * HOP_SECONDS if true.any() else float("inf")


def traded(watched: Heard, faulty: list[Heard], rule: Rule) -> dict[str, dict[str, object]]:
    """What stricter limits cost: false alarms beside detection, at every factor of
    :data:`TRADED`."""
    report: dict[str, dict[str, object]] = {}
    for factor in TRADED:
        at = replace(rule, named_above=factor * rule.named_above)
        false = false_alarms(watched, at)
        found = detection(faulty, at)
        report[f"limits times {factor:g}"] = {
            name: false[name]
            for name in ("share_of_decisions", "builds_with_a_false_alarm", "confirmed_alarms")
        } | {
            what: {fault: row[what] for fault, row in found.items()}
            for what in ("confirmed_median_s", "never_confirmed")
        }
    return report
