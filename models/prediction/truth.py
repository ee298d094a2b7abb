"""Film and damping ratio of a machine from the simulator's own film table: what forecasts are
judged by."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import table_force
from sim_hil.plant.build import Build
from sim_hil.rigs import RigData

Floats = NDArray[np.float64]

_STEP = 1e-4
_STARTS = (0.5, 0.2, 0.8)


@cache
def _table(length_over_diameter: float) -> Floats:
    return FilmTable.load(length_over_diameter).coefficients


class TableFilm:
    """Forces of the simulator's film table at one operating point."""

    def __init__(
        self, rig: RigData, speed_rad_s: float, clearance_m: float, viscosity_Pa_s: float
    ) -> None:
        bearing = rig.bearing
        self._table = _table(bearing.length_m / (2.0 * bearing.radius_m))
        self._rest = (
            speed_rad_s,
            clearance_m,
            viscosity_Pa_s,
            bearing.radius_m,
            bearing.length_m,
            0.0,
        )
        self._speed, self.clearance_m = speed_rad_s, clearance_m

    def force(self, ratio: Floats, velocity: Floats) -> Floats:
        """Force (2,) N at a position in clearances and a velocity in clearances times speed."""
        state = np.concatenate([ratio, velocity * self._speed]) * self.clearance_m
        return np.array(table_force(self._table, *state, *self._rest)[:2])

    def torque(self, ratio: Floats) -> float:
        """Friction torque at rest there, N m."""
        state = np.concatenate([ratio * self.clearance_m, np.zeros(2)])
        return float(table_force(self._table, *state, *self._rest)[2])

    def slopes(self, ratio: Floats) -> tuple[Floats, Floats]:
        """Stiffness and damping (2, 2), SI."""
        still = np.zeros(2)
        steps = _STEP * np.eye(2)
        stiff = [
            (self.force(ratio - s, still) - self.force(ratio + s, still)) / (2 * _STEP)
            for s in steps
        ]
        damp = [(self.force(ratio, -s) - self.force(ratio, s)) / (2 * _STEP) for s in steps]
        c = self.clearance_m
        return np.array(stiff).T / c, np.array(damp).T / (c * self._speed)

    def equilibrium(self, load_N: float) -> Floats:
        """Position in clearances under a downward load, by Newton's method; NaN where none was
        found."""
        for start in _STARTS:
            ratio = start * np.array([0.6, -0.8])
            for _ in range(60):
                rest = self.force(ratio, np.zeros(2)) - np.array([0.0, load_N])
                if np.hypot(*rest) < 1e-6 * load_N:
                    return ratio
                stiffness, _ = self.slopes(ratio)
                step = np.linalg.solve(stiffness * self.clearance_m, rest)
                ratio = ratio + step * min(1.0, 0.15 / max(float(np.hypot(*step)), 1e-12))
                ratio = ratio * min(1.0, 0.97 / max(float(np.hypot(*ratio)), 1e-12))
        return np.full(2, np.nan)


def least_damping(stiffness: Floats, damping: Floats, mass_kg: float) -> float:
    """Damping ratio of the least damped mode of a mass on springs and dampers (2, 2)."""
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass_kg, -damping / mass_kg]])
    values = np.linalg.eigvals(system)
    return float((-values.real / np.abs(values)).min())


def damping_ratio(
    rig: RigData,
    speed_rad_s: float,
    load_N: float,
    clearance_m: float,
    viscosity_Pa_s: float,
    build: Build | None = None,
) -> tuple[float, float]:
    """Static film (m) and damping ratio of the rotor's effective mass on it."""
    film = TableFilm(rig, speed_rad_s, clearance_m, viscosity_Pa_s)
    ratio = film.equilibrium(load_N)
    if not np.isfinite(ratio).all():
        return 0.0, math.nan
    mass = rig.rotor.effective_mass_kg * (build.mass if build else 1.0)
    return float(clearance_m * (1.0 - np.hypot(*ratio))), least_damping(*film.slopes(ratio), mass)
