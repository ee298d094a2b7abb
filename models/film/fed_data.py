"""Films with the rig's axial groove: training points in the four numbers that decide the film, and
its truth.

The groove's film is homogeneous of degree one in the effective squeeze velocity ``v_s`` and the
supply pressure ``p_s`` together: with the rates ``u = |v_s| / c`` and ``q = p_s c^2 / (mu R^2)``
(that is ``omega`` times the supply number ``p_s (c/R)^2 / (mu omega)``), force over ``mu R L^3 /
c^2 (u + q)`` depends on the eccentricity ratio from the groove, the direction of ``v_s`` and the
share ``s = q / (u + q)`` alone, and so does the flow out of both ends over ``2 R L c (u + q)``.
Temperature acts through the viscosity and needs no input of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.film.parallel import each
from sim_hil.film import FeedPatch, FilmForce, film_force

Floats = NDArray[np.float64]

GROOVE_WIDTH_RAD = np.radians(20.0)
GROOVE_LENGTH_SHARE = 0.8
"""The groove of rig ``bench``."""

VELOCITY_DRAWN, SUPPLY_DRAWN = 0.25, (0.005, 6.0)
"""Velocity over ``c omega``, and supply numbers ``p_s (c/R)^2 / (mu omega)``, of the drawn turning
journals."""


@dataclass(frozen=True)
class FedSamples:
    """``points`` ``(m, 4)``: eccentricity ratio (x toward the groove, y), and ``(1 - s)`` times the
    direction of ``v_s``; ``force`` ``(m, 2)`` over ``mu R L^3 / c^2 (u + q)`` in the same frame;
    ``side_flow`` ``(m,)``.
    """

    points: Floats
    force: Floats
    side_flow: Floats


def draw_fed(count: int, eccentricity_max: float, rng: np.random.Generator) -> Floats:
    """Points on one side of the groove, eccentricity denser toward the wall.

    One half has even directions and shares, the other those of journals that turn at ``omega``
    either way and move by up to :data:`VELOCITY_DRAWN` ``c omega``, their supply numbers even in
    the logarithm over :data:`SUPPLY_DRAWN`.
    """
    depth = np.sqrt(1.0 - eccentricity_max)
    eps = 1.0 - (1.0 - rng.uniform(0.0, 1.0, count) * (1.0 - depth)) ** 2
    angle, heading = rng.uniform(0.0, np.pi, count), rng.uniform(-np.pi, np.pi, count)
    e, way = (np.column_stack([np.cos(a), np.sin(a)]) for a in (angle, heading))
    e *= eps[:, None]
    sense = rng.choice([-0.5, 0.5], count)[:, None]
    turning = sense * np.column_stack([e[:, 1], -e[:, 0]])
    turning += VELOCITY_DRAWN * np.sqrt(rng.uniform(0.0, 1.0, count))[:, None] * way
    low, high = SUPPLY_DRAWN
    supply = low * (high / low) ** rng.uniform(0.0, 1.0, count)
    turning /= (np.hypot(*turning.T) + supply)[:, None]
    even = (1.0 - rng.uniform(0.0, 1.0, count))[:, None] * way
    return np.hstack([e, np.where((np.arange(count) % 2 == 0)[:, None], even, turning)])


def fed_film(state: Floats, grid: tuple[int, int]) -> FilmForce:
    """Reynolds film with ambient rupture and one groove at a state ``(11,)``
    (``fed_network.FED_STATE``)."""
    x, y, vx, vy, omega, c, mu, radius, length, supply, angle = (float(number) for number in state)
    groove = FeedPatch(
        "groove", angle, float(GROOVE_WIDTH_RAD), GROOVE_LENGTH_SHARE * length, supply
    )
    return film_force(
        [x, y],
        [vx, vy],
        radius_m=radius,
        length_m=length,
        clearance_m=c,
        viscosity_Pa_s=mu,
        speed_rad_s=omega,
        feed=[groove],
        grid=grid,
    )


def solve_fed(
    points: Floats,
    *,
    length_over_diameter: float,
    grid: tuple[int, int],
    title: str = "fed film solutions",
) -> FedSamples:
    """:func:`fed_film` at each point, with the groove at angle zero."""
    answers = each(partial(_solve, length_over_diameter, grid), points, title)
    return FedSamples(points, answers[:, :2], answers[:, 2])


def _solve(length_over_diameter: float, grid: tuple[int, int], point: Floats) -> Floats:
    """Dimensionless force and side flow at one point."""
    radius, c, mu, rate = 0.02, 6e-5, 0.01, 200.0
    length = 2.0 * radius * length_over_diameter
    x, y, wx, wy = point
    supply = max(0.0, 1.0 - float(np.hypot(wx, wy))) * rate * mu * (radius / c) ** 2
    film = fed_film(
        np.array(
            [x * c, y * c, wx * rate * c, wy * rate * c, 0.0, c, mu, radius, length, supply, 0.0]
        ),
        grid,
    )
    force = film.force_N * c**2 / (mu * radius * length**3 * rate)
    return np.array([*force, float(film.side_flow_m3_s) / (2.0 * radius * length * c * rate)])
