"""Film, shaft position and power held against each other: what no reading shows alone.

The contact channel tells the true gap.  The short bearing (Ocvirk 1952, held to its finite length)
then says in which direction the shaft floats, what load that is, what the oil's shear costs, and
how far a rotating force moves the shaft, which tells unbalance.  Wear moves the shaft from there, a
side load turns it, starved oil seems to carry more than the rig's load and costs less, a rub costs
more.  Each feature is scaled so that sensor and build errors spread it alike at every speed and
clearance.  Sizes, mass and oil are those of rig `bench`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.orders import CONTACT, Orders
from firmware_py.acquire.windows import Window
from firmware_py.machine import ContactCircuit
from firmware_py.machine.contact import film_of, film_per_volt

RADIUS_M: Final = 0.02
LENGTH_M: Final = 0.02
MASS_KG: Final = 1.74
VISCOSITY_PA_S: Final = 0.01
REFERENCE_C: Final = 40.0
VISCOSITY_PER_K: Final = 0.03
"""Journal, effective mass at the bearing, and the oil's law ``mu = mu_40 exp(-b (T - 40))``."""

CIRCUIT: Final = ContactCircuit(
    circuit_V=2.0, circuit_ohm=100e3, film_ohm_per_m=2e10, film_error_share=0.02
)
CONTACT_LEAST_V: Final = 1e-3
"""How near to its ends the contact channel is read."""

WINDAGE_W_S3: Final = 5e-9
"""Power of the disc in air over the cubed speed."""

POSITION_SCALE_M: Final = 5e-6
POWER_ERROR_W: Final = 3.0
OIL_SHARE: Final = 0.062
CLEARANCE_ERROR_M: Final = 1.2e-6
"""Scale of positions; standard deviations of the power's reading, of the oil (batch, thermometer),
of a clearance."""
LEAST_SHARE: Final = 0.02
"""Eccentricity ratios nearer to 0 or 1 count as that."""
LEAST_MOVE_M: Final = 1e-9

Floats = NDArray[np.float64]


def names() -> tuple[str, ...]:
    """Names of what :func:`film_check` returns, in its order."""
    return (
        "film_gap_over_position", "film_side_position", "film_power_excess", "film_log_load_N",
        "film_log_unbalance_kg_m", "film_log_unbalance_by_orbit_kg_m",
    )  # fmt: skip


def read_volt(volt: Floats) -> Floats:
    """Voltage of the contact channel within what is read."""
    return np.clip(volt, CONTACT_LEAST_V, CIRCUIT.circuit_V - CONTACT_LEAST_V)


def film_check(window: Window, orders: Orders) -> Floats:
    """Gap beyond that of the position, position beside the attitude, power beyond the film's; logs,
    shape (6,).

    The first two stand in :data:`POSITION_SCALE_M`, the third in errors of the power; then
    ``log10`` of the load and of the unbalance by the contact channel, free of the probes' runout,
    and by the orbit.
    """
    clearance, (x, y), speed = window.clearance_m, window.samples[:, :2].T, orders.speed_rad_s
    gap = np.minimum(film_of(CIRCUIT, read_volt(window.samples[:, 7])), 2.0 * clearance)
    ratio = float(_held(1.0 - gap.mean() / clearance))
    rest = 1.0 - ratio * ratio
    attitude = math.atan2(0.25 * math.pi * math.sqrt(rest), ratio)
    beside = float(x.mean()) * math.cos(attitude) + float(y.mean()) * math.sin(attitude)
    beyond = float(np.mean(gap + np.hypot(x, y))) - clearance
    shear_Pa = (
        VISCOSITY_PA_S * math.exp(-VISCOSITY_PER_K * (window.oil_outlet_C - REFERENCE_C)) * speed
    )
    carried = _carried_N(shear_Pa, clearance, ratio)
    load = carried * ratio / rest**2 * math.sqrt(16.0 * (1.0 - rest) + math.pi**2 * rest)
    moment_Nm = load * ratio * clearance * math.sin(attitude)
    viscous = _shear_W(shear_Pa, speed, clearance, gap) + 0.5 * moment_Nm * speed
    scale = math.hypot(POWER_ERROR_W, OIL_SHARE * viscous, CLEARANCE_ERROR_M / clearance * viscous)
    across, around = _moves_per_N(carried, clearance, ratio, speed)
    swing = abs(orders.harmonics[CONTACT, 0]) * film_per_volt(
        CIRCUIT, float(read_volt(orders.mean[CONTACT]))
    )
    orbit = 0.5 * abs(across + 1j * around)
    unbalance = (
        np.array([(swing + LEAST_MOVE_M) / abs(across), (orders.forward[0] + LEAST_MOVE_M) / orbit])
        / speed**2
    )
    return np.array([
        beyond / POSITION_SCALE_M, beside / POSITION_SCALE_M,
        (window.shaft_power_W - viscous - WINDAGE_W_S3 * speed**3) / scale, math.log10(load), *np.log10(unbalance),
    ])  # fmt: skip


def _held(ratio: object) -> Floats:
    """Eccentricity ratios within what is told apart."""
    return np.clip(np.asarray(ratio, np.float64), LEAST_SHARE, 1.0 - LEAST_SHARE)


def _shear_W(shear_Pa: float, speed_rad_s: float, clearance_m: float, gap_m: Floats) -> float:
    """Petroff's shear at the eccentricities that ``gap_m`` runs through (Sommerfeld's ``1 / sqrt(1
    - e^2)``).

    The journal bears half of the moment of the load beside it (Hamrock, Schmid and Jacobson 2004,
    chapter 11).
    """
    petroff = 2 * math.pi * shear_Pa * speed_rad_s * RADIUS_M**3 * LENGTH_M / clearance_m
    return petroff * float(np.mean(1.0 / np.sqrt(1.0 - _held(1.0 - gap_m / clearance_m) ** 2)))


def _carried_N(shear_Pa: float, clearance_m: float, ratio: float) -> float:
    """``mu omega R L^3 / 4 c^2`` times the finite length's share of the load, fitted from below to
    Reynolds films."""
    square = ratio * ratio
    shape = 0.25 * (LENGTH_M / RADIUS_M) ** 2
    finite = 1.0 / (1.0 + shape * (0.38 + square) / (1.0 - square))
    return finite * shear_Pa * RADIUS_M * LENGTH_M**3 / (4.0 * clearance_m**2)


def _moves_per_N(
    carried_N: float, clearance_m: float, ratio: float, speed_rad_s: float
) -> tuple[complex, complex]:
    """How far a forward rotating force moves the shaft along its eccentricity and around: complex,
    m/N.

    Stiffness and damping of the short bearing in the directions of the eccentricity, on the
    effective mass (``(K + i omega C - m omega^2) z = F (1, -i)``; Childs 1993, chapter 3).
    """
    e, q = ratio, 1.0 - ratio * ratio
    unit, inertia = carried_N / clearance_m, MASS_KG * speed_rad_s**2
    cross_damping = 8.0 * e / q**2
    rr = (
        unit * (8.0 * e / q**2 + 16.0 * e**3 / q**3 + 2j * math.pi * (1.0 + 2.0 * e * e) / q**2.5)
        - inertia
    )
    rt = unit * (math.pi / q**1.5 - 1j * cross_damping)
    tr = unit * (-math.pi / q**1.5 - 3.0 * math.pi * e * e / q**2.5 - 1j * cross_damping)
    tt = unit * (4.0 * e / q**2 + 2j * math.pi / q**1.5) - inertia
    whole = rr * tt - rt * tr
    return (tt + 1j * rt) / whole, (-1j * rr - tr) / whole
