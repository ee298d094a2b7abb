"""The predictor's time simulation, on demand: the rotor's mass on the surrogate film, candidate by
candidate at once.

For what the linear answer cannot say: how large whirl grows, how an orbit bends near the wall.  It
takes a fraction of a second, so the brain's cycle never runs it.

The film is far stiffer than any affordable explicit step (whose answer is silently wrong, not
divergent): the step is linearly implicit in position and velocity, ``(M - theta h C - theta^2 h^2
K) dv = h (F + theta h K v)`` with the film's slopes ``K = dF/dx``, ``C = dF/dv`` (Rosenbrock's
method; Hairer and Wanner, Solving ODEs II, IV.7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.film import Film, Points

Floats = NDArray[np.float64]

THETA: Final = 0.55
"""Half is centred; a little more damps the stiffest motion."""
STEPS_A_TURN: Final = 200
RENEW_STEPS: Final = 4
"""The film's slopes are held over this many steps."""


@dataclass(frozen=True, slots=True)
class Motion:
    """``position_m`` (steps, n, 2) and ``clearance_m`` (n,)."""

    position_m: Floats
    clearance_m: Floats

    def peak_to_peak_m(self, turns: int, steps_a_turn: int = STEPS_A_TURN) -> Floats:
        """Larger peak-to-peak of the two axes over the last ``turns``, shape (n,)."""
        return np.asarray(np.ptp(self.position_m[-turns * steps_a_turn :], axis=0).max(axis=1))

    def min_film_m(self, turns: int, steps_a_turn: int = STEPS_A_TURN) -> Floats:
        """Smallest film over the last ``turns``, shape (n,)."""
        last = self.position_m[-turns * steps_a_turn :]
        return np.asarray(self.clearance_m - np.hypot(last[..., 0], last[..., 1]).max(axis=0))


def simulate(
    film: Film,
    points: Points,
    unbalance_kg_m: Floats,
    turns: int,
    *,
    steps_a_turn: int = STEPS_A_TURN,
) -> Motion:
    """Follow ``n`` operating points for ``turns`` from their equilibria.

    Parameters
    ----------
    unbalance_kg_m
        Shape (n,).
    """
    position, _, _ = film.equilibrium(points)
    velocity = np.zeros_like(position)
    step_s = 2.0 * np.pi / steps_a_turn / points.speed_rad_s[:, None]
    centrifugal = (unbalance_kg_m * points.speed_rad_s**2)[:, None]
    weight = np.column_stack([np.zeros_like(points.load_N), -points.load_N])
    kept = np.empty((turns * steps_a_turn, *position.shape))
    for k in range(len(kept)):
        if k % RENEW_STEPS == 0:
            stiffness, damping = film.slopes(points, position, velocity)
            h = step_s[:, :, None]
            matrix = film.mass_kg * np.eye(2) + THETA * h * damping + (THETA * h) ** 2 * stiffness
        angle = 2.0 * np.pi * (k + 0.5) / steps_a_turn
        force, _ = film.force(points, np.concatenate([position, velocity], axis=1))
        total = force + weight + centrifugal * [np.cos(angle), np.sin(angle)]
        pulled = total - THETA * step_s * np.einsum("nij,nj->ni", stiffness, velocity)
        change = step_s * np.linalg.solve(matrix, pulled[:, :, None])[:, :, 0]
        position = position + step_s * (velocity + THETA * change)
        velocity = velocity + change
        kept[k] = position
    return Motion(kept, points.clearance_m)
