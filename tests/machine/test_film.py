"""The guard's film at rest against the Reynolds solution, at and between the knots of its table."""

from dataclasses import replace
from functools import cache
from math import cos, degrees, isfinite, sin

import numpy as np
import pytest

from firmware_py.machine.film import ECCENTRICITY_MAX, KNOTS, StaticFilm
from sim_hil import simulate
from sim_hil.film import Equilibrium, equilibrium
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import load_rig

RADIUS_M, CLEARANCE_M, VISCOSITY, SPEED = 0.02, 60e-6, 0.01, 600.0
KNOTS_SEEN = [
    round(e / ECCENTRICITY_MAX * KNOTS)
    for e in (0.02, 0.12, 0.25, 0.36, 0.45, 0.55, 0.67, 0.77, 0.87, 0.93)
]
RATIOS = [0.125, 0.2, 0.5, 0.8, 1.0]


@cache
def true(ratio: float, knot: int) -> Equilibrium:
    return equilibrium(
        eccentricity_ratio=knot * ECCENTRICITY_MAX / KNOTS,
        radius_m=RADIUS_M,
        length_m=2 * RADIUS_M * ratio,
        clearance_m=CLEARANCE_M,
        viscosity_Pa_s=VISCOSITY,
        speed_rad_s=SPEED,
    )


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("knot", KNOTS_SEEN)
def test_load_attitude_and_friction_are_those_of_the_film(ratio: float, knot: int) -> None:
    film, state = StaticFilm(RADIUS_M, 2 * RADIUS_M * ratio), true(ratio, knot)
    scale = CLEARANCE_M**2 / (VISCOSITY * SPEED)
    assert film.load[knot] == pytest.approx(state.load_N * scale, rel=0.01)
    per_speed = film.load_per_viscous_speed(film.eccentricity[knot], CLEARANCE_M)
    assert per_speed * CLEARANCE_M**2 == pytest.approx(film.load[knot], rel=1e-14)
    across = film.sine[knot] * cos(state.attitude_rad) - film.cosine[knot] * sin(state.attitude_rad)
    assert abs(degrees(across)) < 0.25
    torque = float(state.film.friction_torque_N_m) * CLEARANCE_M / (VISCOSITY * SPEED)
    assert film.friction[knot] == pytest.approx(torque, rel=0.005)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("knot", KNOTS_SEEN[:7])
def test_the_clearance_of_whirl_is_that_of_the_film_and_never_wider(
    ratio: float, knot: int
) -> None:
    """A rotor of just the mass that whirls at the knot finds the threshold again by its load and
    speed."""
    film, state = StaticFilm(RADIUS_M, 2 * RADIUS_M * ratio), true(ratio, knot)
    if not isfinite(state.threshold):
        return
    mass = state.threshold**2 * state.load_N / (SPEED**2 * CLEARANCE_M)
    found = film.whirl_share(state.load_N**3 / (mass**2 * SPEED**5 * VISCOSITY))
    assert found > 0.995 / state.threshold**2
    assert knot > KNOTS_SEEN[2] or found == pytest.approx(1 / state.threshold**2, rel=0.005)


def test_whirl_share_rises_with_the_tie_and_is_held_beyond_its_end() -> None:
    film = StaticFilm(RADIUS_M, RADIUS_M)
    shares = [film.whirl_share(tie) for tie in (0.0, *np.geomspace(1e-14, 1e-3, 200))]
    assert shares == sorted(shares)
    assert shares[-1] == shares[-2]


def test_a_bearing_longer_than_the_table_is_taken_as_the_longest() -> None:
    film = StaticFilm(RADIUS_M, 2.5 * RADIUS_M)
    assert film.sine == StaticFilm(RADIUS_M, 2 * RADIUS_M).sine


@pytest.mark.parametrize("unbalance_share", [0.1, 0.3, 0.45, 0.6, 0.8])
@pytest.mark.parametrize(
    ("rpm", "load_N"), [(12000.0, 22.0), (12000.0, 30.0), (12000.0, 38.0), (9500.0, 30.0)]
)
def test_a_rotor_out_of_balance_does_not_whirl_in_the_clearance_that_the_law_leaves(
    rpm: float, load_N: float, unbalance_share: float
) -> None:
    """Four seconds of the rotor on the Reynolds film, 4 % within for its coupling
    (``rotor.whirl_error_share``)."""
    rig, speed = load_rig("bench"), rpm * RAD_S_PER_RPM
    per_number = 0.96 * load_N / (rig.rotor.effective_mass_kg * speed**2)
    viscosity = rig.oil.viscosity_Pa_s * np.exp(-rig.oil.slope_per_K * 5.0)
    film = StaticFilm(rig.bearing.radius_m, rig.bearing.length_m)
    clearance_m = per_number / film.whirl_share(
        per_number**2 * load_N / (viscosity * speed), unbalance_share
    )
    build = replace(Build.nominal(rig), unbalance_kg_m=unbalance_share * load_N / speed**2)
    run = simulate(
        rig,
        Duty.hold(rpm, load_N, 4.0),
        clearance=clearance_m,
        build=build,
        inlet_C=rig.oil.reference_C + 5.0,
        dt_s=2e-4,
        thermal=False,
    )
    assert run.last(0.4).peak_to_peak_m() < 0.45 * clearance_m
