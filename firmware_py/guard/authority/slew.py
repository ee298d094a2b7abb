"""The way of the target: never faster than the actuator, no dither, and not too many reversals.

What people or the policy wish is followed within these bounds.  What the guard itself asks for is
not bounded: the retreat value, and a narrower admissible interval, are taken at once.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.envelope.target import Target
from firmware_py.guard.supervision.standing import Supervised
from firmware_py.machine.supply import target_slew_bar_s
from firmware_py.records import Alarm

DEAD_BAND_UM: Final = 0.5
DEAD_BAND_BAR: Final = 0.02
"""The target turns back only by more than this: the actuator's backlash, and noise of what the
request rests on."""

EASE_NS: Final = 1_000_000_000
"""What the admissible range has pushed back goes the other way again after so long without a push:
an end of the range that follows a noisy vibration would else move the actuator at every look."""

MINUTE_NS: Final = 60_000_000_000
BUCKETS: Final = 60
"""Reversals are counted by the second."""

CALM_SHARE: Final = 0.5
"""The alarm ends when the last minute holds at most this share of the limit."""

Range = tuple[float, float]


class AxisState(msgspec.Struct):
    """Where one target stands, which way it went last (0: nowhere yet), and when the range last
    pushed it."""

    value: float
    direction: int = 0
    pushed_ns: int = -EASE_NS


class SlewState(msgspec.Struct):
    """Both targets, and the reversals of the last minute as ``[second, count]``."""

    clearance: AxisState
    pressure: AxisState
    alarm: Supervised
    last_ns: int = -1
    reversals: list[list[int]] = []
    total: int = 0


class Slew:
    """Bounds the movement of the target.

    Parameters
    ----------
    config
        Rates of actuator and pressure, reversals a minute.
    safe
        The retreat value, from which the target starts.
    """

    def __init__(self, config: Config, safe: Target) -> None:
        a = config.machine.actuator
        self._safe = safe
        self._rates = (
            a.rate_um_s,
            target_slew_bar_s(config.machine),
        )
        self._most = a.reversals_per_minute_max
        self.state = SlewState(
            AxisState(safe.clearance_um),
            AxisState(safe.pressure_bar),
            Supervised("target_reverses"),
        )

    @property
    def stands(self) -> bool:
        """Whether the target has turned back too often."""
        return self.state.alarm.standing

    @property
    def doubts(self) -> dict[str, str]:
        """The alarm's name and text, when it stands."""
        return {self.state.alarm.name: self.state.alarm.text} if self.stands else {}

    def standing(self) -> list[Alarm]:
        """The alarm, when it stands."""
        return [self.state.alarm.record()] if self.stands else []

    def start(self) -> None:
        """The device has just been armed: the actuator stands at its boot value."""
        s = self.state
        s.clearance, s.pressure = (
            AxisState(self._safe.clearance_um),
            AxisState(self._safe.pressure_bar),
        )

    def retreat(self, now_ns: int) -> Target:
        """The retreat value, at once."""
        s = self.state
        self._count(
            _jump(s.clearance, self._safe.clearance_um, DEAD_BAND_UM)
            + _jump(s.pressure, self._safe.pressure_bar, DEAD_BAND_BAR),
            now_ns,
        )
        s.last_ns = now_ns
        return self._safe

    def follow(self, requested: Target, clearances: Range, pressures: Range, now_ns: int) -> Target:
        """One step towards ``wish``, inside the admissible ranges.

        While the alarm stands the target holds, but for what the ranges ask.
        """
        s = self.state
        elapsed_s = 0.0 if s.last_ns < 0 else (now_ns - s.last_ns) * 1e-9
        s.last_ns = now_ns
        turned = 0
        for axis, wanted, (low, high), rate, band in (
            (s.clearance, requested.clearance_um, clearances, self._rates[0], DEAD_BAND_UM),
            (s.pressure, requested.pressure_bar, pressures, self._rates[1], DEAD_BAND_BAR),
        ):
            inside = _clamp(axis.value, low, high)
            if inside != axis.value:
                axis.pushed_ns = now_ns
            turned += _jump(axis, inside, band)
            back = (_clamp(wanted, low, high) - axis.value) * axis.direction < 0.0
            if not self.stands and not (back and now_ns - axis.pushed_ns < EASE_NS):
                turned += _step(axis, _clamp(wanted, low, high), rate * elapsed_s, band)
        self._count(turned, now_ns)
        return Target(s.clearance.value, s.pressure.value)

    def watch(self, now_ns: int) -> list[Notice]:
        """Judge the reversals of the last minute."""
        s = self.state
        while s.reversals and now_ns - s.reversals[0][0] * (MINUTE_NS // BUCKETS) > MINUTE_NS:
            s.total -= s.reversals.pop(0)[1]
        if not s.alarm.standing and s.total > self._most:
            return [
                s.alarm.begin(
                    now_ns,
                    (
                        f"the target has turned back {s.total} times within a minute (limit "
                        f"actuator.reversals_per_minute_max = {self._most}): authority is lost and "
                        f"a set point holds; look at "
                        "who sets it"
                    ),
                    float(s.total),
                    float(self._most),
                )
            ]
        if s.alarm.standing and s.total <= CALM_SHARE * self._most:
            return [s.alarm.end(now_ns)]
        return []

    def _count(self, turned: int, now_ns: int) -> None:
        if not turned:
            return
        s, second = self.state, now_ns // (MINUTE_NS // BUCKETS)
        if not s.reversals or s.reversals[-1][0] != second:
            s.reversals.append([second, 0])
        s.reversals[-1][1] += turned
        s.total += turned


def _jump(axis: AxisState, to: float, band: float) -> int:
    """Go there at once; 1 when that was a reversal of more than the dead band."""
    away = to - axis.value
    turned = away * axis.direction < 0 and not -band <= away <= band
    if away:
        axis.direction = 1 if away > 0 else -1
    axis.value = to
    return int(turned)


def _step(axis: AxisState, to: float, most: float, band: float) -> int:
    """Go there by at most ``most``, unless it lies back by less than the dead band; 1 when that was
    a reversal."""
    away = to - axis.value
    if away * axis.direction < 0 and -band <= away <= band:
        return 0
    turned = away * axis.direction < 0
    if away:
        axis.direction = 1 if away > 0 else -1
    axis.value += _clamp(away, -most, most)
    return int(turned)


def _clamp(value: float, low: float, high: float) -> float:
    """``min(max(value, low), high)``, eight times a cycle: without the calls."""
    value = low if low > value else value
    return high if high < value else value
