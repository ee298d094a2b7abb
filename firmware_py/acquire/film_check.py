"""Film, shaft position and power held against each other: what no reading shows alone.

The contact channel tells the true gap.  The short bearing (Ocvirk 1952, held to its finite length)
then says in which direction the shaft floats, what load that is, what the oil's shear costs, and
how far a rotating force moves the shaft, which tells unbalance.  Wear moves the shaft from there, a
side load turns it, starved oil seems to carry more than the rig's load and costs less, a rub costs
more.  Each feature is scaled so that sensor and build errors spread it alike at every speed and
clearance.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.orders import CONTACT, Orders
from firmware_py.acquire.windows import Window
from firmware_py.errors import OrbitdError
from firmware_py.machine import ContactCircuit, JournalBearing, Machine
from firmware_py.machine.contact import film_of, film_per_volt
from firmware_py.machine.lubricant import viscosity_Pa_s

CONTACT_LEAST_V: Final = 1e-3
"""How near to its ends the contact channel is read."""

POSITION_SCALE_M: Final = 5e-6
"""Scale of positions."""
SPREAD_SHARE: Final = 0.6
"""Standard deviation of an error over its bound: near the 1 / sqrt(3) of an even spread."""
LEAST_SHARE: Final = 0.02
"""Eccentricity ratios nearer to 0 or 1 count as that."""
LEAST_MOVE_M: Final = 1e-9

Floats = NDArray[np.float64]


def names() -> tuple[str, ...]:
    """Names of what :func:`film_check` returns, in its order."""
    return (
        "film_gap_over_position",
        "film_side_position",
        "film_power_excess",
        "film_log_load_N",
        "film_log_unbalance_kg_m",
        "film_log_unbalance_by_orbit_kg_m",
    )


class NoContactError(OrbitdError, ValueError):
    """The machine has no contact channel, on which the film's features rest."""


def circuit_of(machine: Machine) -> ContactCircuit:
    """The circuit of the contact channel.

    Raises
    ------
    NoContactError
        The machine has none.
    """
    if machine.contact is None:
        raise NoContactError(
            "contact: this machine has no contact circuit, and the film's features rest on it; "
            "describe it in [contact] of machine.toml, or use no classifier that needs it"
        )
    return machine.contact


def read_volt(contact: ContactCircuit, volt: Floats) -> Floats:
    """Voltage of the contact channel within what is read."""
    return np.clip(volt, CONTACT_LEAST_V, contact.circuit_V - CONTACT_LEAST_V)


def film_check(window: Window, orders: Orders, machine: Machine) -> Floats:
    """Gap beyond that of the position, position beside the attitude, power beyond the film's; logs,
    shape (6,).

    The first two stand in :data:`POSITION_SCALE_M`, the third in errors of the power; then
    ``log10`` of the load and of the unbalance by the contact channel, free of the probes' runout,
    and by the orbit.
    """
    bearing, contact = machine.bearing, circuit_of(machine)
    clearance, (x, y), speed = window.clearance_m, window.samples[:, :2].T, orders.speed_rad_s
    gap = np.minimum(film_of(contact, read_volt(contact, window.samples[:, 7])), 2 * clearance)
    ratio = float(_held(1.0 - gap.mean() / clearance))
    rest = 1.0 - ratio * ratio
    attitude = math.atan2(0.25 * math.pi * math.sqrt(rest), ratio)
    beside = float(x.mean()) * math.cos(attitude) + float(y.mean()) * math.sin(attitude)
    beyond = float(np.mean(gap + np.hypot(x, y))) - clearance
    shear_Pa = viscosity_Pa_s(machine.lubricant, window.oil_outlet_C) * speed
    carried = _carried_N(bearing, shear_Pa, clearance, ratio)
    load = carried * ratio / rest**2 * math.sqrt(16.0 * (1.0 - rest) + math.pi**2 * rest)
    moment_Nm = load * ratio * clearance * math.sin(attitude)
    viscous = _shear_W(bearing, shear_Pa, speed, clearance, gap) + 0.5 * moment_Nm * speed
    excess = window.shaft_power_W - viscous - machine.rotor.windage_W_s3 * speed**3
    inertia_N_m = machine.rotor.mass_at_bearing_kg * speed**2
    across, around = _moves_per_N(carried, clearance, ratio, inertia_N_m)
    swing = abs(orders.harmonics[CONTACT, 0]) * film_per_volt(
        contact, float(read_volt(contact, np.asarray(orders.mean[CONTACT])))
    )
    orbit = 0.5 * abs(across + 1j * around)
    moved = np.array([swing, orders.forward[0]]) + LEAST_MOVE_M
    unbalance = moved / np.array([abs(across), orbit]) / speed**2
    return np.array(
        [
            beyond / POSITION_SCALE_M,
            beside / POSITION_SCALE_M,
            excess / _power_spread_W(machine, clearance, viscous),
            math.log10(load),
            *np.log10(unbalance),
        ]
    )


def _power_spread_W(machine: Machine, clearance_m: float, viscous_W: float) -> float:
    """Standard deviation of the shaft power beside ``viscous_W``: of its reading, of the oil (batch
    and thermometer), of the clearance."""
    reading_W = SPREAD_SHARE * machine.rotor.shaft_power_error_W
    clearance = SPREAD_SHARE * machine.bearing.radial_clearance_error_um * 1e-6 / clearance_m
    return math.hypot(reading_W, _oil_spread(machine) * viscous_W, clearance * viscous_W)


def _oil_spread(machine: Machine) -> float:
    """Standard deviation of the viscosity as a share of it."""
    oil = machine.lubricant
    thermometer = oil.viscosity_slope_per_K * machine.readings.oil_outlet_error_C
    return SPREAD_SHARE * math.hypot(oil.viscosity_error_share, thermometer)


def _held(ratio: object) -> Floats:
    """Eccentricity ratios within what is told apart."""
    return np.clip(np.asarray(ratio, np.float64), LEAST_SHARE, 1.0 - LEAST_SHARE)


def _shear_W(
    bearing: JournalBearing, shear_Pa: float, speed_rad_s: float, clearance_m: float, gap_m: Floats
) -> float:
    """Petroff's shear at the eccentricities that ``gap_m`` runs through (Sommerfeld's ``1 / sqrt(1
    - e^2)``).

    The journal bears half of the moment of the load beside it (Hamrock, Schmid and Jacobson 2004,
    chapter 11).
    """
    size_m4 = bearing.journal_radius_m**3 * bearing.length_m
    petroff = 2 * math.pi * shear_Pa * speed_rad_s * size_m4 / clearance_m
    return petroff * float(np.mean(1.0 / np.sqrt(1.0 - _held(1.0 - gap_m / clearance_m) ** 2)))


def _carried_N(bearing: JournalBearing, shear_Pa: float, clearance_m: float, ratio: float) -> float:
    """``mu omega R L^3 / 4 c^2`` times the finite length's share of the load, fitted from below to
    Reynolds films."""
    radius_m, length_m = bearing.journal_radius_m, bearing.length_m
    square = ratio * ratio
    shape = 0.25 * (length_m / radius_m) ** 2
    finite = 1.0 / (1.0 + shape * (0.38 + square) / (1.0 - square))
    return finite * shear_Pa * radius_m * length_m**3 / (4.0 * clearance_m**2)


def _moves_per_N(
    carried_N: float, clearance_m: float, ratio: float, inertia_N_m: float
) -> tuple[complex, complex]:
    """How far a forward rotating force moves the shaft along its eccentricity and around: complex,
    m/N.

    Stiffness and damping of the short bearing in the directions of the eccentricity, on the
    effective mass times the squared speed, ``inertia_N_m`` (``(K + i omega C - m omega^2) z = F (1,
    -i)``; Childs 1993, chapter 3).
    """
    e, q = ratio, 1.0 - ratio * ratio
    unit = carried_N / clearance_m
    cross_damping = 8.0 * e / q**2
    rr = (
        unit * (8.0 * e / q**2 + 16.0 * e**3 / q**3 + 2j * math.pi * (1.0 + 2.0 * e * e) / q**2.5)
        - inertia_N_m
    )
    rt = unit * (math.pi / q**1.5 - 1j * cross_damping)
    tr = unit * (-math.pi / q**1.5 - 3.0 * math.pi * e * e / q**2.5 - 1j * cross_damping)
    tt = unit * (4.0 * e / q**2 + 2j * math.pi / q**1.5) - inertia_N_m
    whole = rr * tt - rt * tr
    return (tt + 1j * rt) / whole, (-1j * rr - tr) / whole
