"""Calendar stamps of received frames on the monotonic clock, as far as they can be believed.

Kernel, hub and python-can stamp frames with calendar time, which may be set at any moment.  A stamp
is used only for the age of a frame, and only where two monotonic facts do not contradict it:

- A frame cannot have arrived before the queue was last seen empty.
- The calendar went forward by as much as the monotonic clock since the last reading.

Every other frame, and every frame without a stamp, arrived at the moment of reading.
"""

from __future__ import annotations

from typing import Final

STEP_NS: Final = 1_000_000
"""The calendar was set when it differs by more than this from the monotonic clock between two
readings.

A calendar that is slewed at its fastest (10 %) stays below it at 1000 readings a second.
"""

RESOLUTION_NS: Final = 1_000
"""Of a calendar stamp: a float of seconds since 1970 has 53 bits."""

STAMP_MAX_S: Final = 4e9
"""Later calendar stamps (after the year 2096) are no calendar stamps."""


class ArrivalStamps:
    """Arrival times of the frames of one queue.

    Attributes
    ----------
    refused
        Stamps that were not believed.  A missing stamp is not counted.
    """

    def __init__(self) -> None:
        self.refused = 0
        self.forget()

    def forget(self) -> None:
        """Another queue: nothing is known about what waits in it."""
        self._now_ns = self._offset_ns = self._empty_ns = 0
        self._believed = False

    def read(self, now_ns: int, calendar_ns: int) -> None:
        """A reading begins at ``now_ns``, when the calendar said ``calendar_ns``."""
        offset_ns = now_ns - calendar_ns
        if abs(offset_ns - self._offset_ns) > STEP_NS:
            self._believed = False
        self._now_ns, self._offset_ns = now_ns, offset_ns

    def emptied(self) -> None:
        """Nothing waits any more: what comes now arrives after this reading began."""
        self._empty_ns, self._believed = self._now_ns, True

    def arrival_ns(self, stamp_s: float | None) -> int:
        """Arrival on the clock of ``now_ns`` of the frame with calendar stamp ``stamp_s``."""
        if not stamp_s:
            return self._now_ns
        if self._believed and 0.0 < stamp_s < STAMP_MAX_S:
            arrival_ns = int(stamp_s * 1e9) + self._offset_ns
            if arrival_ns >= self._empty_ns - RESOLUTION_NS:
                return min(max(arrival_ns, self._empty_ns), self._now_ns)
        self.refused += 1
        return self._now_ns
