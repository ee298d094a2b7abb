"""Films with the rig's axial groove: training points in the four numbers that decide the force, and its truth.

The groove's film is homogeneous of degree one in the effective squeeze velocity ``v_s`` and the supply pressure
``p_s`` together: with the rates ``u = |v_s| / c`` and ``q = p_s c^2 / (mu R^2)`` (that is ``omega`` times the
supply number ``p_s (c/R)^2 / (mu omega)``), force over ``mu R L^3 / c^2 (u + q)`` depends on the eccentricity
ratio from the groove, the direction of ``v_s`` and the share ``s = q / (u + q)`` alone.  Temperature acts through
the viscosity and needs no input of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_hil.film import Feed, FilmForce, film_force

Floats = NDArray[np.float64]

GROOVE_WIDTH_RAD = np.radians(20.0)
GROOVE_LENGTH_SHARE = 0.8
"""The groove of rig ``bench``."""


@dataclass(frozen=True)
class FedSamples:
    """``points`` ``(m, 4)``: eccentricity ratio (x toward the groove, y), and ``(1 - s)`` times the direction of
    ``v_s``; ``force`` ``(m, 2)`` over ``mu R L^3 / c^2 (u + q)`` in the same frame.
    """

    points: Floats
    force: Floats


def draw_fed(count: int, eccentricity_max: float, rng: np.random.Generator) -> Floats:
    """Points on one side of the groove: eccentricity denser toward the wall, directions and shares even."""
    depth = np.sqrt(1.0 - eccentricity_max)
    eps = 1.0 - (1.0 - rng.uniform(0.0, 1.0, count) * (1.0 - depth)) ** 2
    angle, heading = rng.uniform(0.0, np.pi, count), rng.uniform(-np.pi, np.pi, count)
    squeeze = 1.0 - rng.uniform(0.0, 1.0, count)
    columns = (eps * np.cos(angle), eps * np.sin(angle), squeeze * np.cos(heading), squeeze * np.sin(heading))
    return np.column_stack(columns)


def fed_film(state: Floats, grid: tuple[int, int]) -> FilmForce:
    """Reynolds film with ambient rupture and one groove at a state ``(11,)`` (``film_fed_network.FED_STATE``)."""
    x, y, vx, vy, omega, c, mu, radius, length, supply, angle = (float(number) for number in state)
    groove = Feed("groove", angle, float(GROOVE_WIDTH_RAD), GROOVE_LENGTH_SHARE * length, supply)
    return film_force(
        [x, y], [vx, vy], radius_m=radius, length_m=length, clearance_m=c, viscosity_Pa_s=mu, speed_rad_s=omega,
        feed=[groove], grid=grid,
    )  # fmt: skip


def solve_fed(
    points: Floats,
    *,
    length_over_diameter: float,
    grid: tuple[int, int],
    progress: Callable[[int], None] | None = None,
) -> FedSamples:
    """:func:`fed_film` at each point, with the groove at angle zero."""
    radius, c, mu, rate = 0.02, 6e-5, 0.01, 200.0
    length = 2.0 * radius * length_over_diameter
    force = np.empty((len(points), 2))
    for i, (x, y, wx, wy) in enumerate(points):
        supply = max(0.0, 1.0 - float(np.hypot(wx, wy))) * rate * mu * (radius / c) ** 2
        state = np.array([x * c, y * c, wx * rate * c, wy * rate * c, 0.0, c, mu, radius, length, supply, 0.0])
        force[i] = fed_film(state, grid).force_N * c**2 / (mu * radius * length**3 * rate)
        if progress is not None:
            progress(i + 1)
    return FedSamples(points, force)
