"""Equilibrium and linear coefficients."""

import numpy as np
import pytest

from sim_hil.film import FeedPatch, FilmError, equilibrium, film_force

C = 60e-6
OIL = {
    "radius_m": 0.02,
    "length_m": 0.02,
    "clearance_m": C,
    "viscosity_Pa_s": 0.01,
    "speed_rad_s": 300.0,
}
COARSE = OIL | {"grid": (96, 12)}
GROOVE = FeedPatch("groove", np.pi / 2, np.radians(20), 0.016, 1e5)


@pytest.mark.parametrize("load", [0.1, 30.0, 300.0, 10000.0])
@pytest.mark.parametrize("feed", [[], [GROOVE]])
def test_film_balances_the_load(load, feed):
    state = equilibrium(load_N=load, feed=feed, **COARSE)
    force = film_force(state.position_m, (0.0, 0.0), feed=feed, **COARSE).force_N
    np.testing.assert_allclose(force, (0.0, load), atol=1e-6 * load)
    if load < 1:
        return  # so near the centre the feed lets one eccentricity carry two loads
    again = equilibrium(eccentricity_ratio=state.eccentricity_ratio, feed=feed, **COARSE)
    assert again.load_N == pytest.approx(load, rel=1e-5)
    assert again.attitude_rad == pytest.approx(state.attitude_rad, abs=1e-5)


def test_attitude_is_counted_with_the_rotation():
    forward = equilibrium(load_N=100.0, **COARSE)
    backward = equilibrium(load_N=100.0, **(COARSE | {"speed_rad_s": -300.0}))
    assert 0 < forward.attitude_rad < np.pi / 2
    assert (
        forward.position_m[0] > 0
    )  # rotation from x to y carries the journal to the right of a downward load
    assert backward.attitude_rad == pytest.approx(forward.attitude_rad, rel=1e-6)
    assert backward.position_m[0] == pytest.approx(-forward.position_m[0], rel=1e-6)
    np.testing.assert_allclose(backward.stiffness, forward.stiffness, rtol=1e-5)


def test_load_direction_only_turns_the_answer():
    down, aside = (equilibrium(load_N=100.0, load_angle_rad=a, **COARSE) for a in (-np.pi / 2, 0.3))
    assert aside.attitude_rad == pytest.approx(down.attitude_rad, rel=1e-6)
    np.testing.assert_allclose(aside.damping, down.damping, rtol=1e-4)


def test_coefficients_predict_small_motions():
    state = equilibrium(load_N=100.0, **OIL)
    axes = np.array([[0.0, -1.0], [1.0, 0.0]])
    x, v = np.array([3e-7, -2e-7]), np.array([1e-4, 5e-5])
    moved = film_force(state.position_m + axes.T @ x, axes.T @ v, **OIL).force_N
    change = axes @ (moved - state.film.force_N)
    np.testing.assert_allclose(
        change, -state.stiffness_N_m @ x - state.damping_N_s_m @ v, rtol=0.03
    )


@pytest.mark.parametrize("eccentricity", [0.3, 0.6, 0.9, 0.95, 0.97, 0.99, 0.995])
def test_damping_of_the_reynolds_film_is_symmetric(eccentricity):
    state = equilibrium(eccentricity_ratio=eccentricity, **OIL)
    assert state.damping[0, 1] == pytest.approx(state.damping[1, 0], rel=2e-2)


def test_numbers_without_unit_follow_from_those_with():
    state = equilibrium(load_N=100.0, **COARSE)
    np.testing.assert_allclose(state.stiffness, state.stiffness_N_m * C / 100.0, rtol=1e-6)
    np.testing.assert_allclose(state.damping, state.damping_N_s_m * C * 300 / 100.0, rtol=1e-6)
    assert state.sommerfeld == pytest.approx(
        0.01 * 300 / (2 * np.pi) * 0.02 * 0.04 / 100 * (0.02 / C) ** 2, rel=1e-6
    )


def test_smallest_film_is_not_monotone_in_clearance():
    films = [
        1e6
        * float(
            equilibrium(
                load_N=100.0, **(OIL | {"clearance_m": c * 1e-6, "speed_rad_s": np.pi * 100})
            ).film.min_film_m
        )
        for c in (40, 60, 80, 100, 160)
    ]
    np.testing.assert_allclose(films, [26.2, 28.1, 28.2, 27.6, 25.2], atol=0.15)


def test_batches_broadcast():
    loads, clearances = np.array([[30.0], [200.0]]), np.array([50e-6, C, 90e-6])
    batch = equilibrium(load_N=loads, **(COARSE | {"clearance_m": clearances}))
    assert batch.eccentricity_ratio.shape == (2, 3)
    assert batch.stiffness_N_m.shape == (2, 3, 2, 2)
    assert batch.film.force_N.shape == (2, 3, 2)
    one = equilibrium(load_N=200.0, **COARSE)
    assert isinstance(one.eccentricity_ratio, float)
    assert batch.threshold[1, 1] == one.threshold
    np.testing.assert_array_equal(batch.damping[1, 1], one.damping)


def test_coefficients_do_not_show_the_grid():
    """The rupture boundary jumps from cell to cell; neighbouring grids give the same damping all
    the same."""
    damping = [
        equilibrium(eccentricity_ratio=0.8, **(OIL | {"grid": (n, 16)})).damping
        for n in (152, 155, 158, 161)
    ]
    assert np.ptp(damping, axis=0).max() < 2e-3 * np.max(damping)


def test_a_load_beyond_the_film_is_refused():
    still = COARSE | {
        "speed_rad_s": 0.0,
        "feed": [FeedPatch("groove", -np.pi / 2, np.radians(20), 0.016, 1e4)],
    }
    with pytest.raises(FilmError, match=r"no equilibrium found for a load of 1e\+06 N"):
        equilibrium(load_N=1e6, **still)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "either load_N or eccentricity_ratio"),
        ({"load_N": 1.0, "eccentricity_ratio": 0.5}, "either"),
        ({"load_N": -1.0}, "load_N = -1.0"),
        ({"eccentricity_ratio": 1.0}, "eccentricity_ratio = 1.0"),
        ({"load_N": 1.0, "speed_rad_s": 0.0}, "carries no load"),
        ({"eccentricity_ratio": 0.5, "speed_rad_s": 0.0}, "carries no load"),
        ({"load_N": 1.0, "load_angle_rad": float("nan")}, "load_angle_rad"),
    ],
)
def test_impossible_requests_are_refused(change, message):
    with pytest.raises(FilmError, match=message):
        equilibrium(**(COARSE | change))
