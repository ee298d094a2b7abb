"""What the predictor stands beside, fed from the same readings: persistence, a quasi-static table,
linear K and C.

None of them is synchronised: load is read off the mean position with the oil's declared viscosity.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.measurement import Measured
from firmware_py.brain.prediction import Future
from models.prediction.truth import TableFilm, least_damping
from sim_hil.rigs import RigData

Floats = NDArray[np.float64]

RIVALS: Final = ("persistence", "quasi_static_table", "linear_K_C")


def forecasts(rig: RigData, measured: Measured, clearance_m: float, future: Future) -> Floats:
    """(3, 4): power, peak-to-peak, smallest film and damping ratio by each rival (NaN: it does not
    say)."""
    speed = measured.speed_rad_s if future.speed_rad_s is None else future.speed_rad_s
    position = np.array([measured.mean_x_m, measured.mean_y_m])
    viscosity = rig.oil.viscosity_at(measured.oil_outlet_C)
    now = TableFilm(rig, measured.speed_rad_s, measured.clearance_m, viscosity)
    ratio = position / measured.clearance_m
    ratio = ratio * min(1.0, 0.95 / max(float(np.hypot(*ratio)), 1e-9))
    load_N = float(np.hypot(*now.force(ratio, np.zeros(2))))
    stiffness, damping = now.slopes(ratio)
    film_m = measured.clearance_m - float(np.hypot(*position)) - 0.5 * measured.peak_to_peak_m
    persistence = [
        measured.shaft_power_W,
        measured.peak_to_peak_m,
        film_m,
        least_damping(stiffness, damping, rig.rotor.effective_mass_kg),
    ]
    table = _quasi_static(
        rig,
        measured,
        TableFilm(rig, speed, clearance_m, viscosity),
        speed,
        max(load_N + future.load_change_N, 1.0),
    )
    linear = _linear(
        rig, measured, position, (stiffness, damping), speed, clearance_m, future.load_change_N
    )
    return np.array([persistence, table, linear])


def _quasi_static(
    rig: RigData, measured: Measured, film: TableFilm, speed: float, load_N: float
) -> list[float]:
    ratio = film.equilibrium(load_N)
    if not np.isfinite(ratio).all():
        return [math.nan] * 4
    power = film.torque(ratio) * speed + rig.windage_W_s3 * speed**3
    thin = film.clearance_m * (1.0 - float(np.hypot(*ratio))) - 0.5 * measured.peak_to_peak_m
    return [
        power,
        measured.peak_to_peak_m,
        thin,
        least_damping(*film.slopes(ratio), rig.rotor.effective_mass_kg),
    ]


def _linear(
    rig: RigData,
    measured: Measured,
    position: Floats,
    film: tuple[Floats, Floats],
    speed: float,
    clearance_m: float,
    load_change_N: float,
) -> list[float]:
    """Springs and dampers of this moment: shift by the load's change, unbalance response by the
    speed's."""
    stiffness, damping = film
    mass = rig.rotor.effective_mass_kg
    moved = position + np.linalg.solve(stiffness, np.array([0.0, -load_change_N]))
    gains = []
    for w in (measured.speed_rad_s, speed):
        dynamic = stiffness - mass * w * w * np.eye(2) + 1j * w * damping
        gains.append(float(np.abs(np.linalg.solve(dynamic, w * w * np.array([1.0, -1.0j]))).max()))
    swing = measured.peak_to_peak_m * gains[1] / gains[0]
    power = (
        measured.shaft_power_W
        * (speed / measured.speed_rad_s) ** 2
        * measured.clearance_m
        / clearance_m
    )
    return [
        power,
        swing,
        clearance_m - float(np.hypot(*moved)) - 0.5 * swing,
        least_damping(stiffness, damping, mass),
    ]
