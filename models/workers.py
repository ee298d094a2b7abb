"""The same work on many items, on several processes."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Final, TypeVar

T = TypeVar("T")
R = TypeVar("R")

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What numpy's linear algebra and torch go by when they are loaded."""


def map_in_order(make: Callable[[T], R], items: Sequence[T], workers: int) -> Iterator[R]:
    """``make`` of every item, in their order, on ``workers`` processes of one thread each."""
    if workers == 1:
        yield from map(make, items)
        return
    context = multiprocessing.get_context("spawn")
    with _single_threaded(), ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield from pool.map(make, items)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes that start meanwhile compute with one thread, unless the user says otherwise.

    With as many threads as cores in each of as many processes they wait for each other: twice the
    time.
    """
    added = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
