"""The yardstick of all speed figures: a textbook cyclic tridiagonal solver, Thomas with Sherman and
Morrison."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit, prange, set_num_threads

from sim_hil.rotor.parameters import Floats


@njit(cache=True)
def cyclic_thomas(
    lower: Floats, diagonal: Floats, upper: Floats, right: Floats, x: Floats, z: Floats, g: Floats
) -> None:
    """Solve `lower[i] x[i-1] + diagonal[i] x[i] + upper[i] x[i+1] = right[i]` around the ring, into
    `x`."""
    n = right.size
    gamma = -diagonal[0]
    corner = lower[0] / gamma
    beta = diagonal[0] - gamma
    x[0], z[0] = right[0] / beta, gamma / beta
    for i in range(1, n):
        g[i] = upper[i - 1] / beta
        here = diagonal[i] - (upper[n - 1] * corner if i == n - 1 else 0.0)
        beta = here - lower[i] * g[i]
        x[i] = (right[i] - lower[i] * x[i - 1]) / beta
        z[i] = ((upper[n - 1] if i == n - 1 else 0.0) - lower[i] * z[i - 1]) / beta
    for i in range(n - 2, -1, -1):
        x[i] -= g[i + 1] * x[i + 1]
        z[i] -= g[i + 1] * z[i + 1]
    share = (x[0] + corner * x[n - 1]) / (1.0 + z[0] + corner * z[n - 1])
    for i in range(n):
        x[i] -= share * z[i]


@njit(cache=True)
def repeat_reference(bands: Floats, right: Floats, work: Floats, calls: int) -> float:
    """`calls` times four systems; `bands` (3, n), `right` (4, n), `work` (3, n)."""
    total = 0.0
    for _ in range(calls):
        for k in range(right.shape[0]):
            cyclic_thomas(bands[0], bands[1], bands[2], right[k], work[0], work[1], work[2])
            total += work[0, k]
    return total


def reference_arrays(nodes: int = 64, systems: int = 4) -> tuple[Floats, Floats, Floats]:
    """A diagonally dominant ring, its right-hand sides and scratch space."""
    rng = np.random.default_rng(1)
    bands = np.array(
        [-rng.uniform(0.5, 1, nodes), rng.uniform(2.5, 3, nodes), -rng.uniform(0.5, 1, nodes)]
    )
    return bands, rng.normal(size=(systems, nodes)), np.zeros((3, nodes))


@njit(parallel=True, cache=True)
def _repeat_on_threads(bands: Floats, right: Floats, work: Floats, calls: int) -> None:
    for k in prange(work.shape[0]):
        work[k, 0, 0] = repeat_reference(bands, right, work[k], calls)


def spread_reference(shares: int, calls: int) -> Callable[[int], None]:
    """A call that solves the reference `shares * calls` times on as many threads as it is told."""
    bands, right, work = reference_arrays()
    works = np.tile(work, (shares, 1, 1))

    def call(threads: int) -> None:
        set_num_threads(threads)
        _repeat_on_threads(bands, right, works, calls)

    return call
