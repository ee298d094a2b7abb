"""Shaft speed from the once-per-turn mark, with an honest answer at standstill and when the mark is lost."""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec

STANDSTILL_RAD_S: Final = 1.0
"""Below about 10 rpm the shaft counts as standing."""

_RAMP_MARGIN: Final = 2.0
"""A coasting machine may slow this much faster than its declared ramp."""


class SpeedState(msgspec.Struct):
    """Tick and turn number of the last mark, and the speed over the last turn(s)."""

    mark_us: int = -1
    turn: int = -1
    speed_rad_s: float = 0.0
    lost: bool = True


class SpeedMeter:
    """Speed between marks.

    Without a new mark the speed can be at most ``2 pi / (time since the last one)``.  While that bound is
    compatible with the fastest declared ramp the shaft is slowing, at last standing; when it falls faster
    than any ramp can slow the shaft, the mark is lost, not the speed: the last one is kept and called
    unknown.

    Parameters
    ----------
    ramp_max_rad_s2
        Fastest declared change of speed.
    """

    def __init__(self, ramp_max_rad_s2: float) -> None:
        self._ramp_rad_s2 = _RAMP_MARGIN * ramp_max_rad_s2
        self.state = SpeedState()

    def mark(self, mark_us: int, turn: int) -> bool:
        """Take in the last mark's tick (unwrapped) and 16-bit turn number; True when it is a new one."""
        s = self.state
        if mark_us <= s.mark_us:
            return False
        turns = (turn - s.turn) & 0xFFFF
        if s.turn >= 0 and 0 < turns <= 0x7FFF:
            s.speed_rad_s = 2 * pi * turns / ((mark_us - s.mark_us) * 1e-6)
            s.lost = False
        s.mark_us, s.turn = mark_us, turn
        return True

    def lose(self) -> None:
        """The mark is not valid, or the node's clock has jumped: unknown until two new marks."""
        self.state.lost = True
        self.state.turn = -1

    def idle(self, tick_us: int) -> None:
        """Judge the time since the last mark at node tick ``tick_us``."""
        s = self.state
        waited_s = (tick_us - s.mark_us) * 1e-6
        if s.lost or waited_s * s.speed_rad_s <= 4 * pi:
            return
        bound_rad_s = 2 * pi / waited_s
        if bound_rad_s < s.speed_rad_s - self._ramp_rad_s2 * waited_s:
            self.lose()
        elif bound_rad_s < STANDSTILL_RAD_S:
            s.speed_rad_s = 0.0
