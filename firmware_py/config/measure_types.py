"""What the table of measures is made of: measures, their set points and effects, and votes."""

from __future__ import annotations

import enum
from math import inf
from typing import Final, NamedTuple

import msgspec

from firmware_py.config.measure_schema import MeasureConfig
from firmware_py.records import Severity


class Effect(enum.IntEnum):
    """What a set point that is passed does; each does what those below it do."""

    EVENT = 0
    ALARM = 1
    AUTHORITY = 2
    RETREAT = 3
    TRIP = 4


class JudgedWhile(enum.Enum):
    """When a set point is held against its value."""

    ALWAYS = "always"
    TURNING = "while the shaft turns"
    ARMED = "while armed"


class SetPoint(msgspec.Struct, frozen=True):
    """Alert or danger of a measure: its alarm, limit, delay, and what it does.

    ``key`` is the place in the configuration that says the limit; ``low`` is the lower end of a
    window, whose upper one is ``limit``.
    """

    alarm: str
    severity: Severity
    limit: float
    delay_ns: int
    latching: bool
    effect: Effect
    key: str
    judged: JudgedWhile = JudgedWhile.ALWAYS
    low: float | None = None


class Measure(msgspec.Struct, frozen=True):
    """One value that protection holds against its set points.

    ``sign`` is +1 where high is bad and -1 where low is; ``reference`` is the value from which
    ``hysteresis`` is counted; ``capped``: its danger is at most ``limits.clearance_share`` of the
    clearance at that instant.  ``kind`` is the word of ``quantity`` of an added row; it is judged
    between ``speeds_rpm`` alone.
    """

    name: str
    source: str
    quantity: str
    unit: str
    points: tuple[SetPoint, ...]
    hysteresis: float
    sign: float = 1.0
    reference: float = 0.0
    capped: bool = False
    kind: str = ""
    speeds_rpm: tuple[float, float] = (0.0, inf)
    band_low_hz: float = 0.0

    def point(self, severity: Severity) -> SetPoint | None:
        """Its alert, or its danger; None where it has none."""
        return next((each for each in self.points if each.severity is severity), None)


class Vote(NamedTuple):
    """So many of so many; ``strict``: one that is not OK stays in the count."""

    needed: int
    of: int
    strict: bool = False


VOTES: Final = {
    "1oo1": Vote(1, 1),
    "1oo2": Vote(1, 2),
    "2oo2": Vote(2, 2),
    "2oo3": Vote(2, 3),
    "2oo2_strict": Vote(2, 2, strict=True),
}


class Group(msgspec.Struct, frozen=True):
    """Measures whose danger votes; ``declared``: by ``[[group]]``, else a measure alone."""

    name: str
    measures: tuple[str, ...]
    vote: str
    all_not_ok: Effect
    declared: bool

    @property
    def trip(self) -> str:
        """Name of the alarm that trips."""
        return f"{self.name}_trip"


class Written(NamedTuple):
    """What a row writes of one set point; None: as it was."""

    limit: float | None
    delay_s: float | None
    effect: str | None
    latching: bool | None
    low: float | None


def written(by: MeasureConfig, severity: Severity) -> Written:
    """What ``by`` writes of alert, or of danger."""
    if severity is Severity.ALERT:
        return Written(by.alert, by.alert_delay_s, by.alert_effect, None, by.alert_low)
    return Written(by.danger, by.danger_delay_s, by.danger_effect, by.latching, by.danger_low)
