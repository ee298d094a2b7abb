"""Clocks. Only the loops read one; every stage below them is handed ``now_ns``."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A source of monotonic time that can also wait."""

    def now_ns(self) -> int:
        """Monotonic time in nanoseconds."""

    def sleep_until(self, t_ns: int) -> None:
        """Return at or after ``t_ns``; at once when it lies in the past."""


class MonotonicClock:
    """The host's ``CLOCK_MONOTONIC``."""

    def now_ns(self) -> int:
        """Monotonic time in nanoseconds."""
        return time.monotonic_ns()

    def sleep_until(self, t_ns: int) -> None:
        """Sleep until ``t_ns``; a past instant returns at once."""
        wait_ns = t_ns - time.monotonic_ns()
        if wait_ns > 0:
            time.sleep(wait_ns * 1e-9)


class SimClock:
    """A clock that moves only when it is told to: the deterministic runs live on it."""

    def __init__(self, now_ns: int = 0) -> None:
        self._now_ns = now_ns

    def now_ns(self) -> int:
        """Present simulated time in nanoseconds."""
        return self._now_ns

    def sleep_until(self, t_ns: int) -> None:
        """Jump to ``t_ns``; never backwards."""
        self._now_ns = max(self._now_ns, t_ns)
