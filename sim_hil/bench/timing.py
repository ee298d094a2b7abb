"""Times beside a reference: each round times the reference and the subject, medians of times and of
ratios count."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

ROUNDS = 9


@dataclass(frozen=True)
class Timing:
    """Median processor time of one call, s, and of its ratio to one call of the reference timed
    just before."""

    seconds: float
    ratio: float


def beside(
    reference: Callable[[], object],
    subject: Callable[[], object],
    calls: tuple[int, int],
    clock: Callable[[], float] = time.thread_time,
) -> Timing:
    """Time `subject` (which makes `calls[1]` calls) beside `reference` (`calls[0]` calls), on this
    thread's clock."""
    reference()
    subject()
    seconds, ratios = [], []
    for _ in range(ROUNDS):
        before, after = _taken(reference, clock) / calls[0], _taken(subject, clock) / calls[1]
        seconds.append(after)
        ratios.append(after / before)
    return Timing(median(seconds), median(ratios))


def wall(work: Callable[[], object]) -> float:
    """Seconds that `work` takes on the wall."""
    return _taken(work, time.perf_counter)


def _taken(work: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    work()
    return clock() - start
