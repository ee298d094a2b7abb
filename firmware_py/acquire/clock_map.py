"""Node ticks on the host's clock: the lower envelope of arrival delays under a bounded drift.

A frame cannot arrive before its samples exist, so ``arrival - tick`` is the clocks' offset plus a
delay that is never negative: the offset is a lower envelope of it.  The envelope falls at once with
a quicker frame and rises at most :data:`DRIFT_MAX_PPM` of the elapsed time, which is the most that
two honest clocks drift apart.  So a link that suddenly delivers late is seen as *late*, never as a
slower clock.

A settled envelope that falls by more than the clocks can drift says that the node's clock ran on
while the host's stood (a suspended virtual machine): :attr:`ClockMap.ahead_ns` is by how much.  All
integers: exact on every machine.
"""

from __future__ import annotations

from typing import Final

import msgspec

DRIFT_MAX_PPM: Final = 200
"""Most that node and host clock may drift apart."""

SETTLE_US: Final = 500_000
"""Time on both clocks after which the envelope has met enough quick frames to be trusted.

On both: frames that waited come in a burst, whose ticks span far more than the time in which they
arrive.
"""

_US_PER_NS_OF_CREEP: Final = 1000 // DRIFT_MAX_PPM
_TICK_MASK: Final = 0xFFFFFFFF
_TICK_HALF: Final = 0x80000000


class ClockMapState(msgspec.Struct):
    """Offset of the host's clock (ns) at node tick ``tick_us`` (unwrapped), and when it began.

    ``drifted_ns`` follows the offset no faster than two honest clocks drift apart, either way;
    ``since_ns`` and ``arrival_ns`` are the first and the newest arrival.
    """

    known: bool = False
    offset_ns: int = 0
    tick_us: int = 0
    since_us: int = 0
    drifted_ns: int = 0
    since_ns: int = 0
    arrival_ns: int = 0


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
        """Take in that data complete at node tick ``tick_us`` arrived at host time
        ``arrival_ns``."""
        s = self.state
        offset_ns = arrival_ns - tick_us * 1000
        if not s.known:
            self.state = ClockMapState(
                True, offset_ns, tick_us, tick_us, offset_ns, arrival_ns, arrival_ns
            )
            return
        creep_ns = (tick_us - s.tick_us) // _US_PER_NS_OF_CREEP
        highest_ns = s.offset_ns + creep_ns
        s.offset_ns = offset_ns if offset_ns < highest_ns else highest_ns
        s.tick_us, s.arrival_ns = tick_us, arrival_ns
        if self.settled:
            s.drifted_ns = min(max(s.offset_ns, s.drifted_ns - creep_ns), s.drifted_ns + creep_ns)
        else:
            s.drifted_ns = s.offset_ns

    def host_ns(self, tick_us: int) -> int:
        """Host time of node tick ``tick_us``."""
        return tick_us * 1000 + self.state.offset_ns

    @property
    def ahead_ns(self) -> int:
        """How far the node's clock has run ahead of the host's since the map settled, beyond any
        drift."""
        return self.state.drifted_ns - self.state.offset_ns

    @property
    def settled(self) -> bool:
        """Whether the map has seen :data:`SETTLE_US` of both clocks."""
        s = self.state
        return (
            s.known
            and s.tick_us - s.since_us >= SETTLE_US
            and s.arrival_ns - s.since_ns >= SETTLE_US * 1000
        )
