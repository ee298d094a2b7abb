"""Film networks as film laws, compiled: the reduced network of the surrogate, and the raw one of
equation (5).

Neither knows a moving clearance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_hil.film.table_kernel import EPS_TABLE, contact_force
from sim_hil.jit import kernel
from sim_hil.rotor.parameters import Floats

GAUSS_NODES = 40


class Perceptron(NamedTuple):
    """Sigmoid network with a linear last layer.

    `theta` holds one row-major `(inputs + 1, outputs)` matrix a layer, biases first; `sizes` the
    neurons of each layer; `work` (2, widest) belongs to one thread.
    """

    theta: Floats
    sizes: NDArray[np.int64]
    work: Floats

    @classmethod
    def make(cls, theta: Floats, sizes: tuple[int, ...]) -> Perceptron:
        """A network of these weights and sizes."""
        return cls(
            np.ascontiguousarray(theta), np.array(sizes, np.int64), np.zeros((2, max(sizes)))
        )


@kernel
def propagate(net: Perceptron) -> int:
    """Forward pass of the inputs in `net.work[0]`; returns the row of `net.work` that holds the
    outputs."""
    row, start = 0, 0
    for k in range(net.sizes.size - 1):
        n, m = net.sizes[k], net.sizes[k + 1]
        a, z = net.work[row], net.work[1 - row]
        for j in range(m):
            z[j] = net.theta[start + j]
        for i in range(n):
            for j in range(m):
                z[j] += a[i] * net.theta[start + (i + 1) * m + j]
        if k < net.sizes.size - 2:
            for j in range(m):
                z[j] = 1.0 / (1.0 + math.exp(-z[j]))
        start += (n + 1) * m
        row = 1 - row
    return row


@kernel
def _friction(
    ex: float,
    ey: float,
    fx: float,
    fy: float,
    omega: float,
    c: float,
    mu: float,
    R: float,
    L: float,
) -> float:
    """Full Couette shear and the pressure part of the braking torque, N m."""
    shear = (
        2
        * math.pi
        * mu
        * abs(omega)
        * R
        * R
        * R
        * L
        / (c * math.sqrt(1 - (ex * ex + ey * ey) / (c * c)))
    )
    return shear + (-0.5 if omega < 0 else 0.5) * (ex * fy - ey * fx)


@kernel
def reduced_forces(
    law: ReducedNetworkLaw,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    mu: float,
    R: float,
    L: float,
    c_rate: float,
) -> tuple[float, float, float, float]:
    """`film_law` of a reduced network."""
    share = EPS_TABLE * c / max(math.hypot(ex, ey), EPS_TABLE * c)
    x, y = ex * share, ey * share
    sx, sy = vx + 0.5 * omega * ey, vy - 0.5 * omega * ex
    squeeze = math.hypot(sx, sy)
    fx = fy = flow = 0.0
    if squeeze > 1e-30:
        ux, uy = sx / squeeze, sy / squeeze
        a, b = (x * ux + y * uy) / c, (y * ux - x * uy) / c
        along = across = 0.0
        for k in range(law.nodes.shape[0]):
            t, w = law.nodes[k, 0], law.nodes[k, 1]
            q = (1 + a) * t * t - 2 * b * t + 1 - a
            kernel = 2 * w * (1 - t * t) / (q * q * q)
            along += kernel * (1 - t * t)
            across += kernel * 2 * t
        law.net.work[0, 0], law.net.work[0, 1] = a, b * b
        n = law.net.work[propagate(law.net)]
        gain = -mu * R * (L / c) ** 3 * squeeze
        along, across = gain * along * math.exp(n[0]), gain * across * math.exp(n[1])
        fx, fy = along * ux - across * uy, along * uy + across * ux
        flow = 2 * R * L * squeeze * math.exp(n[2])
    torque = _friction(x, y, fx, fy, omega, c, mu, R, L)
    contact_x, contact_y, rub = contact_force(ex, ey, omega, c)
    return fx + contact_x, fy + contact_y, torque + rub * R, flow


@kernel
def raw_forces(
    law: RawNetworkLaw,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    mu: float,
    R: float,
    L: float,
    c_rate: float,
) -> tuple[float, float, float, float]:
    """`film_law` of a raw network."""
    share = EPS_TABLE * c / max(math.hypot(ex, ey), EPS_TABLE * c)
    x, y = ex * share, ey * share
    work = law.net.work
    work[0, 0], work[0, 1] = x / law.length_m, y / law.length_m
    work[0, 2], work[0, 3] = vx / law.velocity_m_s, vy / law.velocity_m_s
    row = propagate(law.net)
    fx, fy = law.force_N * work[row, 0], law.force_N * work[row, 1]
    torque = _friction(x, y, fx, fy, omega, c, mu, R, L)
    contact_x, contact_y, rub = contact_force(ex, ey, omega, c)
    return fx + contact_x, fy + contact_y, torque + rub * R, 0.0


class ReducedNetworkLaw(NamedTuple):
    """The reduced film network: `(a, b^2)` to the logarithms of film over short film along, across,
    and of the flow.

    `nodes` (n, 2): Gauss-Legendre nodes and weights of the short film's integrals.
    """

    net: Perceptron
    nodes: Floats

    @classmethod
    def make(cls, theta: Floats, sizes: tuple[int, ...]) -> ReducedNetworkLaw:
        """The law of a network of these weights and sizes."""
        return cls(
            Perceptron.make(theta, sizes),
            np.column_stack(np.polynomial.legendre.leggauss(GAUSS_NODES)),
        )


class RawNetworkLaw(NamedTuple):
    """Equation (5): position and velocity over `length_m`, `velocity_m_s` to the force over
    `force_N`.

    It holds for the one clearance, speed and viscosity that it was trained at.
    """

    net: Perceptron
    length_m: float
    velocity_m_s: float
    force_N: float
