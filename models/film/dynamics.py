"""What a film model does to a rotor: its orbits beside the Reynolds film's, and the speed where
whirl sets in."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.film.judge import FilmBar, FilmModel
from sim_hil.film.equilibrium import equilibrium, whirl_threshold
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import Force, Trajectory, simulate
from sim_hil.rigs import RigData
from sim_hil.rotor.network_law import ReducedNetworkLaw

Floats = NDArray[np.float64]

REVOLUTIONS = 50
WHIRL_RATIOS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
"""Eccentricity ratios at which whirl is looked for; beyond about 0.75 a plain bearing is stable at
any speed."""

_STEP = 0.01
"""Reach of the differences, in gaps, as :func:`sim_hil.equilibrium` takes them."""

HIGH_VIBRATION: Final = 1.954
"""Eccentricity of the mass over the clearance where vibration is high."""
CASES: Final = ("steady", "high_vibration", "run_up", "half_order_whirl")


def conditions_of(rig: RigData) -> dict[str, tuple[float, float, float, float, float]]:
    """Of each of :data:`CASES`: speeds at start and end, rpm, load, N, clearance, m, and unbalance
    over the rig's normal one."""
    rpm, load, gap = rig.start_rpm, rig.start_load_N, rig.bearing.clearance_nominal_m
    fast, widest = rig.speed_max_rpm, rig.bearing.clearance_max_m
    wide = min(gap / 0.6, widest)
    shaking = HIGH_VIBRATION * wide * rig.rotor.effective_mass_kg / rig.rotor.unbalance_kg_m
    return {
        "steady": (rpm, rpm, load, gap, 1.0),
        "high_vibration": (rpm, rpm, load, wide, shaking),
        "run_up": (0.5 * rpm, 1.5 * rpm, load, gap, 5.0),
        "half_order_whirl": (fast, fast, rig.load_min_N, min(1.25 * gap, widest), 1.0),
    }


def follow(rig: RigData, case: str, force: Force) -> Trajectory:
    """:data:`REVOLUTIONS` turns of ``case`` on a film."""
    start, end, load, clearance, unbalance = conditions_of(rig)[case]
    seconds = REVOLUTIONS * 60.0 / (0.5 * (start + end))
    build = Build.nominal(rig)
    build = replace(build, unbalance_kg_m=unbalance * build.unbalance_kg_m)
    duty = Duty((0.0, seconds), (start, end), (load, load))
    return simulate(
        rig,
        duty,
        clearance=clearance,
        seconds=seconds,
        thermal=False,
        build=build,
        force=force,
        rate_hz=20_000.0,
    )


def orbit_error_percent(rig: RigData, case: str, force: Force) -> float:
    """Largest distance between the journal and the Reynolds (table) film's, percent of the
    clearance."""
    ours, reference = follow(rig, case, force), follow(rig, case, "table")
    apart = np.hypot(*(ours.position_m - reference.position_m).T)
    return 100.0 * float(apart.max()) / conditions_of(rig)[case][3]


def orbits(rig: RigData, law: ReducedNetworkLaw) -> list[FilmBar]:
    """A bar for every case."""
    return [
        FilmBar(f"orbit_{case}_percent_of_clearance", orbit_error_percent(rig, case, law), 1.0)
        for case in CASES
    ]


def linear_orbits(rig: RigData) -> dict[str, float]:
    """The same distances for springs and dampers around the first equilibrium."""
    return {case: round(orbit_error_percent(rig, case, "linear"), 2) for case in CASES}


def whirl(film: FilmModel, length_over_diameter: float, grid: tuple[int, int]) -> list[FilmBar]:
    """Largest error of the speed where a rotor at each eccentricity begins to whirl."""
    errors = []
    for ratio in WHIRL_RATIOS:
        radius, c, mu, omega = 0.02, 6e-5, 0.01, 600.0
        length = 2.0 * radius * length_over_diameter
        true = equilibrium(
            eccentricity_ratio=ratio,
            radius_m=radius,
            length_m=length,
            clearance_m=c,
            viscosity_Pa_s=mu,
            speed_rad_s=omega,
            grid=grid,
        )
        rest = np.array([0.0, 0.0, 0.0, 0.0, omega, c, mu, radius, length])
        load, stiffness, damping = at_rest(film, rest, ratio)
        threshold = whirl_threshold(stiffness * c / load, damping * c * omega / load)[1]
        errors.append(load * threshold**2 / (true.load_N * true.threshold**2) - 1.0)
    return [FilmBar("whirl_threshold_speed_percent", 100.0 * float(np.max(np.abs(errors))), 2.0)]


def at_rest(film: FilmModel, state: Floats, ratio: float) -> tuple[float, Floats, Floats]:
    """Load that a resting journal at ``ratio`` carries, N, and K, C along it and 90 degrees on, SI.

    At a given eccentricity the load is proportional to the speed, so that the speed at the
    threshold is ``threshold^2 W / (omega c m)`` with ``W / omega`` of the film alone.
    """
    c, omega = state[5], state[4]
    here = state.copy()
    here[0] = ratio * c
    force = film(here[None])[0][0]
    load = float(np.hypot(*force))
    along = -force / load
    axes = np.array([along, [-along[1], along[0]]])
    reach = _STEP * (1.0 - ratio) * c
    moves = np.zeros((8, 9))
    for k, axis in enumerate(axes):
        for sign in (0, 1):
            moves[4 * sign + k, :2] = (1 - 2 * sign) * reach * axis
            moves[4 * sign + 2 + k, 2:4] = (1 - 2 * sign) * reach * omega * axis
    forces = film(here + moves)[0]
    slopes = -(forces[:4] - forces[4:]) / (2.0 * reach) @ axes.T
    return load, slopes[:2].T, slopes[2:].T / omega
