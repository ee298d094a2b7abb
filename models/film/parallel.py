"""Film solutions on every core: the solver holds no interpreter lock, so that threads do."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from models.runs import progress_bar

Floats = NDArray[np.float64]


def each(solve: Callable[[Floats], Floats], rows: Floats, title: str) -> Floats:
    """``solve`` of every row, in order, stacked."""
    done = []
    with (
        progress_bar(title, len(rows)) as bar,
        ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool,
    ):
        for answer in pool.map(solve, rows):
            done.append(answer)
            bar(len(done))
    return np.array(done)
