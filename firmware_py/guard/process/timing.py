"""An absolute grid of cycles: whole periods are skipped on an overrun, and lateness is kept as a
histogram."""

from __future__ import annotations

from bisect import bisect_left
from itertools import accumulate
from typing import Final

BIN_NS: Final = 20_000
BINS: Final = 500


class Grid:
    """Points in time ``period_ns`` apart.

    Parameters
    ----------
    start_ns
        First point.
    period_ns
        Distance of the points.

    Notes
    -----
    ``skipped`` counts points that passed while a cycle was still running or the host stood still.
    """

    def __init__(self, start_ns: int, period_ns: int) -> None:
        self.due_ns = start_ns
        self.period_ns = period_ns
        self.skipped = 0

    def advance(self, now_ns: int) -> int:
        """The next point after ``now_ns``; points in between are skipped and counted."""
        self.due_ns += self.period_ns
        behind = (now_ns - self.due_ns) // self.period_ns
        if behind > 0:
            self.skipped += behind
            self.due_ns += behind * self.period_ns
        return self.due_ns


class Lateness:
    """How late cycles begin: a histogram with 20 us bins up to 10 ms; the last bin holds the
    rest."""

    def __init__(self, late_ns: int) -> None:
        self._late_ns = late_ns
        self._bins = [0] * BINS
        self.cycles = 0
        self.late = 0
        self.max_ns = 0

    def add(self, lateness_ns: int) -> None:
        """One cycle began ``lateness_ns`` after its point."""
        self.cycles += 1
        self.late += lateness_ns > self._late_ns
        if lateness_ns > self.max_ns:
            self.max_ns = lateness_ns
        bin_ = lateness_ns // BIN_NS
        self._bins[bin_ if bin_ < BINS else BINS - 1] += 1

    def percentile_us(self, share: float) -> int:
        """Upper edge (us) of the bin in which ``share`` of the cycles is reached."""
        reached = bisect_left(list(accumulate(self._bins)), share * self.cycles)
        return (reached + 1) * BIN_NS // 1000

    def counters(self) -> dict[str, int]:
        """For the guard's state."""
        return {
            "cycles": self.cycles,
            "cycles_late": self.late,
            "lateness_p50_us": self.percentile_us(0.5),
            "lateness_p99_us": self.percentile_us(0.99),
            "lateness_max_us": self.max_ns // 1000,
        }
