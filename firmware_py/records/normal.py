"""What is normal for one machine, and how it is learned (commissioning)."""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.records.base import Record

COMMISSION_ACTIONS: Final = ("start", "stop", "cancel", "forget")


class Baseline(Record, frozen=True):
    """The healthy first order of the orbit, without the probes' runout, as a function of the
    operating point.

    ``x + jy`` forward, phase from the mark: real and imaginary ``weights_um`` of the constant, of
    speed and its square, of clearance and eccentricity, each about ``centre`` in units of
    ``spread``; ``scatter_um`` is what it leaves.
    """

    centre: list[float]
    spread: list[float]
    weights_um: list[tuple[float, float]]
    scatter_um: float


class Belonging(Record, frozen=True):
    """What a normal state was learned with: hashes of classifier, feature names and configuration,
    and the rig."""

    classifier: str
    features: str
    rig: str
    configuration: str


class OwnNormal(Record, frozen=True):
    """The healthy state of a machine that no fleet stands behind
    (:mod:`firmware_py.brain.watch_normal`).

    ``names`` are its figures, ``weights`` ``(terms, figures)`` what speed explains of them (about
    ``centre`` of the logarithm, in units of ``spread``), ``scatter`` what is left; ``columns`` of
    each of ``parts``, whose distances have ``typical`` medians and ``limits``.
    """

    names: list[str]
    parts: list[str]
    columns: list[int]
    centre: float
    spread: float
    weights: list[list[float]]
    scatter: list[float]
    typical: list[float]
    limits: list[float]


class Normal(Record, frozen=True, tag=True):
    """The healthy state of one machine, learned from its own windows
    (:class:`firmware_py.brain.normal.Learner`).

    ``offset`` and ``variance``: where its whitened residuals lie (the classifier's output
    ``normal``), and how far one decision may lie from there; ``scale``: this machine's scatter
    beside the fleet's, for each part; ``quiet``: log-odds that each head must exceed, because it
    said as much of the healthy machine.  ``ranges``: the operating points that it was learned over.
    """

    belongs: Belonging
    minutes: float
    decisions: int
    points: int
    ranges: dict[str, tuple[float, float]]
    offset: list[float]
    variance: list[float]
    scale: list[float]
    quiet: list[float]
    baseline: Baseline
    made_unix_ns: int = 0
    own: OwnNormal | None = None
    """Of a machine that is monitor only; what stands above of fleet and heads is then empty."""


class CommissionState(Record, frozen=True, tag=True):
    """How commissioning stands: ``phase`` is ``none``, ``gathering``, ``commissioned`` or
    ``refused`` (with ``text``).

    While gathering: decisions kept, operating points among them, steps of speed seen of those in
    the declared range, and why windows were left out.
    """

    seq: int
    t_ns: int
    phase: str
    text: str
    decisions: int = 0
    minutes: float = 0.0
    points: int = 0
    speed_steps: int = 0
    speed_steps_declared: int = 0
    ranges: dict[str, tuple[float, float]] = msgspec.field(default_factory=dict)
    left_out: dict[str, int] = msgspec.field(default_factory=dict)
    named_faults: dict[str, int] = msgspec.field(default_factory=dict)
    normal: str = ""
