"""The limits of a duty, and the orbit's share of the clearance that they hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from sim_hil.plant.duty import Duty
from sim_hil.plant.response import Trajectory
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats

WINDOW_TURNS = 20
ORBIT_SHARE = 0.5
"""Largest peak-to-peak over the present radial clearance."""


@dataclass(frozen=True)
class BoundLimits:
    """Smallest film to keep, m (above the film that trips), and the largest rate of the clearance,
    m/s."""

    min_film_m: float
    rate_m_s: float

    @classmethod
    def of_rig(cls, rig: RigData) -> BoundLimits:
        """What the device of ``rig`` is to keep, and what its actuator can."""
        return cls(rig.min_film_m, rig.actuator.rate_m_per_s)

    @classmethod
    def of(cls, table: dict[str, Any]) -> BoundLimits:
        """From a duty file."""
        c = table["constraints"]
        return cls(c["h_min_um"] * 1e-6, c["clearance_rate_um_s"] * 1e-6)


def duty_of(table: dict[str, Any]) -> Duty:
    """Speed and load of a duty file."""
    start = table["start"]
    corners = [(0.0, float(start["rpm"]), float(start["load_N"]))]
    for segment in table["segments"]:
        end_s = corners[-1][0] + segment["seconds"]
        corners.append((end_s, float(segment["to_rpm"]), float(segment["to_load_N"])))
    time_s, speed, load = zip(*corners, strict=True)
    return Duty(time_s, speed, load)


def orbit_share(run: Trajectory) -> Floats:
    """:func:`path_share` of a run."""
    return path_share(run.position_m, run.column("angle_rad"), run.column("clearance_m"))


def path_share(position_m: Floats, angle_rad: Floats, clearance_m: Floats) -> Floats:
    """Peak-to-peak over present clearance at each instant, in the window of `WINDOW_TURNS` turns
    that ends there.

    The larger of the two axes; before the first whole window, that of the turns so far. As the
    limit says, a window takes the path as it is: what load and speed move the journal counts too.
    """
    turn = np.floor(np.abs(angle_rad - angle_rad[0]) / (2 * np.pi)).astype(np.int64)
    starts = np.flatnonzero(np.diff(turn, prepend=-1))
    window = {"size": WINDOW_TURNS, "origin": (WINDOW_TURNS - 1) // 2, "mode": "nearest"}
    swing = np.zeros(starts.size)
    for axis in range(2):
        path = position_m[:, axis]
        high = maximum_filter1d(np.maximum.reduceat(path, starts), **window)
        low = minimum_filter1d(np.minimum.reduceat(path, starts), **window)
        swing = np.maximum(swing, high - low)
    clearance = minimum_filter1d(np.minimum.reduceat(clearance_m, starts), **window)
    per_turn = swing / clearance
    return np.asarray(per_turn[np.searchsorted(starts, np.arange(turn.size), side="right") - 1])
