"""What the brain concludes and proposes (ISO 13374 HA, PA, AG)."""

from __future__ import annotations

from firmware_py.records.base import Record


class Diagnosis(Record, frozen=True, tag=True):
    """The classifier's word on one decision (ISO 13374 HA)."""

    seq: int
    t_acq_ns: int
    quality: int
    verdict: str
    probability: float
    heads: dict[str, float]
    classes: dict[str, float]
    doubt: bool
    unknown: bool
    evidence: dict[str, float]
    model: str


class ShadowDiagnosis(Record, frozen=True, tag=True):
    """What a model in shadow would have said; nothing follows from it.

    ``score`` is the distance from all that it was taught, 1 at the limit; ``windows`` those
    that the word rests on; ``active`` is the word of the active classifier at that time.
    """

    seq: int
    t_acq_ns: int
    quality: int
    verdict: str
    probability: float
    classes: dict[str, float]
    score: float
    windows: int
    active: str
    model: str


class Forecast(Record, frozen=True, tag=True):
    """What the predictor expects ``horizon_s`` ahead for the present and the advised clearance
    (PA).

    Each quantity is ``(low, expected, high)``; ``conditional_on`` says which future was assumed.
    ``now_*`` are virtual sensors: what the film model says of this moment (the bearing force is
    ``load_N``). ``time_to_limit_s`` is until film or peak-to-peak of a growing fault passes its
    limit at the present clearance (60: not within a minute).
    """

    seq: int
    t_acq_ns: int
    quality: int
    horizon_s: float
    conditional_on: str
    clearance_um: float
    peak_to_peak_um: tuple[float, float, float]
    power_W: tuple[float, float, float]
    min_film_um: tuple[float, float, float]
    whirl_margin: tuple[float, float, float]
    load_N: tuple[float, float, float]
    viscosity_Pa_s: tuple[float, float, float]
    unbalance_kg_m: tuple[float, float, float]
    model: str
    now_min_film_um: tuple[float, float, float] | None = None
    now_friction_W: tuple[float, float, float] | None = None
    time_to_limit_s: tuple[float, float, float] | None = None


class Advice(Record, frozen=True, tag=True, omit_defaults=True):
    """A proposal to the guard, sent at a fixed rate even when there is nothing to propose (AG).

    ``clearance_um`` is None when the brain has no proposal; ``reasons`` then says why.  Expires
    ``lifetime_ns`` after ``t_ns``.  ``t_acq_ns`` is the time of the newest sample it rests on.
    """

    seq: int
    t_ns: int
    t_acq_ns: int
    lifetime_ns: int
    clearance_um: float | None
    pressure_bar: float | None
    qualified: bool
    reasons: list[str]
    forecast: Forecast | None
    models: str = ""
    """Sets that it rests on, on top of the device's own models."""
    beside: str = ""
    """Sets that run beside."""
    rolled_back: str = ""
    """Why a set was taken out of use; empty once a person has acted."""


class BrainState(Record, frozen=True, tag=True):
    """What the brain counts: windows cut and dropped, answers refused, proposals overruled (once a
    second)."""

    seq: int
    t_ns: int
    counters: dict[str, int]
