"""Fixed pads: the shape of the gap, and the film in it."""

import math

import numpy as np
import pytest

from sim_hil.film import FilmError, JournalOutsideClearance, equilibrium, film_force
from sim_hil.film.bore import PadBore
from sim_hil.verify import pads

C = 60e-6
OIL = {
    "radius_m": 0.02,
    "length_m": 0.02,
    "clearance_m": C,
    "viscosity_Pa_s": 0.01,
    "speed_rad_s": 300.0,
    "grid": (96, 12),
}
LEMON = PadBore(2, math.pi / 2, math.radians(160.0), 0.5)
HALVES = PadBore(2, math.pi / 2, math.radians(160.0), 0.5, 1.0)
LOBES = PadBore(3, -math.pi / 2, math.radians(100.0), 0.4)
BORES = [LEMON, HALVES, LOBES]


def smallest_by_hand(bore, position):
    """The least of thickness and journal over many places on the pads."""
    theta = np.linspace(-np.pi, np.pi, 200_001)
    pitch = 2 * np.pi / bore.count
    within = np.remainder(theta - bore.angle_rad + pitch / 2, pitch) - pitch / 2
    on_pad = np.abs(within) <= bore.arc_rad / 2
    gap = bore.thickness(theta) - position[0] * np.cos(theta) - position[1] * np.sin(theta)
    return gap[on_pad].min()


@pytest.mark.parametrize("bore", BORES)
@pytest.mark.parametrize("position", [(0.0, 0.0), (0.3, -0.5), (-0.9, 0.1), (0.0, 0.8)])
def test_the_smallest_film_is_that_of_the_shape(bore, position):
    found = bore.smallest(np.array(position))
    assert found == pytest.approx(smallest_by_hand(bore, position), abs=2e-6)


@pytest.mark.parametrize("bore", BORES)
def test_the_reach_ends_at_the_wall(bore):
    for angle in np.linspace(-3, 3, 13):
        way = np.array([math.cos(angle), math.sin(angle)])
        assert bore.smallest(bore.reach(angle) * way) == pytest.approx(0.0, abs=1e-9)
        assert bore.reach(angle) >= 1.0 - 1e-9


def test_a_lemon_has_its_clearance_above_and_below_and_the_pads_own_beside():
    whole = PadBore(2, math.pi / 2, math.pi, 0.5)
    assert whole.thickness(np.array([math.pi / 2, -math.pi / 2])) == pytest.approx([1.0, 1.0])
    assert whole.thickness(np.array([0.0, math.pi])) == pytest.approx([2.0, 2.0])
    assert whole.gap_rad == 0.0


def test_offset_halves_stand_nearest_at_their_ends():
    assert np.degrees(HALVES.nearest_rad - HALVES.middles_rad) == pytest.approx([80.0, 80.0])


def test_zero_preload_is_the_round_bore():
    round_bore = PadBore(2, math.pi / 2, math.pi, 0.0)
    fine = OIL | {"grid": (192, 16)}
    at, moving = (0.4 * C, -0.5 * C), (1e-4, 2e-3)
    plain, padded = (film_force(at, moving, **fine, **more) for more in ({}, {"pads": round_bore}))
    np.testing.assert_allclose(padded.force_N, plain.force_N, rtol=2e-3)
    assert round_bore.shear(np.array([0.4, -0.5])) == pytest.approx(
        2 * np.pi / math.sqrt(1 - 0.41), rel=1e-9
    )
    assert padded.friction_torque_N_m == pytest.approx(plain.friction_torque_N_m, rel=1e-3)
    assert padded.min_film_m == pytest.approx(plain.min_film_m, rel=1e-12)


@pytest.mark.parametrize("bore", BORES)
@pytest.mark.parametrize("load", [2.0, 100.0, 1000.0])
def test_the_film_between_pads_balances_the_load(bore, load):
    state = equilibrium(load_N=load, pads=bore, **OIL)
    force = film_force(state.position_m, (0.0, 0.0), pads=bore, **OIL).force_N
    np.testing.assert_allclose(force, (0.0, load), atol=1e-6 * load)
    assert 0.0 < state.film.min_film_m < C


def test_the_friction_is_that_of_the_shear_at_the_journal():
    fine = OIL | {"grid": (480, 40)}
    at = (1e-5, -2e-5)
    film = film_force(at, (0.0, 0.0), pads=LEMON, fields=True, **fine)
    order = np.argsort(film.theta_rad)
    theta, p = film.theta_rad[order], film.pressure_Pa[order]
    gap = C * LEMON.thickness(theta) - at[0] * np.cos(theta) - at[1] * np.sin(theta)
    middle = (gap + np.roll(gap, -1)) / 2
    slope = np.trapezoid(np.roll(p, -1, axis=0) - p, film.z_m, axis=1)
    width = np.diff(np.append(theta, theta[0] + 2 * np.pi))
    place = np.remainder(theta + width / 2 - LEMON.angle_rad + np.pi / 2, np.pi) - np.pi / 2
    on_pad = np.abs(place) <= LEMON.arc_rad / 2
    shear = 0.01 * 300.0 * 0.02**3 * 0.02 * (width / middle)[on_pad].sum()
    expected = shear + 0.5 * 0.02 * (middle * slope).sum()
    assert film.friction_torque_N_m == pytest.approx(expected, rel=1e-3)


def test_a_journal_in_the_pads_is_refused():
    with pytest.raises(JournalOutsideClearance):
        film_force((0.0, -1.01 * C), (0.0, 0.0), pads=LEMON, **OIL)
    film_force((1.2 * C, 0.0), (0.0, 0.0), pads=LEMON, **OIL)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ((0, 0.0, 1.0, 0.5), "0; 1 to 12"),
        ((3, 0.0, math.radians(130), 0.5), "an arc of 130 deg"),
        ((2, 0.0, 1.0, 0.99), "a preload of 0.99"),
        ((2, 0.0, 1.0, 0.5, 1.5), "an offset of 1.5"),
        ((2, math.nan, 1.0, 0.5), "must be finite"),
    ],
)
def test_pads_that_cannot_be_are_refused(wrong, named):
    with pytest.raises(FilmError, match=named):
        PadBore(*wrong)


@pytest.mark.slow
def test_published_two_lobes():
    rows = list(pads.two_lobes())
    assert sum(row.passed is not None for row in rows) == 52
    assert all(row.passed is not False for row in rows)
