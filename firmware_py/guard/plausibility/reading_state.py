"""What the stage of the slow readings remembers, and what it gives to others."""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

from firmware_py.guard.alarms.alarm import AlarmState
from firmware_py.guard.alarms.tally import Tally

NEVER_NS: Final = -(1 << 62)


class OilEvidence(NamedTuple):
    """What counts for a limit of the oil.

    ``value`` is the lowest pressure, or the outlet, that may be believed, None where nothing may.
    ``whole`` False: a source is missing or doubted, so that the limit may be passed where this one
    shows none of it.
    """

    value: float | None
    whole: bool


class ReadingState(msgspec.Struct):
    """One reading: the newest value, the last that was believed, until when it is doubted, and
    since when it froze."""

    value: float = 0.0
    believed: float | None = None
    believed_ns: int = 0
    doubted_ns: int = NEVER_NS
    plausible: bool = True
    same_ns: int = NEVER_NS
    driver_low: float = 0.0
    driver_high: float = 0.0


class ReadingsState(msgspec.Struct):
    """What the stage remembers (for snapshots).

    ``alarms`` goes by the name of the reading, ``causes`` (what a person is told while it stands)
    by the alarm's.
    """

    readings: dict[str, ReadingState]
    alarms: dict[str, AlarmState]
    causes: dict[str, str] = {}
    tick_us: int = -1
    heard_ns: int = NEVER_NS
    fresh: bool = False
    supply_bar: float | None = None
    supply_ns: int = NEVER_NS
    supply_doubted_bar: float | None = None
    compared_ns: int = NEVER_NS
    both_ns: int = NEVER_NS
    apart: Tally = msgspec.field(default_factory=Tally)
    blind: Tally = msgspec.field(default_factory=Tally)
    blind_ns: int = NEVER_NS
