"""The film functions against the short bearing's closed forms (Ocvirk), and their own
symmetries."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.brain.film import ECCENTRICITY_MAX, Points

from .machine import CONFIG, film

FINE = film(nodes=720)
SPEED = 600.0
CLEARANCE = 60e-6
VISCOSITY = 0.01

# eps, S (L/D)^2, attitude (deg), K c / W and C c omega / W along (load, 90 degrees in rotation),
# whirl threshold omega sqrt(c m / W): closed forms of the short bearing with half-Sommerfeld
# rupture.
ROWS = [
    (
        0.2,
        0.461194,
        75.431,
        (1.4978, 5.7631, -4.5203, 2.4849),
        (10.9798, 2.4916, 2.4916, 9.5869),
        2.6814,
    ),
    (
        0.5,
        0.106049,
        53.680,
        (2.9233, 3.9766, -0.8577, 2.2099),
        (6.6148, 2.2450, 2.2450, 3.0539),
        2.5417,
    ),
    (
        0.8,
        0.013885,
        30.500,
        (9.0423, 5.3264, 0.6739, 1.8477),
        (8.1768, 1.9151, 1.9151, 1.1281),
        None,
    ),
]


def load_of(sommerfeld_ld2: float) -> float:
    b = CONFIG.machine.bearing
    s = sommerfeld_ld2 * (2 * b.journal_radius_m / b.length_m) ** 2
    turns_s = SPEED / (2 * np.pi)
    return (
        VISCOSITY
        * turns_s
        * b.length_m
        * 2
        * b.journal_radius_m
        / s
        * (b.journal_radius_m / CLEARANCE) ** 2
    )


def points(load_N: float, speed: float = SPEED, viscosity: float = VISCOSITY) -> Points:
    return Points(*(np.array([v]) for v in (speed, CLEARANCE, viscosity, load_N)))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"eps {row[0]}")
def test_equilibrium_stiffness_and_damping(row: tuple) -> None:
    eps, s, attitude, stiffness, damping, _ = row
    load = load_of(s)
    p = points(load)
    position, found, _ = FINE.equilibrium(p)
    assert found.all()
    assert np.hypot(*position[0]) / CLEARANCE == pytest.approx(eps, abs=2e-3)
    assert np.degrees(np.arctan2(position[0, 0], -position[0, 1])) == pytest.approx(
        attitude, abs=0.3
    )
    k, c = FINE.slopes(p, position)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # rows: load (-y), 90 degrees in rotation (x)
    k, c = turn @ k[0] @ turn.T, turn @ c[0] @ turn.T
    assert (k * CLEARANCE / load).ravel() == pytest.approx(stiffness, rel=0.01, abs=0.02)
    assert (c * CLEARANCE * SPEED / load).ravel() == pytest.approx(damping, rel=0.01, abs=0.02)


@pytest.mark.parametrize("row", ROWS[:2], ids=lambda row: f"eps {row[0]}")
def test_whirl_threshold(row: tuple) -> None:
    """At the threshold speed, with mu omega held (same eccentricity), the damping ratio crosses
    zero."""
    load, threshold = load_of(row[1]), row[5]
    speed = threshold * np.sqrt(load / (CLEARANCE * CONFIG.machine.rotor.mass_at_bearing_kg))
    below, above = (
        FINE.steady(points(load, speed * k, VISCOSITY * SPEED / (speed * k))).damping_ratio[0]
        for k in (0.99, 1.01)
    )
    assert below > 0 > above


def test_response_solves_the_equation_of_motion() -> None:
    p = points(100.0)
    f = film()
    steady = f.steady(p)
    q = steady.response_m_per_kg_m[0]
    k, c = f.slopes(p, steady.position_m)
    mass = CONFIG.machine.rotor.mass_at_bearing_kg
    rest = (k[0] - mass * SPEED**2 * np.eye(2) + 1j * SPEED * c[0]) @ q
    assert rest == pytest.approx(SPEED**2 * np.array([1.0, -1.0j]), rel=1e-6)


def test_minimum_film_counts_the_motion() -> None:
    steady = film().steady(points(100.0))
    c = np.array([CLEARANCE])
    still = steady.min_film_m(c, np.zeros(1))[0]
    assert still == pytest.approx(CLEARANCE - np.hypot(*steady.position_m[0]))
    moving = steady.min_film_m(c, np.array([5e-5]))[0]
    largest = 5e-5 * np.abs(steady.response_m_per_kg_m[0]).max()
    assert still - 1.5 * largest < moving < still - 0.3 * largest


def test_a_load_that_no_film_carries_is_said_to_be_impossible() -> None:
    steady = film().steady(points(1e6))
    assert not steady.converged[0]
    assert np.isfinite(steady.power_W[0])
    assert np.hypot(*steady.position_m[0]) <= ECCENTRICITY_MAX * CLEARANCE * (1 + 1e-9)


def test_a_batch_equals_its_rows() -> None:
    f = film()
    loads = np.array([30.0, 100.0, 300.0, 1e6])
    many = Points(np.full(4, SPEED), np.full(4, CLEARANCE), np.full(4, VISCOSITY), loads)
    batch = f.steady(many)
    for i, load in enumerate(loads):
        one = f.steady(points(load))
        assert batch.position_m[i] == pytest.approx(one.position_m[0], rel=1e-9)
        assert batch.damping_ratio[i] == pytest.approx(one.damping_ratio[0], rel=1e-6)
