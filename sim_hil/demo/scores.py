"""Scores of a demo: faults named, forecasts kept, films and kills survived; each from the rig's
truth."""

from __future__ import annotations

import bisect
from dataclasses import dataclass

import numpy as np

from firmware_py.records import Diagnosis
from sim_hil.demo.observer import StoryObserver, StoryTruth
from sim_hil.demo.story import FAULT_VERDICTS, Beat

NOT_NAMES = frozenset({"normal", "none", "doubt", "whirl"})
"""Verdicts that name no fault of the machine."""

UNKNOWN = "unknown"
"""Not normal, and no class either: counts as the name only where none was given, and is told beside
one."""

CONFIRMING = 3
"""Equal decisions in a row that count as a name."""


@dataclass(frozen=True)
class FaultScore:
    """One injected fault, and what the device called it."""

    name: str
    expected: str
    severity: float
    injected_s: float
    named: str | None
    probability: float | None
    delay_s: float | None
    also_named: tuple[str, ...]

    @property
    def correct(self) -> bool:
        """Whether the name is right."""
        return self.named == self.expected


def score_faults(observer: StoryObserver) -> list[FaultScore]:
    """Every injected fault with the last name that was confirmed while it stood.

    A name is a verdict repeated :data:`CONFIRMING` times in a row; ``delay_s`` counts to the first
    moment from which it was confirmed.  Other names confirmed meanwhile are listed, ``unknown``
    among them.
    """
    scores = []
    for t_s, beat in observer.beats:
        if beat.verb == "inject":
            end_s = _cleared_s(observer, beat, t_s)
            names = confirmed_names([d for d in observer.diagnoses if t_s <= d[0] < end_s])
            scores.append(_fault_score(beat, t_s, names))
    return scores


def _cleared_s(observer: StoryObserver, beat: Beat, t_s: float) -> float:
    """When the fault of ``beat`` was cleared; infinity when it never was."""
    cleared = (
        t for t, b in observer.beats if b.verb == "clear" and b.fault == beat.fault and t > t_s
    )
    return next(cleared, float("inf"))


def confirmed_names(diagnoses: list[tuple[float, Diagnosis]]) -> list[tuple[float, Diagnosis]]:
    """Moments at which a verdict that names a fault became confirmed."""
    confirmed: list[tuple[float, Diagnosis]] = []
    run, last = 0, ""
    for t_s, diagnosis in diagnoses:
        name = "doubt" if diagnosis.doubt else diagnosis.verdict
        run = run + 1 if name == last else 1
        last = name
        if run == CONFIRMING and name not in NOT_NAMES:
            confirmed.append((t_s, diagnosis))
    return confirmed


def _fault_score(beat: Beat, t_s: float, names: list[tuple[float, Diagnosis]]) -> FaultScore:
    expected = FAULT_VERDICTS[beat.fault]
    if not names:
        return FaultScore(beat.fault, expected, beat.severity, t_s, None, None, None, ())
    classes = [verdict for _, d in names if (verdict := d.verdict) != UNKNOWN]
    final = classes[-1] if classes else UNKNOWN
    since_s, first = next((t, d) for t, d in names if d.verdict == final)
    others = tuple(sorted({d.verdict for _, d in names} - {final}))
    return FaultScore(
        beat.fault, expected, beat.severity, t_s, final, first.probability, since_s - t_s, others
    )


@dataclass(frozen=True)
class ForecastScore:
    """Errors of the forecasts whose condition (operating point held) came true."""

    horizon_s: float
    conditional_on: str
    scored: int
    unannounced_apart: int
    peak_to_peak_error_pct_p95: float | None
    power_error_pct_p95: float | None


def score_forecasts(observer: StoryObserver) -> ForecastScore:
    """Compare each forecast with the truth one horizon later.

    A forecast is set apart when speed, load, clearance or a fault changed inside its horizon: it
    was conditional on none of that.  A clearance that follows the forecast's own candidate is no
    change.
    """
    times = [truth.t_s for truth in observer.truth]
    changes = sorted(t for t, beat in observer.beats if beat.verb in ("inject", "clear"))
    power, swing, apart = [], [], 0
    for t_s, forecast in observer.forecasts:
        start, end = (
            bisect.bisect_left(times, t_s),
            bisect.bisect_left(times, t_s + forecast.horizon_s),
        )
        if end >= len(times) or forecast.quality:
            continue
        held = _held(observer.truth[max(0, start - 1) : end + 1], forecast.clearance_um)
        if not held or any(t_s - 1.0 < change < t_s + forecast.horizon_s for change in changes):
            apart += 1
            continue
        then = observer.truth[end]
        power.append(abs(forecast.power_W[1] - then.power_W) / then.power_W)
        swing.append(abs(forecast.peak_to_peak_um[1] - then.peak_to_peak_um) / then.peak_to_peak_um)
    last = observer.forecast
    return ForecastScore(
        last.horizon_s if last else 0.0,
        last.conditional_on if last else "",
        len(power),
        apart,
        _percent_p95(swing),
        _percent_p95(power),
    )


def _held(span: list[StoryTruth], clearance_um: float) -> bool:
    """Whether speed and load held through ``span`` and the clearance ended where the forecast
    assumed."""
    speeds = [truth.speed_rad_s for truth in span]
    loads = [truth.load_N for truth in span]
    steady = max(speeds) - min(speeds) <= 0.005 * max(speeds) and max(loads) - min(
        loads
    ) <= 0.02 * max(loads)
    return steady and abs(span[-1].clearance_um - clearance_um) <= 1.5


def _percent_p95(errors: list[float]) -> float | None:
    return round(100 * float(np.percentile(errors, 95)), 2) if errors else None


@dataclass(frozen=True)
class FilmScore:
    """Smallest film of the run, and how long it was below the limit."""

    min_um: float
    violation_s: float


def score_film(
    observer: StoryObserver, limit_um: float, from_s: float, from_rad_s: float
) -> FilmScore:
    """Minimum film after ``from_s`` (before it the rig runs up) at speeds that carry a film at
    all."""
    turning = [
        truth for truth in observer.truth if truth.t_s >= from_s and truth.speed_rad_s >= from_rad_s
    ]
    films = [truth.min_film_um for truth in turning]
    return FilmScore(round(min(films), 2), round(0.1 * sum(film < limit_um for film in films), 2))


@dataclass(frozen=True)
class KillScore:
    """A process that was killed: node target at the retreat value, arrival there, and the process
    back."""

    process: str
    killed_s: float
    target_safe_ms: float | None
    arrived_safe_s: float | None
    back_s: float | None


def score_kill(observer: StoryObserver, safe_um: float, back_s: float | None) -> KillScore:
    """Follow the node's target and clearance (its own word, every 50 ms) after the brain was
    killed.

    ``back_s`` is the time until the new brain's first word.
    """
    killed_s = next(t for t, beat in observer.beats if beat.verb == "kill_brain")
    after = [
        (t - killed_s, reading)
        for t, reading in observer.readings
        if t >= killed_s and reading.node
    ]
    target = next(
        (t for t, r in after if r.node and abs(r.node.target_clearance_um - safe_um) < 0.02), None
    )
    arrived = next((t for t, r in after if abs(r.status.clearance_actual_um - safe_um) < 1.0), None)
    return KillScore(
        "brain",
        round(killed_s, 3),
        None if target is None else round(1000 * target, 1),
        None if arrived is None else round(arrived, 2),
        back_s,
    )
