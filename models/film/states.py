"""Unseen films that judge a film model: states of real bearings in SI, each solved by the Reynolds
equation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.film.parallel import each
from sim_hil.film import film_force

Floats = NDArray[np.float64]

STATE = ("x_m", "y_m", "vx_m_s", "vy_m_s", "omega_rad_s", "c_m", "mu_Pa_s", "R_m", "L_m")
"""Columns of a state."""

ECCENTRICITY_JUDGED = 0.95
VELOCITY_JUDGED = 0.25
"""Of ``c omega``; every eighth state is pure squeeze instead, at any direction of the velocity."""


@dataclass(frozen=True)
class JudgedFilms:
    """``state`` ``(m, 9)``, and what the Reynolds film answers: force ``(m, 2)``, torque and side
    flow ``(m,)``."""

    state: Floats
    force: Floats
    torque: Floats
    side_flow: Floats

    @property
    def ab(self) -> Floats:
        """Eccentricity ratio in the frame of the squeeze velocity, ``(m, 2)``."""
        along = squeeze_velocity(self.state)
        along /= np.hypot(*along.T)[:, None]
        x, y = (self.state[:, :2] / self.state[:, 5:6]).T
        return np.column_stack(
            [x * along[:, 0] + y * along[:, 1], y * along[:, 0] - x * along[:, 1]]
        )


def draw_states(
    count: int,
    length_over_diameter: float,
    rng: np.random.Generator,
    eccentricity_max: float = ECCENTRICITY_JUDGED,
) -> Floats:
    """States ``(count, 9)``: either sense, eccentricities denser toward the wall, velocities to
    0.25 c omega."""
    depth = np.sqrt(1.0 - eccentricity_max)
    eps = 1.0 - (1.0 - rng.uniform(0.0, 1.0, count) * (1.0 - depth)) ** 2
    c, radius = rng.uniform(4e-5, 1.6e-4, count), rng.uniform(0.01, 0.05, count)
    omega = rng.uniform(100.0, 1300.0, count) * rng.choice([-1.0, 1.0], count)
    speed = c * np.abs(omega) * VELOCITY_JUDGED * np.sqrt(rng.uniform(0.0, 1.0, count))
    omega[::8] = 0.0
    angle, heading = rng.uniform(-np.pi, np.pi, count), rng.uniform(-np.pi, np.pi, count)
    return np.column_stack(
        [
            eps * c * np.cos(angle),
            eps * c * np.sin(angle),
            speed * np.cos(heading),
            speed * np.sin(heading),
            omega,
            c,
            rng.uniform(1e-3, 0.03, count),
            radius,
            2.0 * radius * length_over_diameter,
        ]
    )


def solve_states(state: Floats, grid: tuple[int, int]) -> JudgedFilms:
    """The film (periodic, ambient rupture) of each state, by :func:`sim_hil.film_force`."""
    answers = each(partial(_solve, grid), state, "unseen films")
    return JudgedFilms(state, answers[:, :2], answers[:, 2], answers[:, 3])


def _solve(grid: tuple[int, int], row: Floats) -> Floats:
    """Force, torque and side flow of one state."""
    film = film_force(
        row[:2],
        row[2:4],
        speed_rad_s=float(row[4]),
        clearance_m=float(row[5]),
        viscosity_Pa_s=float(row[6]),
        radius_m=float(row[7]),
        length_m=float(row[8]),
        grid=grid,
    )
    return np.array([*film.force_N, float(film.friction_torque_N_m), float(film.side_flow_m3_s)])


def squeeze_velocity(state: Floats) -> Floats:
    """Effective squeeze velocity ``v - (omega / 2) z x e`` of each state, m/s, ``(m, 2)``."""
    turned = np.column_stack([state[:, 1], -state[:, 0]])
    return np.asarray(state[:, 2:4] + 0.5 * state[:, 4:5] * turned)
