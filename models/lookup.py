"""The simple rival of the agent: a table of clearances over speed and estimated load."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from models.shielded import Observation, Policy, value
from sim_hil.environment import Limits
from sim_hil.response import power_map
from sim_hil.rigs import load_rig

Floats = NDArray[np.float64]

FILM_MARGIN = 1.3
SWING_MARGIN = 0.6
"""Shares of the limits that the nominal machine keeps, so that a build at the edge of the spread still does."""


def lookup_policy(rig_name: str, points: tuple[int, int, int], progress: Callable[[int], None]) -> Policy:
    """Table of the least power that keeps the limits, by steady runs of the nominal build.

    Parameters
    ----------
    points
        Speeds, loads and clearances of the grid.
    """
    rig = load_rig(rig_name)
    speeds = np.geomspace(rig.speed_min_rpm, rig.speed_max_rpm, points[0])
    loads = np.geomspace(rig.load_min_N, rig.load_max_N, points[1])
    clearances = np.linspace(rig.bearing.clearance_min_m, rig.bearing.clearance_max_m, points[2])
    table = np.empty((points[0], points[1]))
    for i, speed in enumerate(speeds):
        steady = power_map(rig, np.array([speed]), loads, clearances, seconds=0.8)
        table[i] = [_best(clearances, *(m[0, j] for m in (steady.power_W, steady.min_film_m, steady.peak_to_peak_m)))
                    for j in range(points[1])]  # fmt: skip
        progress(i + 1)
    return _Table(speeds * np.pi / 30.0, loads, table)


def _best(clearances: Floats, power: Floats, film: Floats, swing: Floats) -> float:
    """Clearance of least power among those that keep the limits with margin, else the one of thickest film."""
    limits = Limits()
    good = (film >= FILM_MARGIN * limits.min_film_m) & (swing <= SWING_MARGIN * limits.swing_share * clearances)
    return float(clearances[np.argmin(np.where(good, power, np.inf))] if good.any() else clearances[np.argmax(film)])


class _Table:
    """Bilinear in the logarithms of speed and load."""

    def __init__(self, speeds_rad_s: Floats, loads_N: Floats, clearance_m: Floats) -> None:
        self._speeds, self._loads, self._table = np.log(speeds_rad_s), np.log(loads_N), clearance_m

    def __call__(self, observation: Observation) -> float:
        speed = np.log(max(value(observation, "speed_rad_s"), 1.0))
        load = np.log(max(value(observation, "load_estimate_N"), 1.0))
        along = [np.interp(load, self._loads, row) for row in self._table]
        return float(np.interp(speed, self._speeds, along))
