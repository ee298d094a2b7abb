"""The fed network's rivals: the simulator's own table of the fed film, and the same table of fewer
numbers."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.film.fed_data import GROOVE_LENGTH_SHARE, GROOVE_WIDTH_RAD
from models.film.judge import FilmModel
from sim_hil.film.fed import FedLaw, FedTable, fed_force

Floats = NDArray[np.float64]

_CELLS = {"thinned": (5, 6, 8, 3), "smallest": (3, 3, 4, 3)}
"""Smaller tables: cells of the eccentricity, of half a turn from the groove, of a turn from the
eccentricity and of the share of the supply.  Its spline takes no fewer than three cells.
"""


def tables(length_over_diameter: float) -> dict[str, FedTable]:
    """The table that the simulator ships, and smaller ones made alike, by name."""
    groove = (length_over_diameter, float(GROOVE_WIDTH_RAD), GROOVE_LENGTH_SHARE)
    return {"shipped": FedTable.load(*groove)} | {
        k: FedTable.build(*groove, cells=c) for k, c in _CELLS.items()
    }


def model(table: FedTable) -> FilmModel:
    """A table as a film model."""
    law = table.law(0.0)

    def film(state: Floats) -> list[Floats]:
        rows = _evaluate(law, np.ascontiguousarray(state))
        return [rows[:, :2], rows[:, 2:3], rows[:, 3:4], np.ones((len(rows), 1))]

    return film


@njit(cache=True)  # type: ignore[untyped-decorator]
def _evaluate(law: FedLaw, state: Floats) -> Floats:
    """Force, torque and side flow of every state ``(m, 11)``."""
    rows = np.empty((state.shape[0], 4))
    for i in range(state.shape[0]):
        x, y, vx, vy, omega, c, mu, radius, length, supply, groove = state[i]
        turned = FedLaw(law.unfed, law.groove, groove)
        fx, fy, torque, flow, _ = fed_force(
            turned, x, y, vx, vy, omega, c, mu, radius, length, 0.0, supply
        )
        rows[i] = fx, fy, torque, flow
    return rows


def microseconds(film: FilmModel, state: Floats, repeats: int = 20) -> dict[str, float]:
    """Median time of one state, alone in a call and among all of ``state`` in one, one thread."""

    def timed(work: Callable[[], object], share: int) -> float:
        work()
        times = []
        for _ in range(repeats):
            started = time.perf_counter()
            work()
            times.append(time.perf_counter() - started)
        return float(f"{1e6 * float(np.median(times)) / share:.3g}")

    return {
        "alone": timed(partial(film, state[:1]), 1),
        "in_a_batch": timed(partial(film, state), len(state)),
    }
