"""Where the shaft runs in the film at rest, and what follows there: thickness, attitude, friction,
stiffness.

All of it is :class:`~firmware_py.machine.film.StaticFilm` read at one eccentricity.  The stiffness
is the derivative of its force (Lund 1966: ``F_i = -K_ij x_j``), axis 0 along the load, axis 1 at 90
degrees in the direction of rotation.  Damping does not follow from a film at rest.
"""

from __future__ import annotations

from bisect import bisect_right
from math import atan2, pi
from typing import Final, NamedTuple

from firmware_py.machine.film import KNOTS, StaticFilm, static_film
from firmware_py.machine.lubricant import ViscosityTable
from firmware_py.machine.schema import Machine

SPAN: Final = 8
"""Knots to either side over which the force is differentiated: 0.02 of eccentricity, across the
grain of the table."""

Matrix = tuple[tuple[float, float], tuple[float, float]]


class Resting(NamedTuple):
    """A shaft under a static load in the film.

    ``attitude_rad`` counts from the load in the direction of rotation; ``stiffness_N_m`` is
    ``K_ij``.
    """

    eccentricity: float
    attitude_rad: float
    film_m: float
    friction_W: float
    stiffness_N_m: Matrix


def sommerfeld(
    radius_m: float,
    length_m: float,
    clearance_m: float,
    viscosity_Pa_s: float,
    speed_rad_s: float,
    load_N: float,
) -> float:
    """Sommerfeld number ``S = mu N L D / W (R / c)^2``, ``N`` in revolutions per second."""
    ratio = radius_m / clearance_m
    turns = speed_rad_s / (2.0 * pi)
    return viscosity_Pa_s * turns * length_m * 2.0 * radius_m / load_N * ratio * ratio


def greatest_load_N(
    film: StaticFilm, clearance_m: float, thinnest_m: float, viscous_speed: float
) -> float:
    """What the film carries where it is ``thinnest_m``; ``viscous_speed`` is ``mu w`` in Pa."""
    if thinnest_m >= clearance_m:
        return 0.0
    eccentricity = 1.0 - thinnest_m / clearance_m
    return film.load_per_viscous_speed(eccentricity, clearance_m) * viscous_speed


def resting(
    film: StaticFilm, clearance_m: float, viscosity_Pa_s: float, speed_rad_s: float, load_N: float
) -> Resting | None:
    """The shaft at rest under ``load_N``; None where the film does not carry it."""
    per_m4 = viscosity_Pa_s * speed_rad_s / (clearance_m * clearance_m)
    k = bisect_right(film.load, load_N / per_m4)
    if k > KNOTS:
        return None
    low, high = film.load[k - 1], film.load[k]
    part = (load_N / per_m4 - low) / (high - low)

    def at(values: list[float]) -> float:
        return values[k - 1] + part * (values[k] - values[k - 1])

    eccentricity = at(film.eccentricity)
    sine, cosine = at(film.sine), at(film.cosine)
    friction = at(film.friction) * viscosity_Pa_s * speed_rad_s / clearance_m
    return Resting(
        eccentricity,
        atan2(sine, cosine),
        clearance_m * (1.0 - eccentricity),
        friction * speed_rad_s,
        _stiffness(film, k, per_m4 / clearance_m),
    )


def stable_clearance_m(machine: Machine, speed_rad_s: float, load_N: float) -> float:
    """Largest radial clearance, as the actuator tells it, in which the balanced rotor as drawn is
    stable, in the worse of the coldest and the hottest oil."""
    law = static_film(machine.bearing.journal_radius_m, machine.bearing.length_m)
    oil, law_of_oil = machine.lubricant, ViscosityTable(machine.lubricant)
    number_m = load_N / (machine.rotor.mass_at_bearing_kg * speed_rad_s * speed_rad_s)
    tied = number_m * number_m * load_N / speed_rad_s
    found = min(
        number_m / law.whirl_share(tied / law_of_oil.law(t))
        for t in (oil.inlet_min_C, oil.film_max_C)
    )
    return found - machine.bearing.radial_clearance_offset_um * 1e-6


def shaft_beyond_m(machine: Machine) -> float | None:
    """How far the shaft goes on behind the bearing, negative where the bearing lies outside it;
    None where its end is not given."""
    rotor = machine.rotor
    if rotor.shaft_end_to_cg_m is None or rotor.bearing_to_cg_m is None:
        return None
    return rotor.shaft_end_to_cg_m - rotor.bearing_to_cg_m - 0.5 * machine.bearing.length_m


def _stiffness(film: StaticFilm, knot: int, per_m4: float) -> Matrix:
    """The film pushes back along the eccentricity with ``W cos`` and across with ``W sin``.

    ``per_m4`` makes N/m of the table's force over eccentricity.
    """
    first, last = max(knot - SPAN, 0), min(knot + SPAN, KNOTS)
    step = film.eccentricity[last] - film.eccentricity[first]

    def force(k: int) -> tuple[float, float]:
        return film.load[k] * film.cosine[k], film.load[k] * film.sine[k]

    (back0, side0), (back1, side1) = force(first), force(last)
    back, side = force(knot)
    k_rr, k_tr = (back1 - back0) / step, -(side1 - side0) / step
    k_rt, k_tt = side / film.eccentricity[knot], back / film.eccentricity[knot]
    s, c = film.sine[knot], film.cosine[knot]
    # from along and across the eccentricity to along and across the load
    a, b = c * k_rr - s * k_tr, c * k_rt - s * k_tt
    d, e = s * k_rr + c * k_tr, s * k_rt + c * k_tt
    rows = ((a * c - b * s, a * s + b * c), (d * c - e * s, d * s + e * c))
    return tuple(  # type: ignore[return-value]
        tuple(per_m4 * value for value in row) for row in rows
    )
