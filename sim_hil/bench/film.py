"""Film forces in compiled loops, beside the reference kernel."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from numba import njit

from sim_hil.bench.reference_kernel import reference_arrays, repeat_reference
from sim_hil.bench.timing import Timing, beside
from sim_hil.film.direct import DirectFilm, direct_force
from sim_hil.film.table import FilmTable, table_force
from sim_hil.rotor.parameters import Floats

_DIRECT_CALLS: Final = 500
_TABLE_CALLS: Final = 20000


@njit(cache=True)
def _repeat_table(table: Floats, states: Floats, calls: int) -> float:
    total = 0.0
    for i in range(calls):
        s = states[i % states.shape[0]]
        total += table_force(table, s[0], s[1], s[2], s[3], 600.0, 60e-6, 0.01, 0.02, 0.02, 0.0)[0]
    return total


@njit(cache=True)
def _repeat_direct(ring: Floats, axial: Floats, work: Floats, states: Floats, calls: int) -> float:
    total = 0.0
    for i in range(calls):
        s = states[i % states.shape[0]]
        total += direct_force(
            ring, axial, work, s[0], s[1], s[2], s[3], 600.0, 60e-6, 0.01, 0.02, 0.02, 0.0
        )[0]
    return total


def repeat_of_reference(calls: int) -> Callable[[], object]:
    """A call that solves the reference `calls` times."""
    return partial(repeat_reference, *reference_arrays(), calls)


def film_timings(reference_calls: int) -> dict[str, Timing]:
    """Reference, direct film (64 stations, 4 modes) and table film at random states."""
    rng = np.random.default_rng(2)
    states = np.column_stack([rng.uniform(-30e-6, 30e-6, (64, 2)), rng.normal(size=(64, 2)) * 5e-3])
    reference = repeat_of_reference(reference_calls)
    film = DirectFilm.make(64, 4)
    direct = partial(_repeat_direct, film.ring, film.axial, film.work, states, _DIRECT_CALLS)
    table = partial(_repeat_table, FilmTable.load(0.5).coefficients, states, _TABLE_CALLS)
    return {
        "reference": beside(reference, reference, (reference_calls, reference_calls)),
        "direct": beside(reference, direct, (reference_calls, _DIRECT_CALLS)),
        "table": beside(reference, table, (reference_calls, _TABLE_CALLS)),
    }
