"""Events, alarms and the state of the guard (ISO 13374 SD)."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec
from msgspec import Meta

from firmware_py.records.base import Record


class Severity(enum.IntEnum):
    """How much an event asks of a person."""

    INFO = 0
    ALERT = 1
    DANGER = 2
    FAULT = 3


Level = Annotated[int, Meta(ge=0, le=3)]
"""A :class:`Severity`; another number is refused where the record is decoded."""


class Event(Record, frozen=True, tag=True):
    """Something that changed: it stays with the guard until the gate acknowledges ``seq``.

    ``count`` is how often it happened since it was last told: what flutters is told now and then.
    """

    seq: int
    t_ns: int
    severity: Level
    name: str
    text: str
    value: float = 0.0
    limit: float = 0.0
    count: int = 1


class Alarm(Record, frozen=True, tag=True):
    """An alarm that stands now (published as a full cyclic list); ``text`` says more than the name,
    where it can."""

    name: str
    severity: Level
    since_ns: int
    value: float
    limit: float
    latched: bool
    text: str = ""
    shelved: bool = False
    """A person wants it out of the way for a time; nothing but the display changes."""


class GuardState(Record, frozen=True, tag=True):
    """Everything the guard says about itself ten times a second."""

    seq: int
    t_ns: int
    mode: Annotated[int, Meta(ge=0, le=2)]
    arm_state: Annotated[int, Meta(ge=0, le=5)]
    authority: bool
    authority_reasons: list[str]
    speed_rad_s: float
    load_estimate_N: float
    clearance_low_um: float
    clearance_high_um: float
    target_clearance_um: float
    target_pressure_bar: float
    clearance_actual_um: float
    peak_to_peak_um: tuple[float, float]
    run_permit: bool
    trip_request: bool
    node_following: bool
    alarms: list[Alarm]
    counters: dict[str, int]
    zone: str = ""
    permit_reasons: list[str] = msgspec.field(default_factory=list)
    """Why ``run_permit`` is withheld; empty while it is granted."""
    channel_causes: dict[str, str] = msgspec.field(default_factory=dict)
    """Channels that are not OK, and why: ``open``, ``stuck``, ``saturated``, ``intermittent``,
    ``beyond``."""
    monitor_only: str = ""
    """Why the machine is monitor only: load, clearances and targets above are 0 and say nothing."""
    other_peak_to_peak_um: dict[str, tuple[float, float]] = msgspec.field(default_factory=dict)
    """Vibration of the further bearings, by name."""
    first_out: str = ""
    """The alarm that tripped first of those that are latched; empty while none is."""
