"""What the film surrogate says about a rigid rotor on its bearing: equilibrium, stiffness,
response, stability.

All functions are batched: ``n`` operating points at once, one or a few calls of the ONNX surrogate
each. The rotor is the bearing's effective mass under a static load along -y (rigid rotor pivoting
at its coupling; gyroscopic terms, small here, are left out).

Sources: linearised film and unbalance response, Childs 1993, ch. 3; short-bearing starting point,
Ocvirk 1953.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.session import Session

ECCENTRICITY_MAX: Final = 0.96
ITERATIONS: Final = 12
FORCE_TOLERANCE: Final = 1e-4

_STEP: Final = 1e-4
_STENCIL: Final = np.array([[0, 0, 0, 0], *np.eye(4), *-np.eye(4)])
_ANGLES: Final = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Points:
    """``n`` operating points, each attribute of shape (n,), SI."""

    speed_rad_s: Floats
    clearance_m: Floats
    viscosity_Pa_s: Floats
    load_N: Floats

    def __getitem__(self, rows: NDArray[np.bool_] | slice) -> Points:
        return Points(
            self.speed_rad_s[rows],
            self.clearance_m[rows],
            self.viscosity_Pa_s[rows],
            self.load_N[rows],
        )


@dataclass(frozen=True, slots=True)
class Steady:
    """Equilibrium and small motion about it.

    Attributes
    ----------
    position_m
        Shape (n, 2).
    converged
        Shape (n,): the film carries the load at that position, inside :data:`ECCENTRICITY_MAX`.
    power_W
        Shape (n,): friction torque times speed.
    response_m_per_kg_m
        Shape (n, 2), complex: x and y at 1X per unit of unbalance.
    damping_ratio
        Shape (n,): of the least damped mode; below zero the shaft whirls.
    orbit_power_W_per_kg2_m2
        Shape (n,): what the 1X orbit dissipates in the film, per squared unbalance.
    stiffness, damping
        Shapes (n, 2, 2): see :meth:`Film.slopes`.
    """

    position_m: Floats
    converged: NDArray[np.bool_]
    power_W: Floats
    response_m_per_kg_m: NDArray[np.complex128]
    damping_ratio: Floats
    orbit_power_W_per_kg2_m2: Floats
    stiffness: Floats
    damping: Floats

    def __getitem__(self, rows: slice) -> Steady:
        return Steady(*(getattr(self, f.name)[rows] for f in fields(self)))

    def min_film_m(self, clearance_m: Floats, unbalance_kg_m: Floats) -> Floats:
        """Smallest film over one turn, shape (n,)."""
        motion = np.real(
            unbalance_kg_m[:, None, None]
            * self.response_m_per_kg_m[:, :, None]
            * np.exp(1j * _ANGLES)
        )
        reach = np.hypot(*np.moveaxis(self.position_m[:, :, None] + motion, 1, 0)).max(axis=1)
        return np.asarray(clearance_m - reach)


class Film:
    """The film surrogate for one bearing and rotor.

    Parameters
    ----------
    session
        Contract of ``surrogate.onnx``: state (n, 9) to force (n, 2), friction torque and side flow
        (n, 1).
    radius_m, length_m
        Of the bearing.
    mass_kg
        Effective mass at the bearing.
    """

    def __init__(self, session: Session, radius_m: float, length_m: float, mass_kg: float) -> None:
        self._session = session
        self._radius_m = radius_m
        self._length_m = length_m
        self.mass_kg = mass_kg
        eps = np.linspace(0.01, ECCENTRICITY_MAX, 200)
        self._start_eps = eps
        self._start_load = (
            eps / (1 - eps**2) ** 2 * np.sqrt(16 * eps**2 + np.pi**2 * (1 - eps**2)) / 4
        )

    def force(self, points: Points, state: Floats) -> tuple[Floats, Floats]:
        """Film force (n, 2) in N on the journal and friction torque (n,) in N m; ``state`` (n, 4)
        x, y, vx, vy."""
        n = len(state)
        rows = np.column_stack(
            [
                state,
                points.speed_rad_s,
                points.clearance_m,
                points.viscosity_Pa_s,
                np.full(n, self._radius_m),
                np.full(n, self._length_m),
            ]
        )
        answer = self._session.run(rows)
        return answer["force"], answer["friction_torque"][:, 0]

    def equilibrium(
        self, points: Points, start_m: Floats | None = None
    ) -> tuple[Floats, NDArray[np.bool_], Floats]:
        """Position (n, 2) where the film carries the load, whether it was found, and the friction
        torque (n,).

        Newton's method from ``start_m`` (n, 2), or from the short bearing's position, with a
        bounded step; Jacobian by differences.
        """
        ratio = (
            self._start(points)
            if start_m is None
            else _inside(start_m / points.clearance_m[:, None])
        )
        found = np.zeros(len(ratio), np.bool_)
        torque = np.zeros(len(ratio))
        target = np.column_stack([np.zeros_like(points.load_N), points.load_N])
        for _ in range(ITERATIONS):
            todo = ~found
            ahead = _STEP * np.array([[0, 0], [1, 0], [0, 1]])
            force, friction = self._spread(points[todo], ratio[todo][:, None, :] + ahead, 0.0)
            rest = force[:, 0] - target[todo]
            torque[todo] = friction[:, 0]
            small = np.hypot(*rest.T) <= FORCE_TOLERANCE * points.load_N[todo]
            slope = np.moveaxis(force[:, 1:] - force[:, :1], 1, 2) / _STEP
            step = -np.linalg.solve(slope, rest[:, :, None])[:, :, 0]
            step *= np.minimum(1.0, 0.2 / np.maximum(np.hypot(*step.T), 1e-12))[:, None]
            ratio[todo] = _inside(ratio[todo] + np.where(small[:, None], 0.0, step))
            found[todo] = small
            if found.all():
                break
        return ratio * points.clearance_m[:, None], found, torque

    def steady(self, points: Points) -> Steady:
        """Equilibrium, friction power, unbalance response and stability of every point."""
        return self.about(points, *self.equilibrium(points))

    def about(
        self, points: Points, position: Floats, found: NDArray[np.bool_], torque: Floats
    ) -> Steady:
        """Small motion about what :meth:`equilibrium` has found."""
        stiffness, damping = self.slopes(points, position)
        speed, mass = points.speed_rad_s, self.mass_kg
        inertia = (mass * speed**2)[:, None, None] * np.eye(2)
        dynamic = stiffness - inertia + 1j * speed[:, None, None] * damping
        rotating = speed[:, None, None] ** 2 * np.array([[1.0], [-1.0j]])
        response = np.linalg.solve(dynamic, rotating)[:, :, 0]
        work = np.einsum("ni,nij,nj->n", response.conj(), damping, response).real
        return Steady(
            position,
            found,
            torque * speed,
            response,
            _damping_ratio(stiffness, damping, mass),
            0.5 * speed**2 * work,
            stiffness,
            damping,
        )

    def shear_torque(self, points: Points, position: Floats) -> Floats:
        """Friction torque (n,) of a film without pressure at ``position`` (n, 2): Petroff's, with
        the eccentricity."""
        eps = np.minimum(np.hypot(*position.T) / points.clearance_m, ECCENTRICITY_MAX)
        area = 2.0 * np.pi * self._radius_m**3 * self._length_m
        return np.asarray(
            area
            * points.viscosity_Pa_s
            * points.speed_rad_s
            / (points.clearance_m * np.sqrt(1.0 - eps**2))
        )

    def slopes(
        self, points: Points, position: Floats, velocity: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Stiffness and damping matrices, shape (n, 2, 2): ``K = -dF/dx``, ``C = -dF/dv``; at rest
        or ``velocity``."""
        unit = points.clearance_m[:, None]
        moving = (
            np.zeros_like(position)
            if velocity is None
            else velocity / (unit * points.speed_rad_s[:, None])
        )
        ratio = np.concatenate([position / unit, moving], axis=1)[:, None, :] + _STEP * _STENCIL
        force, _ = self._spread(points, ratio[:, :, :2], ratio[:, :, 2:])
        slopes = -np.moveaxis(force[:, 1:5] - force[:, 5:9], 1, 2) / (2 * _STEP)
        per_m = 1.0 / points.clearance_m[:, None, None]
        return slopes[:, :, :2] * per_m, slopes[:, :, 2:] * per_m / points.speed_rad_s[
            :, None, None
        ]

    def _spread(
        self, points: Points, ratio: Floats, velocity: Floats | float
    ) -> tuple[Floats, Floats]:
        """Force (n, k, 2) and torque (n, k) at ``k`` positions (in clearances) and velocities (in c
        omega) each."""
        n, k, _ = ratio.shape
        repeated = Points(
            *(
                np.repeat(column, k)
                for column in (
                    points.speed_rad_s,
                    points.clearance_m,
                    points.viscosity_Pa_s,
                    points.load_N,
                )
            )
        )
        speed = np.broadcast_to(np.asarray(velocity, np.float64), ratio.shape).reshape(n * k, 2)
        state = np.concatenate(
            [ratio.reshape(n * k, 2), speed * repeated.speed_rad_s[:, None]], axis=1
        )
        force, torque = self.force(repeated, state * repeated.clearance_m[:, None])
        return force.reshape(n, k, 2), torque.reshape(n, k)

    def _start(self, points: Points) -> Floats:
        """The short bearing's equilibrium in clearances, shape (n, 2)."""
        unit = (
            points.viscosity_Pa_s
            * points.speed_rad_s
            * self._radius_m
            * self._length_m**3
            / points.clearance_m**2
        )
        eps = np.interp(points.load_N / unit, self._start_load, self._start_eps)
        attitude = np.arctan2(np.pi * np.sqrt(1 - eps**2), 4 * eps)
        return np.column_stack([eps * np.sin(attitude), -eps * np.cos(attitude)])


def _inside(ratio: Floats) -> Floats:
    """Positions drawn back to :data:`ECCENTRICITY_MAX`."""
    eps = np.hypot(*ratio.T)
    return np.asarray(ratio * np.minimum(1.0, ECCENTRICITY_MAX / np.maximum(eps, 1e-12))[:, None])


def _damping_ratio(stiffness: Floats, damping: Floats, mass_kg: float) -> Floats:
    """Smallest ``-Re(s) / |s|`` over the four eigenvalues of ``M s^2 + C s + K``, shape (n,)."""
    n = len(stiffness)
    state = np.zeros((n, 4, 4))
    state[:, :2, 2:] = np.eye(2)
    state[:, 2:, :2] = -stiffness / mass_kg
    state[:, 2:, 2:] = -damping / mass_kg
    values = np.linalg.eigvals(state)
    return np.asarray((-values.real / np.maximum(np.abs(values), 1e-9)).min(axis=1))
