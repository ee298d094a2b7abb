"""Harmonic balance against the linear answer where it holds and against the time simulation where
it does not."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.brain.film import Points
from firmware_py.brain.orbit import balanced
from firmware_py.brain.time_simulation import STEPS_A_TURN, simulate
from firmware_py.machine.lubricant import viscosity_Pa_s

from .machine import CONFIG, film

FILM = film()


def points(rpm: float, load_N: float, clearance_m: float) -> Points:
    viscosity = viscosity_Pa_s(CONFIG.machine.lubricant, 45.0)
    return Points(*(np.array([v]) for v in (rpm * np.pi / 30, clearance_m, viscosity, load_N)))


def test_a_small_orbit_is_the_linear_one() -> None:
    p = points(6000.0, 100.0, 60e-6)
    steady, unbalance = FILM.steady(p), np.array([1e-6])
    orbit = balanced(FILM, p, steady, unbalance)
    linear = steady.response_m_per_kg_m * unbalance
    assert np.abs(orbit.first_m - linear).max() < 1e-3 * np.abs(linear).max()
    assert np.abs(orbit.shift_m).max() < 1e-9
    assert orbit.power_W == pytest.approx(steady.orbit_power_W_per_kg2_m2 * unbalance**2, abs=1e-3)
    assert orbit.min_film_m(p, steady) == pytest.approx(
        steady.min_film_m(p.clearance_m, unbalance), abs=1e-9
    )


@pytest.mark.parametrize(
    ("case", "unbalance"), [((9000.0, 60.0, 90e-6), 6e-5), ((6000.0, 100.0, 60e-6), 2e-4)]
)
def test_a_large_orbit_is_that_of_the_time_simulation(
    case: tuple[float, float, float], unbalance: float
) -> None:
    p, size = points(*case), np.array([unbalance])
    steady = FILM.steady(p)
    orbit = balanced(FILM, p, steady, size)
    motion = simulate(FILM, p, size, turns=14)
    turn = motion.position_m[-STEPS_A_TURN:, 0]
    first = 2.0 * (
        turn * np.exp(-2j * np.pi * np.arange(1, STEPS_A_TURN + 1) / STEPS_A_TURN)[:, None]
    ).mean(axis=0)
    linear = steady.response_m_per_kg_m[0] * unbalance
    assert (
        np.abs(linear - first).max() > 0.05 * np.abs(first).max()
    )  # the linear film's answer is off
    assert np.abs(orbit.first_m[0] - first).max() < 0.05 * np.abs(first).max()
    shift = turn.mean(axis=0) - steady.position_m[0]
    assert np.hypot(*shift) > 0.4e-6
    assert orbit.shift_m[0] == pytest.approx(shift, abs=0.2 * np.hypot(*shift))
    assert orbit.min_film_m(p, steady) == pytest.approx(motion.min_film_m(1), abs=0.5e-6)


def test_an_unbalance_beyond_what_the_gap_holds_keeps_a_sane_orbit() -> None:
    """The linear orbit would be twice as wide as the gap."""
    p = points(9000.0, 60.0, 90e-6)
    steady = FILM.steady(p)
    response = np.abs(steady.response_m_per_kg_m).max()
    orbit = balanced(FILM, p, steady, np.array([2.0 * 90e-6 / response]))
    assert 40e-6 < np.abs(orbit.first_m).max() < 90e-6
    assert 0.0 < orbit.power_W[0] < steady.power_W[0]
