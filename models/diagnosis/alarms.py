"""What the device would say, decision by decision: false alarms on healthy machines, delays to the
right name.

The words are those of :mod:`firmware_py.brain.verdict`, which the device asks as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.feature_rows import half_order_of
from firmware_py.acquire.windows import HOP_SECONDS
from firmware_py.brain import verdict
from firmware_py.brain.verdict import DOUBT, UNKNOWN, WHIRL, WINDOWS, Found, VerdictLimits, Words
from models.diagnosis import recordings
from models.diagnosis.clearance_loops import LOOPS
from models.diagnosis.dataset import CLASSES, Dataset, join, pooled, spans
from models.diagnosis.recordings import RecordingCase
from models.diagnosis.scores import fault_log_odds

Floats = NDArray[np.float64]
Answers = Callable[[NDArray[np.floating]], tuple[Floats, Floats]]
"""Features ``(n, F)`` to probabilities of the heads ``(n, 4)`` and novelty scores ``(n,)``."""

HOP_NS: Final = round(HOP_SECONDS * 1e9)
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
class FoundRows:
    """What decisions rest on, and of which recordings they are: one row a decision."""

    found: Found
    rows: Dataset

    @property
    def probability(self) -> Floats:
        """Of the six classes, (n, 6)."""
        return verdict.class_probabilities(self.found.log_odds)

    def subset(self, rows: NDArray[np.bool_]) -> FoundRows:
        """The decisions at ``rows``."""
        return FoundRows(self.found.subset(rows), self.rows.subset(rows))

    def words(self, limits: VerdictLimits) -> Words:
        """The device's word on each decision, an index into :data:`verdict.WORDS`."""
        return verdict.verdicts(self.found, limits)


def find(
    answers: Answers, data: Dataset, step: int | None = 1, windows: int = WINDOWS
) -> FoundRows:
    """A decision every ``step`` windows (None: without overlap); whirl and bad channels are asked
    of the last window alone.

    A window with a bad channel has no vote: fewer than ten are left, which is doubt.  The machine
    is one of the fleet: none is commissioned.
    """
    rows, at = (
        pooled(data, windows, step),
        np.array(spans(data, windows, step), np.intp).reshape(-1, 2),
    )
    heads, novelty = answers(rows.features)
    every = np.full(len(rows), True)
    spoilt = np.r_[0, np.cumsum(data.bad)]
    good = at[:, 1] - at[:, 0] - (spoilt[at[:, 1]] - spoilt[at[:, 0]])
    found = Found(
        verdict.log_odds(heads),
        novelty,
        np.full(len(rows), np.nan),
        verdict.is_whirl(*half_order_of(data.features[at[:, 1] - 1])),
        good,
        bad=data.bad[at[:, 1] - 1],
        turning=every,
        answered=every,
    )
    return FoundRows(found, rows)


def false_alarms(found: FoundRows, limits: VerdictLimits) -> dict[str, object]:
    """Words on healthy machines that name a fault: per decision every hop, and confirmed by
    persistence.

    The upper 95 % limits are a bootstrap over builds of the share of decisions (nothing without any
    alarm), the exact binomial ones of the shares of builds and of watched runs that alarm, the
    latter times :data:`POINTS_A_MONTH`, and the exact Poisson one of confirmed alarms in as many
    hours as a month has, all as eventful as the watched ones.
    """
    from scipy.stats import beta, chi2

    said, builds, runs = (
        found.words(limits),
        np.unique(found.rows.group),
        np.unique(found.rows.recording),
    )
    alarm = (said > 0) & (said < UNKNOWN)
    share = np.array([np.mean(alarm[found.rows.group == build]) for build in builds])
    draws = np.random.default_rng(0).integers(0, len(builds), (4000, len(builds)))
    alarmed = int(np.sum(share > 0))
    confirmed = np.array([_confirmed(said[found.rows.recording == run]) for run in runs])
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


def held(found: FoundRows, limits: VerdictLimits) -> dict[str, float]:
    """Long healthy runs: alarms, and how far noise carries a point that is held towards the limit
    of any fault.

    ``nearest_in_scatters``: smallest distance of the mean log-odds of a held point from the nearest
    limit, in standard deviations about that mean; ``largest_scatter`` of those.
    """
    said = found.words(limits)
    beyond = fault_log_odds(found.probability) - np.log(limits.named_above)
    still = (found.rows.duty == recordings.DUTIES.index("hold")) & (
        found.rows.loop == LOOPS.index("fixed")
    )
    runs, points = np.unique(found.rows.recording), np.unique(found.rows.recording[still])
    at = [beyond[found.rows.recording == point] for point in points]
    away = [float(np.min(-x.mean(axis=0) / np.maximum(x.std(axis=0), 1e-6))) for x in at]
    return {
        "runs": len(runs),
        "hours": round(len(said) * HOP_SECONDS / 3600.0, 3),
        "false_alarms": int(np.sum((said > 0) & (said < UNKNOWN))),
        "confirmed_alarms": sum(_confirmed(said[found.rows.recording == run]) for run in runs),
        "held_points": len(points),
        "nearest_in_scatters": round(min(away, default=float("nan")), 1),
        "largest_scatter": round(
            max((float(x.std(axis=0).max()) for x in at), default=float("nan")), 2
        ),
    }


def held_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy run; ``rng`` draws nothing."""
    return [RecordingCase(0, 100.0, {})]


def _confirmed(said: Words) -> int:
    """Stretches of one recording that name one and the same fault for as long as the device
    asks."""
    end_ns = HOP_NS * np.arange(len(said))
    stands = (said > 0) & (said < UNKNOWN) & verdict.confirmed(said, end_ns)
    return len(np.unique(verdict.held_since_ns(said, end_ns)[stands]))


def faulty_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy recording and one of every taught fault, at severities that must be found."""
    cases = [RecordingCase(0, 100.0, {})]
    for kind, name in enumerate(recordings.FAULT_OF_CLASS[1:], 1):
        severity = float(rng.choice((16.0, 40.0) if name == "unbalance" else (25.0, 0.0)))
        cases.append(RecordingCase(kind, severity, {name: severity}))
    return cases


def onsets(answers: Answers, data: Dataset) -> list[FoundRows]:
    """Decisions of each faulty recording after ten healthy windows of its build, the first with one
    faulty window.

    The healthy windows are of another operating point, which is harder than a fault that comes
    while all else stays.
    """
    all_found = []
    for recording in np.unique(data.recording[data.kind > 0]):
        rows = np.flatnonzero(data.recording == recording)
        before = np.flatnonzero((data.group == data.group[rows[0]]) & (data.kind == 0))[-WINDOWS:]
        both = join([data.subset(before), data.subset(rows)])
        labels = {
            f.name: np.full(len(both), getattr(data, f.name)[rows[0]])
            for f in fields(Dataset)[1:]
            if f.name != "bad"
        }
        found = find(answers, replace(both, **labels))
        all_found.append(found.subset(np.arange(len(found.rows)) > 0))
    return all_found


def detection(
    all_found: list[FoundRows], limits: VerdictLimits
) -> dict[str, dict[str, float | None]]:
    """Seconds from a fault's first window to its right name, and to its confirmation; None where it
    never came."""
    delays: dict[str, list[tuple[float, float]]] = {}
    for found in all_found:
        kind, said = int(found.rows.kind[0]), found.words(limits)
        right = said == kind
        held = right & verdict.confirmed(said, HOP_NS * np.arange(len(said)))
        delays.setdefault(CLASSES[kind], []).append((_first_s(right), _first_s(held)))
    return {name: _delays(*np.array(pairs).T) for name, pairs in delays.items()}


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


def traded(
    watched: FoundRows, faulty: list[FoundRows], limits: VerdictLimits
) -> dict[str, dict[str, object]]:
    """What stricter limits cost: false alarms beside detection, at every factor of
    :data:`TRADED`."""
    report: dict[str, dict[str, object]] = {}
    for factor in TRADED:
        at = replace(limits, named_above=factor * limits.named_above)
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
