"""Bounds of the times that come in with frames: no stamp is later than now, none is absurdly
old."""

from __future__ import annotations

from typing import Final

ARRIVAL_AHEAD_MAX_NS: Final = 1_000_000
"""An arrival this much later than now is counted; it is never used (one guard cycle: a clock read
late)."""

ARRIVAL_AGE_MAX_NS: Final = 1_000_000_000
"""No link keeps a frame for longer: an older arrival is no arrival, and the moment of reading is
taken."""

TICK_AHEAD_MAX_NS: Final = 5_000_000
"""A node's tick may map to this much later than the arrival of its message: sample frames wait for
their last instant, so the map is late by up to two frames."""


def bounded_arrival_ns(
    arrival_ns: int, newest_ns: int, now_ns: int, counters: dict[str, int]
) -> int:
    """``arrival_ns`` between the newest arrival so far and now.

    Frames come in the order of their arrival.  What is outside is counted as ``stamps_ahead`` or
    ``stamps_behind``.
    """
    if arrival_ns > now_ns:
        counters["stamps_ahead"] += arrival_ns > now_ns + ARRIVAL_AHEAD_MAX_NS
        return now_ns
    if arrival_ns < now_ns - ARRIVAL_AGE_MAX_NS:
        counters["stamps_behind"] += 1
        return now_ns
    if arrival_ns < newest_ns <= now_ns:
        counters["stamps_behind"] += 1
        return newest_ns
    return arrival_ns
