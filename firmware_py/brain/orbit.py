"""Orbits too large for the linear film: mean position, first and second order, and power by
harmonic balance.

The journal moves on ``e + s + Re(A1 exp(i phi) + A2 exp(2 i phi))``.  The mean, first and second
order of the film force over one turn must balance load, inertia and unbalance; Broyden's method
finds ``s`` and ``A`` from the linear film's slopes on.  The second order, small itself, bends the
first by a tenth where the orbit fills half the gap.

Sources: harmonic balance (Krylov and Bogoliubov); Broyden 1965, first method on the inverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.film import ECCENTRICITY_MAX, Film, Floats, Points, Steady

Complexes = NDArray[np.complex128]

ORDERS: Final = 2
PHASES: Final = 12
FINE_PHASES: Final = 48
ITERATIONS: Final = 14
TOLERANCE: Final = 1e-3
"""Of the load; smaller orbits are the linear ones."""
REACH_MAX: Final = 0.9
"""Eccentricity ratio up to which the first guess may reach."""
STEP_MAX: Final = 0.15
"""Largest change in one pass, in clearances."""


def _turning(phases: int) -> Complexes:
    """``exp(i k phi)``, shape (ORDERS, phases)."""
    return np.asarray(
        np.exp(2j * np.pi * np.outer(np.arange(1, ORDERS + 1), np.arange(phases)) / phases)
    )


_TURN: Final = _turning(PHASES)
_FINE_TURN: Final = _turning(FINE_PHASES)


@dataclass(frozen=True, slots=True)
class Orbit:
    """``n`` orbits under unbalance.

    Attributes
    ----------
    shift_m
        Shape (n, 2): mean position less the equilibrium.
    orders_m
        Shape (n, ORDERS, 2), complex: x and y, phase from the unbalance.
    power_W
        Shape (n,): friction over the turn and what the motion dissipates, less the friction at
        rest.
    """

    shift_m: Floats
    orders_m: Complexes
    power_W: Floats

    @property
    def first_m(self) -> Complexes:
        """First order, shape (n, 2)."""
        return self.orders_m[:, 0]

    def path_m(self, turn: Complexes = _TURN) -> Floats:
        """Way about the equilibrium, shape (n, phases, 2)."""
        return np.asarray(
            self.shift_m[:, None] + np.real(np.einsum("nhi,hk->nki", self.orders_m, turn))
        )

    def swing_m(self, directions: Floats) -> Floats:
        """Largest peak-to-peak along unit vectors (m, 2), shape (n,)."""
        return np.asarray(np.ptp(self.path_m(_FINE_TURN) @ directions.T, axis=1).max(axis=1))

    def min_film_m(self, points: Points, steady: Steady) -> Floats:
        """Smallest film over one turn, shape (n,)."""
        where = steady.position_m[:, None] + self.path_m(_FINE_TURN)
        return np.asarray(points.clearance_m - np.hypot(where[..., 0], where[..., 1]).max(axis=1))


def balanced(film: Film, points: Points, steady: Steady, unbalance_kg_m: Floats) -> Orbit:
    """Orbits of ``n`` operating points under ``unbalance_kg_m`` (n,), from the linear answer on:
    the best pass.

    A pass that leaves more than the best one teaches the Jacobian and is taken back.
    """
    n, speed, unit = len(points.load_N), points.speed_rad_s, points.clearance_m[:, None]
    inertia = film.mass_kg * (speed[:, None] * np.arange(1, ORDERS + 1)) ** 2
    given = np.zeros((n, ORDERS + 1, 2), np.complex128)
    given[:, 0, 1] = -points.load_N
    given[:, 1] = (unbalance_kg_m * speed**2)[:, None] * np.array([1.0, -1.0j])
    every = Points(
        *(
            np.repeat(column, PHASES)
            for column in (speed, points.clearance_m, points.viscosity_Pa_s, points.load_N)
        )
    )
    inverse = _linear_inverse(steady, speed, inertia)
    best = step = np.zeros((n, 2 + 4 * ORDERS))
    least, rest = np.full(n, np.inf), np.zeros_like(best)
    power = np.zeros(n)
    tried = _first_guess(points, steady, unbalance_kg_m)
    for _ in range(ITERATIONS):
        at = _complex(tried)
        force, dear = _turn(film, every, steady, at, speed)
        left = given.copy()
        left[:, 0] += force.mean(axis=1)
        left[:, 1:] += (
            inertia[:, :, None] * at[:, 1:]
            + 2.0 * np.einsum("nki,hk->nhi", force, _TURN.conj()) / PHASES
        )
        now = _real(left)
        inverse = inverse + _broyden(inverse, step, now - rest)
        size = np.linalg.norm(now, axis=1) / points.load_N
        better = size < least
        best, rest = np.where(better[:, None], tried, best), np.where(better[:, None], now, rest)
        least, power = np.minimum(size, least), np.where(better, dear, power)
        if (least <= TOLERANCE).all():
            break
        step = -np.einsum("nij,nj->ni", inverse, rest)
        step = step * np.minimum(
            1.0, STEP_MAX * unit / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-15)
        )
        tried = best + step
    at = _complex(best)
    return Orbit(at[:, 0].real, at[:, 1:], power)


def _first_guess(points: Points, steady: Steady, unbalance_kg_m: Floats) -> Floats:
    """The linear orbit, drawn together where it would reach beyond :data:`REACH_MAX`."""
    first = steady.response_m_per_kg_m * unbalance_kg_m[:, None]
    room = REACH_MAX * points.clearance_m - np.hypot(*steady.position_m.T)
    first = (
        first
        * np.minimum(1.0, np.maximum(room, 0.0) / np.maximum(np.abs(first).max(axis=1), 1e-15))[
            :, None
        ]
    )
    at = np.zeros((len(first), ORDERS + 1, 2), np.complex128)
    at[:, 1] = first
    return _real(at)


def _turn(
    film: Film, every: Points, steady: Steady, at: Complexes, speed: Floats
) -> tuple[Floats, Floats]:
    """Film force (n, PHASES, 2) around the orbit, and its power (n,) beyond that at rest."""
    n = len(at)
    where = (steady.position_m[:, None] + Orbit(at[:, 0].real, at[:, 1:], speed).path_m()).reshape(
        -1, 2
    )
    limit = ECCENTRICITY_MAX * every.clearance_m
    where *= np.minimum(1.0, limit / np.maximum(np.hypot(*where.T), 1e-15))[:, None]
    rates = 1j * speed[:, None] * np.arange(1, ORDERS + 1)
    velocity = np.real(np.einsum("nh,nhi,hk->nki", rates, at[:, 1:], _TURN))
    force, torque = film.force(every, np.concatenate([where, velocity.reshape(-1, 2)], axis=1))
    force = force.reshape(n, PHASES, 2)
    work = np.einsum("nki,nki->n", force, velocity) / PHASES
    return force, torque.reshape(n, PHASES).mean(axis=1) * speed - work - steady.power_W


def _linear_inverse(steady: Steady, speed: Floats, inertia: Floats) -> Floats:
    """Inverse Jacobian of the balance in the linear film, shape (n, 2 + 4 ORDERS, 2 + 4 ORDERS)."""
    size = 2 + 4 * ORDERS
    inverse = np.zeros((len(speed), size, size))
    inverse[:, :2, :2] = np.linalg.inv(-steady.stiffness)
    for h in range(ORDERS):
        order = (h + 1) * speed[:, None, None]
        flexible = np.linalg.inv(
            inertia[:, h, None, None] * np.eye(2) - steady.stiffness - 1j * order * steady.damping
        )
        at = 2 + 4 * h
        inverse[:, at : at + 2, at : at + 2] = inverse[:, at + 2 : at + 4, at + 2 : at + 4] = (
            flexible.real
        )
        inverse[:, at : at + 2, at + 2 : at + 4] = -flexible.imag
        inverse[:, at + 2 : at + 4, at : at + 2] = flexible.imag
    return inverse


def _broyden(inverse: Floats, step: Floats, change: Floats) -> Floats:
    """What the last ``step`` and the ``change`` that it made of the rest teach the inverse
    Jacobian."""
    back = np.einsum("nij,nj->ni", inverse, change)
    along = np.einsum("ni,nij->nj", step, inverse)
    scale = np.einsum("ni,ni->n", step, back)
    scale = np.where(np.abs(scale) > 1e-30, scale, np.inf)
    return np.asarray((step - back)[:, :, None] * along[:, None, :] / scale[:, None, None])


def _real(orders: Complexes) -> Floats:
    """(n, ORDERS + 1, 2) to (n, 2 + 4 ORDERS): the mean, then real and imaginary parts of each
    order."""
    parts = np.stack([orders[:, 1:].real, orders[:, 1:].imag], axis=2)
    return np.concatenate([orders[:, 0].real, parts.reshape(len(orders), -1)], axis=1)


def _complex(flat: Floats) -> Complexes:
    parts = flat[:, 2:].reshape(len(flat), ORDERS, 2, 2)
    return np.concatenate([flat[:, None, :2] + 0j, parts[:, :, 0] + 1j * parts[:, :, 1]], axis=1)
