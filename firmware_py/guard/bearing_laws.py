"""Closed forms of the plain journal bearing that the guard stands on: load, eccentricity, whirl.

Radius ``R``, length ``L``, ``lam = L/2R``, radial clearance ``c``, eccentricity ratio ``eps``.  Only + - * / and
sqrt in a fixed order: the same bits on every machine.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Final

LENGTH_OVER_DIAMETER_MAX: Final = 1.0
"""The fits below are verified up to here."""

CLEARANCE_ERROR_M: Final = 2e-6
"""A built bearing differs from its drawing by this much (radial)."""

TEMPERATURE_ERROR_C: Final = 1.0


def leakage_factor(eccentricity: float, length_over_diameter: float) -> float:
    """Finite-length load as a share of the short bearing's, fitted from below to the Reynolds solution."""
    lam2 = length_over_diameter * length_over_diameter
    e2 = eccentricity * eccentricity
    return 1.0 / (1.0 + lam2 * (0.38 + e2) / (1.0 - e2))


def load_per_viscous_speed(eccentricity: float, clearance_m: float, radius_m: float, length_m: float) -> float:
    """Static load carried at ``eccentricity`` per viscosity and speed, ``W / (mu w)`` in m^2.

    Ocvirk's short bearing with pi-film, ``R L^3 eps sqrt(16 eps^2 + pi^2 (1 - eps^2)) / (4 c^2 (1 - eps^2)^2)``
    (Dubois & Ocvirk, NACA Report 1157, 1953), times :func:`leakage_factor`.
    """
    e2 = eccentricity * eccentricity
    short = (radius_m * length_m * length_m * length_m * eccentricity * sqrt(16.0 * e2 + pi * pi * (1.0 - e2))
             / (4.0 * clearance_m * clearance_m * (1.0 - e2) * (1.0 - e2)))
    return short * leakage_factor(eccentricity, 0.5 * length_m / radius_m)


def eccentricity_above(need_m2: float, clearance_m: float, radius_m: float, length_m: float) -> float:
    """No smaller than the eccentricity that carries ``W / (mu w) = need_m2``: load rises faster than in proportion."""
    slope = (pi * radius_m * length_m * length_m * length_m / (4.0 * clearance_m * clearance_m)
             * leakage_factor(0.0, 0.5 * length_m / radius_m))
    return need_m2 / slope


def whirl_number(eccentricity: float, length_over_diameter: float) -> float:
    """Smallest ``w sqrt(c m / W)`` at which a rigid rotor whirls at this eccentricity or any smaller one.

    Fitted from below to the Reynolds film (:func:`sim_hil.film.equilibrium`; short bearing: Lund 1966, Holmes 1960);
    the long bearing is the least stable at small eccentricity, every bearing at about 0.4.
    """
    return min(2.66, 2.765 - 0.31 * length_over_diameter, max(2.5, 2.73 - 0.48 * eccentricity))
