"""Figures of the film at rest: its own equilibrium, its derivative, its domain."""

from __future__ import annotations

from math import cos, hypot, pi, sin

import msgspec
import pytest

from firmware_py.config import read_machine
from firmware_py.machine.domain import (
    TAYLOR_LIMIT,
    fastest_film,
    film_domain,
    film_range,
    laminar_up_to_um,
    outside_laws,
)
from firmware_py.machine.film import static_film
from firmware_py.machine.static import (
    greatest_load_N,
    resting,
    sommerfeld,
    stable_clearance_m,
)

RADIUS, LENGTH, CLEARANCE, MU, SPEED = 0.02, 0.02, 50e-6, 0.0094, 600.0


def test_short_bearing_of_a_textbook() -> None:
    """Ocvirk: at L/D = 1/4 and eccentricity 0.5 his number is S (L/D)^2 = 0.0783."""
    film = static_film(RADIUS, 0.5 * RADIUS)
    load_N = film.load_per_viscous_speed(0.5, CLEARANCE) * MU * SPEED
    number = sommerfeld(RADIUS, 0.5 * RADIUS, CLEARANCE, MU, SPEED, load_N) * 0.25**2
    e = 0.5
    ocvirk = (1 - e * e) ** 2 / (pi * e * (pi**2 * (1 - e * e) + 16 * e * e) ** 0.5)
    assert number == pytest.approx(ocvirk, rel=0.06)  # Reynolds carries less than the short film
    found = resting(film, CLEARANCE, MU, SPEED, load_N)
    assert found is not None
    assert found.eccentricity == pytest.approx(0.5, abs=1e-6)
    assert found.film_m == pytest.approx(0.5 * CLEARANCE, rel=1e-6)


@pytest.mark.parametrize("load_N", [20.0, 100.0, 400.0])
def test_stiffness_is_what_the_force_does_when_the_shaft_is_moved(load_N: float) -> None:
    film = static_film(RADIUS, LENGTH)
    rest = resting(film, CLEARANCE, MU, SPEED, load_N)
    assert rest is not None

    def force(along: float, across: float) -> tuple[float, float]:
        """Of the film on a shaft there, by the law's own rows."""
        e = hypot(along, across) / CLEARANCE
        at = resting(film, CLEARANCE, MU, SPEED, _load(e))
        assert at is not None
        turned = at.attitude_rad
        a, c = along / (e * CLEARANCE), across / (e * CLEARANCE)
        pushed = _load(e)
        back, side = pushed * cos(turned), pushed * sin(turned)
        return -back * a - side * c, -back * c + side * a

    def _load(e: float) -> float:
        return film.load_per_viscous_speed(e, CLEARANCE) * MU * SPEED

    e, phi = rest.eccentricity, rest.attitude_rad
    x, y = e * CLEARANCE * cos(phi), e * CLEARANCE * sin(phi)
    step = 0.01 * CLEARANCE
    (k11, k12), (k21, k22) = rest.stiffness_N_m
    least = 0.03 * max(abs(k11), abs(k12), abs(k21), abs(k22))
    for (dx, dy), column in (((step, 0.0), (k11, k21)), ((0.0, step), (k12, k22))):
        more, less = force(x + dx, y + dy), force(x - dx, y - dy)
        found = [-(m - n) / (2 * step) for m, n in zip(more, less, strict=True)]
        assert found == pytest.approx(column, rel=0.03, abs=least)


def test_a_load_beyond_the_table_has_no_place() -> None:
    film = static_film(RADIUS, LENGTH)
    most = greatest_load_N(film, CLEARANCE, 0.03 * CLEARANCE, MU * SPEED)
    assert resting(film, CLEARANCE, MU, SPEED, 0.99 * most) is not None
    assert resting(film, CLEARANCE, MU, SPEED, 1.01 * most) is None
    assert greatest_load_N(film, CLEARANCE, CLEARANCE, MU * SPEED) == 0.0


def test_whirl_bounds_the_clearance_and_speed_narrows_it() -> None:
    machine = read_machine("bench")
    slow, fast = (stable_clearance_m(machine, rpm * pi / 30.0, 30.0) for rpm in (6000.0, 12000.0))
    assert fast < slow
    assert stable_clearance_m(machine, 12000 * pi / 30.0, 300.0) > fast


def test_a_machine_outside_the_guards_laws_says_why() -> None:
    machine = read_machine("bench")
    assert list(outside_laws(machine)) == []
    bearing = msgspec.structs.replace(machine.bearing, length_m=0.06)
    thin = msgspec.structs.replace(machine.lubricant, viscosity_at_40C_Pa_s=0.001)
    other = msgspec.structs.replace(machine, bearing=bearing, lubricant=thin)
    long, vortices = outside_laws(other)
    assert long.startswith("L/D = 1.50: ")
    assert vortices.startswith("Ta = 97.3: the film is laminar up to 41")


def test_groups_of_a_film() -> None:
    """Water at 20 degC in 0.1 mm around a shaft of 20 mm radius at 10 m/s: Re 1000."""
    found = film_domain(0.02, 1e-4, 1000.0, 1e-3, 500.0)
    assert found.reynolds == pytest.approx(1000.0)
    assert found.taylor == pytest.approx(1000.0 * 0.005**0.5)
    assert found.inertia == pytest.approx(5.0)
    assert len(found.warnings) == 2
    machine = read_machine("bench")
    assert fastest_film(machine, 160.0).taylor > TAYLOR_LIMIT
    assert fastest_film(machine, 50.0).warnings == ()


def test_the_range_of_the_film_and_where_it_stops_being_laminar() -> None:
    machine = read_machine("bench")
    low, high = film_range(machine)
    assert high == fastest_film(machine, 160.0)
    assert low.reynolds < 0.02 * high.reynolds
    limit_um = laminar_up_to_um(machine)
    assert fastest_film(machine, limit_um).taylor == pytest.approx(TAYLOR_LIMIT, rel=1e-9)
    wider = msgspec.structs.replace(machine.bearing, radial_clearance_offset_um=5.0)
    moved = msgspec.structs.replace(machine, bearing=wider)
    assert laminar_up_to_um(moved) == pytest.approx(limit_um - 5.0, rel=1e-9)


@pytest.mark.parametrize("load_N", [0.2, 0.5, 1.0, 2.0, 5.0])
def test_a_light_shaft_has_the_cross_stiffness_of_a_centred_one(load_N: float) -> None:
    rest = resting(static_film(RADIUS, LENGTH), CLEARANCE, MU, SPEED, load_N)
    assert rest is not None
    (k11, k12), (k21, k22) = rest.stiffness_N_m
    centred = load_N / (CLEARANCE - rest.film_m)
    assert (k12, -k21) == pytest.approx((centred, centred), rel=0.05)
    assert 0.0 < k11 < 0.1 * k12
    assert 0.0 < k22 < 0.1 * k12
