"""Film solutions on every core: each uses one."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray

from models.runs import progress_bar

Floats = NDArray[np.float64]

_FEW = 200
"""So many films or fewer are solved here: other processes take seconds to start."""

_BLOCK = 10


def each(solve: Callable[[Floats], Floats], rows: Floats, title: str) -> Floats:
    """``solve`` of every row, in order, stacked; ``solve`` must be importable by another process."""
    with ExitStack() as stack:
        bar = stack.enter_context(progress_bar(title, len(rows)))
        answers = map(solve, rows)
        if len(rows) > _FEW:
            context = multiprocessing.get_context("spawn")
            pool = stack.enter_context(ProcessPoolExecutor(len(os.sched_getaffinity(0)), mp_context=context))
            answers = pool.map(solve, rows, chunksize=_BLOCK)  # type: ignore[assignment]
        done = []
        for answer in answers:
            done.append(answer)
            bar(len(done))
    return np.array(done)
