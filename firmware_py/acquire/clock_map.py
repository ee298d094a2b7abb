"""Node ticks on the host's clock: the lower envelope of arrival delays under a bounded drift.

A frame cannot arrive before its samples exist, so ``arrival - tick`` is the clocks' offset plus a delay
that is never negative: the offset is a lower envelope of it.  The envelope falls at once with a quicker
frame and rises at most :data:`DRIFT_MAX_PPM` of the elapsed time, which is the most that two honest
clocks drift apart.  So a link that suddenly delivers late is seen as *late*, never as a slower clock.
All integers: exact on every machine.
"""

from __future__ import annotations

from typing import Final

import msgspec

DRIFT_MAX_PPM: Final = 200
"""Most that node and host clock may drift apart."""

SETTLE_US: Final = 500_000
"""Node time after which the envelope has met enough quick frames to be trusted."""

_US_PER_NS_OF_CREEP: Final = 1000 // DRIFT_MAX_PPM
_TICK_MASK: Final = 0xFFFFFFFF
_TICK_HALF: Final = 0x80000000


class ClockMapState(msgspec.Struct):
    """Offset of the host's clock (ns) at node tick ``tick_us`` (unwrapped), and when it began."""

    known: bool = False
    offset_ns: int = 0
    tick_us: int = 0
    since_us: int = 0


def unwrap(tick32_us: int, near_us: int) -> int:
    """The 64-bit tick nearest to ``near_us`` whose low 32 bits are ``tick32_us``."""
    difference = (tick32_us - near_us) & _TICK_MASK
    return near_us + (difference - (_TICK_MASK + 1) if difference >= _TICK_HALF else difference)


class ClockMap:
    """Bounded-drift map from unwrapped node ticks to host nanoseconds."""

    def __init__(self) -> None:
        self.state = ClockMapState()

    def reset(self) -> None:
        """Forget everything: the node has started again, or its clock has jumped."""
        self.state = ClockMapState()

    def observe(self, tick_us: int, arrival_ns: int) -> None:
        """Take in that data complete at node tick ``tick_us`` arrived at host time ``arrival_ns``."""
        s = self.state
        offset_ns = arrival_ns - tick_us * 1000
        if not s.known:
            self.state = ClockMapState(True, offset_ns, tick_us, tick_us)
            return
        highest_ns = s.offset_ns + (tick_us - s.tick_us) // _US_PER_NS_OF_CREEP
        s.offset_ns = offset_ns if offset_ns < highest_ns else highest_ns
        s.tick_us = tick_us

    def host_ns(self, tick_us: int) -> int:
        """Host time of node tick ``tick_us``."""
        return tick_us * 1000 + self.state.offset_ns

    @property
    def settled(self) -> bool:
        """Whether the map has seen :data:`SETTLE_US` of node time."""
        return self.state.known and self.state.tick_us - self.state.since_us >= SETTLE_US
