"""Samples of the converged film in the two numbers that decide it: the truth the surrogate
learns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.film.parallel import each
from sim_hil.film.force import film_force

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FilmSamples:
    """Eccentricity ratio ``(a, b)`` in the frame of the squeeze velocity, ``(m, 2)``, and
    dimensionless answers.

    ``force`` (along, across) is ``F c^3 / (mu R L^3 |v_s|)``, ``side_flow`` is ``Q / (2 R L
    |v_s|)``.
    """

    ab: Floats
    force: Floats
    side_flow: Floats


def draw_points(count: int, eccentricity_max: float, rng: np.random.Generator) -> Floats:
    """Points ``(a, b >= 0)`` of the half disk, denser toward the wall where the film is steep.

    The share of points beyond ``eps`` falls like ``sqrt(1 - eps)``; every eighth point is pure
    squeeze (``b = 0``), toward or away from the wall.
    """
    u = rng.uniform(0.0, 1.0, count)
    depth = np.sqrt(1.0 - eccentricity_max)
    eps = 1.0 - (1.0 - u * (1.0 - depth)) ** 2
    angle = rng.uniform(0.0, np.pi, count)
    angle[::8] = np.pi * rng.integers(0, 2, angle[::8].size)
    return np.stack([eps * np.cos(angle), eps * np.abs(np.sin(angle))], axis=1)


def solve_points(ab: Floats, *, length_over_diameter: float, grid: tuple[int, int]) -> FilmSamples:
    """Reynolds film (periodic, ambient rupture) at each point, by :func:`sim_hil.film_force`.

    Parameters
    ----------
    ab
        Points of the disk, ``(m, 2)``.
    grid
        Nodes around and along.
    """
    answers = each(partial(_solve, length_over_diameter, grid), ab, "film solutions")
    return FilmSamples(ab, answers[:, :2], answers[:, 2])


def _solve(length_over_diameter: float, grid: tuple[int, int], point: Floats) -> Floats:
    """Dimensionless force and side flow at one point."""
    radius, clearance, viscosity, speed = 0.02, 6e-5, 0.01, 0.01
    length = 2.0 * radius * length_over_diameter
    film = film_force(
        point * clearance,
        [speed, 0.0],
        radius_m=radius,
        length_m=length,
        clearance_m=clearance,
        viscosity_Pa_s=viscosity,
        speed_rad_s=0.0,
        grid=grid,
    )
    force = film.force_N * clearance**3 / (viscosity * radius * length**3 * speed)
    return np.array([*force, float(film.side_flow_m3_s) / (2.0 * radius * length * speed)])
