"""The fast direct film: Guembel rupture, a few axial cosine modes, callable from other compiled
kernels.

Scaled as in `solver`, the unfed film between ambient ends is `p = sum_k P_k(theta) cos(kappa_k z)`
with `kappa_k = (2 k - 1) pi R / L`. Each mode is one cyclic tridiagonal system,

    d/dtheta(H^3 dP_k/dtheta) - kappa_k^2 H^3 P_k = a_k (omega/2 dH/dtheta + dH/dt),

where `a_k = 4 (-1)^(k-1) / ((2 k - 1) pi)` expands the constant one; pressures below ambient are
then cut off.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim_hil.jit import allocating

from .records import Floats

_AXIAL_POINTS = 6


@dataclass(frozen=True)
class DirectFilm:
    """Arrays that `direct_force` needs: the first two fixed, `work` its scratch space (one per
    thread).

    Parameters
    ----------
    ring
        cos and sin at the stations and at the faces after them, shape (4, theta).
    axial
        Cosines of the modes at the Gauss points of one half, and the points' weights over both
        halves (their sum is one) in the last column, shape (points, modes + 1).
    work
        Shape (3, theta, modes).
    """

    ring: Floats
    axial: Floats
    work: Floats

    @classmethod
    def make(cls, stations: int = 64, modes: int = 4) -> "DirectFilm":
        """Arrays for that many stations around and modes along."""
        theta = 2 * np.pi * np.arange(stations) / stations
        face = theta + np.pi / stations
        point, weight = np.polynomial.legendre.leggauss(_AXIAL_POINTS)
        place = (point + 1) / 2 * np.pi / 2
        cosines = np.cos(np.outer(place, 2 * np.arange(modes) + 1))
        return cls(
            np.array([np.cos(theta), np.sin(theta), np.cos(face), np.sin(face)]),
            np.column_stack([cosines, weight / 2]),
            np.empty((3, stations, modes)),
        )


@allocating
def solve_rings(link: Floats, diagonal: Floats, right: Floats, work: Floats) -> None:
    """Solve cyclic tridiagonal systems side by side; `right` becomes the solutions.

    Row i is `diagonal[i] x[i] - link[i] x[i+1] - link[i-1] x[i-1] = right[i]` around the ring;
    `link` is common to all systems, shape (n,), the others have shape (n, systems). The last
    unknown is carried along as a parameter.
    """
    n, systems = right.shape
    for k in range(systems):
        inverse = 1.0 / diagonal[0, k]
        diagonal[0, k] = link[0] * inverse
        right[0, k] *= inverse
        work[0, k] = link[n - 1] * inverse
    for i in range(1, n - 1):
        for k in range(systems):
            inverse = 1.0 / (diagonal[i, k] - link[i - 1] * diagonal[i - 1, k])
            diagonal[i, k] = link[i] * inverse
            right[i, k] = (right[i, k] + link[i - 1] * right[i - 1, k]) * inverse
            work[i, k] = link[i - 1] * work[i - 1, k] * inverse
    for k in range(systems):
        work[n - 2, k] += diagonal[n - 2, k]
    for i in range(n - 3, -1, -1):
        for k in range(systems):
            right[i, k] += diagonal[i, k] * right[i + 1, k]
            work[i, k] += diagonal[i, k] * work[i + 1, k]
    for k in range(systems):
        top = right[n - 1, k] + link[n - 1] * right[0, k] + link[n - 2] * right[n - 2, k]
        bottom = diagonal[n - 1, k] - link[n - 1] * work[0, k] - link[n - 2] * work[n - 2, k]
        right[n - 1, k] = top / bottom
    for i in range(n - 1):
        for k in range(systems):
            right[i, k] += work[i, k] * right[n - 1, k]


@allocating
def direct_force(
    ring: Floats,
    axial: Floats,
    work: Floats,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    mu: float,
    R: float,
    L: float,
    c_rate: float = 0.0,
) -> tuple[float, float, float]:
    """Force on the journal (fx, fy), N, and braking friction torque, N m; arguments as
    `table_force`.

    The arrays are those of a `DirectFilm`. The eccentricity must be below the clearance.
    """
    _, n, modes = work.shape
    gap = 2 * math.pi / n
    x, y = ex / c, ey / c
    sx, sy = (vx + 0.5 * omega * ey) / c, (vy - 0.5 * omega * ex) / c
    chord = 2 * math.sin(gap / 2)  # integral of the cosine over a cell, over its middle value
    link = ring_links(ring, x, y, gap)
    diagonal, right = work[0], work[1]
    for i in range(n):
        cube = (1.0 - x * ring[0, i] - y * ring[1, i]) ** 3 * gap
        supply = (sx * ring[0, i] + sy * ring[1, i]) * chord - c_rate / c * gap
        around = link[i] + link[i - 1]
        for k in range(modes):
            kappa = (2 * k + 1) * math.pi * R / L
            diagonal[i, k] = around + kappa * kappa * cube
            right[i, k] = supply * (4 / math.pi) / (2 * k + 1) * (1 - 2 * (k % 2))
    solve_rings(link, diagonal, right, work[2])
    fx = fy = 0.0
    for i in range(n):
        line = 0.0
        for g in range(axial.shape[0]):
            p = 0.0
            for k in range(modes):
                p += right[i, k] * axial[g, k]
            line += max(p, 0.0) * axial[g, modes]
        fx -= line * ring[0, i]
        fy -= line * ring[1, i]
    scale = 12 * mu * (R / c) ** 2 * R * L * chord
    fx *= scale
    fy *= scale
    sense = -1.0 if omega < 0 else 1.0
    shear = 2 * math.pi * mu * abs(omega) * R * R * R * L / (c * math.sqrt(1 - x * x - y * y))
    return fx, fy, shear + sense * 0.5 * (ex * fy - ey * fx)


@allocating
def ring_links(ring: Floats, x: float, y: float, gap: float) -> Floats:
    """Conductance of the faces around the ring, shape (theta,)."""
    links: Floats = (1.0 - x * ring[2] - y * ring[3]) ** 3 / gap
    return links
