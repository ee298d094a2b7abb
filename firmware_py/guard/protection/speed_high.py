"""Speed-high trip: the shaft turns faster than it may, by every speed that the marks tell.

One mark, one processor and no self-test: this is a trip of the monitoring system, and takes the
place of no hard-wired one.  Doubt is asymmetric: a speed that no shaft can reach counts here as
well, because a broken coupling or a load rejection looks like this.

A false edge must not trip a healthy machine.  One edge too many in a turn makes two readings too
high, a burst of edges several, but all within one turn.  So the alarm begins when :data:`READINGS`
readings in a row are above the limit and together last as long as :data:`TURNS` turns at the limit.
A plausible reading below it ends the run; an implausible one (a missing edge) only takes off as
long as it lasted, and so does the time in which the mark is lost (after a second edge close behind
the first, no shaft could slow as the wait for the next one says).

Latency from passing the limit to the trip in the heartbeat of the same guard cycle: at most ``TURNS
+ 2`` turns at the limit (27 ms at 13200 rpm), one sample frame and one guard cycle.
"""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec

from firmware_py.acquire.speed import Turn
from firmware_py.config import Config
from firmware_py.config.measures import SPEED_HIGH, speed_high
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.records import Alarm, Severity

READINGS: Final = 3
"""Readings in a row above the limit: one false edge makes two."""

TURNS: Final = 4
"""They last as long as this many turns at the limit: a burst of edges is shorter."""


class SpeedHighState(msgspec.Struct):
    """The latch, whether the limit is exceeded now, the run of readings above it, and when it was
    last looked at."""

    standing: bool = False
    since_ns: int = 0
    speed_rpm: float = 0.0
    exceeded: bool = False
    readings: int = 0
    lasted_us: int = 0
    step_ns: int = 0


class SpeedHigh:
    """The latching danger alarm ``speed_high``.

    Parameters
    ----------
    config
        ``limits.speed_high_rpm`` and the declared range of speed.
    latched
        Whether it stood latched when the guard last ended.
    """

    def __init__(self, config: Config, latched: bool) -> None:
        self._limit_rpm = speed_high(config).points[0].limit
        self._lasting_us = TURNS * 60e6 / self._limit_rpm
        self.state = SpeedHighState(standing=latched)

    def step(self, turns: list[Turn], now_ns: int, lost: bool = False) -> list[Notice]:
        """Judge what new marks say; ``lost``: the mark has been lost since the last step, or since
        before it."""
        s = self.state
        passed_us, s.step_ns = (now_ns - s.step_ns) // 1000, now_ns
        if lost and s.lasted_us:
            s.lasted_us = max(0, s.lasted_us - passed_us)
            s.readings = s.readings if s.lasted_us else 0
        return [
            Notice(
                Severity.DANGER,
                SPEED_HIGH,
                (
                    f"shaft speed {self.state.speed_rpm:.0f} rpm above {self._limit_rpm:.0f} "
                    f"(limits.speed_high_rpm) for "
                    f"{self.state.lasted_us * 1e-3:.0f} ms; find the cause, then `reset`"
                ),
                self.state.speed_rpm,
                self._limit_rpm,
            )
            for turn in turns
            if turn.interval_us and self._begins(turn, now_ns)
        ]

    def _begins(self, turn: Turn, now_ns: int) -> bool:
        """Whether the alarm begins to stand with this reading."""
        s = self.state
        s.speed_rpm = turn.speed_rad_s * 30 / pi
        if s.speed_rpm > self._limit_rpm:
            s.readings += 1
            s.lasted_us += turn.interval_us
        else:
            s.lasted_us = max(0, s.lasted_us - turn.interval_us) if turn.doubt else 0
            s.readings = s.readings if s.lasted_us else 0
            s.exceeded = s.exceeded and bool(turn.doubt)
        if s.readings < READINGS or s.lasted_us < self._lasting_us:
            return False
        s.exceeded = True
        if s.standing:
            return False
        s.standing, s.since_ns = True, now_ns
        return True

    @property
    def tripped(self) -> list[str]:
        """The alarm's name while it stands latched."""
        return [SPEED_HIGH] if self.state.standing else []

    def standing(self) -> list[Alarm]:
        """The alarm while it stands."""
        s = self.state
        if not s.standing:
            return []
        text = (
            f"the shaft was faster than {self._limit_rpm:.0f} rpm (limits.speed_high_rpm), now "
            f"{s.speed_rpm:.0f}; "
            "find the cause, then `reset`"
        )
        return [
            Alarm(
                SPEED_HIGH,
                int(Severity.DANGER),
                s.since_ns,
                s.speed_rpm,
                self._limit_rpm,
                latched=True,
                text=text,
            )
        ]

    def reset(self, speed_lost: bool) -> list[str]:
        """Clear the latch, or the reason why it stays.  A speed that nobody knows exceeds
        nothing."""
        s = self.state
        s.exceeded = s.exceeded and not speed_lost
        s.standing = s.standing and s.exceeded
        return (
            []
            if not s.standing
            else [
                f"{SPEED_HIGH} still exceeded: {s.speed_rpm:.0f} rpm above "
                f"{self._limit_rpm:.0f}; stop the machine"
            ]
        )
