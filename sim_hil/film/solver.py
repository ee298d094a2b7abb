"""Pressure kernels: banded elimination on the folded ring and the active set of the rupture.

All quantities are scaled: film thickness by the clearance, lengths by the journal radius and
pressure by `12 mu R^2 / c^2`, so that a scaled pressure is a rate, 1/s:

    d/dtheta(H^3 dp/dtheta) + d/dz(H^3 dp/dz) = (omega/2 dH/dtheta + dH/dt)

with `H = 1 - X cos(theta) - Y sin(theta)` (equation (3) of the paper, the journal as the moving
surface).
"""

import numpy as np

from sim_hil.jit import allocating

from .records import Floats

MAX_SWEEPS = 200


@allocating
def fold(i: int, n: int) -> int:
    """Place of ring station i in the order 0, n-1, 1, n-2, ...: neighbours are never more than two
    apart."""
    return 2 * i if 2 * i < n else 2 * (n - i) - 1


@allocating
def eliminate(band: Floats, rhs: Floats) -> None:
    """Solve a banded M-matrix system in place (no pivoting needed); rhs becomes the solution.

    `band[k, w + d]` is the coefficient of unknown k + d in row k, half bandwidth w.
    """
    size = band.shape[0]
    w = band.shape[1] // 2
    for k in range(size):
        inverse = 1.0 / band[k, w]
        for i in range(k + 1, min(k + w + 1, size)):
            factor = band[i, w + k - i] * inverse
            if factor != 0.0:
                shift = w + k - i
                for d in range(1, w + 1):
                    band[i, shift + d] -= factor * band[k, w + d]
                rhs[i] -= factor * rhs[k]
    for k in range(size - 1, -1, -1):
        total = rhs[k]
        for d in range(1, min(w, size - 1 - k) + 1):
            total -= band[k, w + d] * rhs[k + d]
        rhs[k] = total / band[k, w]


@allocating
def around_conductance(film_face: Floats, theta_gap: Floats, z_width: Floats) -> Floats:
    """Conductance of the face between stations i and i + 1, shape (theta, z)."""
    return (film_face**3 / theta_gap).reshape(-1, 1) * z_width.reshape(1, -1)


@allocating
def axial_conductance(film: Floats, theta_width: Floats, z_gap: Floats) -> Floats:
    """Conductance of the face between axial nodes j and j + 1, shape (theta, z - 1)."""
    return (film**3 * theta_width).reshape(-1, 1) / z_gap.reshape(1, -1)


@allocating
def outflow(p: Floats, i: int, j: int, around: Floats, axial: Floats) -> float:
    """Pressure-driven flow out of the cell of node (i, j)."""
    n, m = p.shape
    back = (i - 1) % n
    flow: float = around[i, j] * (p[i, j] - p[(i + 1) % n, j]) + around[back, j] * (
        p[i, j] - p[back, j]
    )
    if j > 0:
        flow += axial[i, j - 1] * (p[i, j] - p[i, j - 1])
    if j < m - 1:
        flow += axial[i, j] * (p[i, j] - p[i, j + 1])
    return flow


@allocating
def _solve_filled(
    p: Floats,
    held: np.ndarray,
    around: Floats,
    axial: Floats,
    supply: Floats,
    band: Floats,
    rhs: Floats,
) -> None:
    """Solve `outflow = supply` at every node that is not held; held nodes keep their pressure."""
    n, m = p.shape
    w = 2 * m
    band[:] = 0.0
    for i in range(n):
        for j in range(m):
            row = fold(i, n) * m + j
            if held[i, j]:
                band[row, w] = 1.0
                rhs[row] = p[i, j]
                continue
            rhs[row] = supply[i, j]
            for ii, jj, g in (
                ((i + 1) % n, j, around[i, j]),
                ((i - 1) % n, j, around[(i - 1) % n, j]),
                (i, j - 1, axial[i, j - 1] if j > 0 else 0.0),
                (i, j + 1, axial[i, j] if j < m - 1 else 0.0),
            ):
                if g == 0.0:
                    continue
                band[row, w] += g
                if held[ii, jj]:
                    rhs[row] += g * p[ii, jj]
                else:
                    band[row, w + fold(ii, n) * m + jj - row] -= g
    eliminate(band, rhs)
    for i in range(n):
        for j in range(m):
            p[i, j] = rhs[fold(i, n) * m + j]


@allocating
def solve_pressure(
    p: Floats,
    fixed: np.ndarray,
    around: Floats,
    axial: Floats,
    supply: Floats,
    floor: float,
    ruptured: np.ndarray,
    complementary: bool,
) -> int:
    """Film pressure in place, filled or complementary; returns the number of solves, 0 if it did
    not settle.

    Parameters
    ----------
    p
        On entry the fixed pressures (anything elsewhere), on return the pressure, shape (theta, z).
    supply
        What the moving walls deliver to each cell, shape (theta, z).
    floor
        Cavitation pressure (complementary only).
    ruptured
        Guess of the ruptured nodes on entry, the ruptured nodes on return.
    complementary
        Reynolds (Swift-Stieber) rupture: `p >= floor`, `outflow >= supply`, one of them equal at
        every node. Solved by the primal-dual active set method (Hintermueller, Ito, Kunisch 2002),
        finite for M-matrices.
    """
    n, m = p.shape
    band = np.empty((n * m, 4 * m + 1))
    rhs = np.empty(n * m)
    if not complementary:
        ruptured[:] = False
        _solve_filled(p, fixed, around, axial, supply, band, rhs)
        return 1
    for sweep in range(1, MAX_SWEEPS + 1):
        for i in range(n):
            for j in range(m):
                if ruptured[i, j] and not fixed[i, j]:
                    p[i, j] = floor
        _solve_filled(p, fixed | ruptured, around, axial, supply, band, rhs)
        tiny_p = 1e-12 * np.max(np.abs(p - floor))
        tiny_q = 1e-12 * np.max(np.abs(supply))
        changes = 0
        for i in range(n):
            for j in range(m):
                if fixed[i, j]:
                    continue
                if ruptured[i, j]:
                    if outflow(p, i, j, around, axial) < supply[i, j] - tiny_q:
                        ruptured[i, j] = False
                        changes += 1
                elif p[i, j] < floor - tiny_p:
                    ruptured[i, j] = True
                    changes += 1
        if changes == 0:
            return sweep
    return 0


@allocating
def streamer_fill(
    ruptured: np.ndarray,
    film_face: Floats,
    p: Floats,
    around: Floats,
    axial: Floats,
    z_width: Floats,
    speed: float,
) -> Floats:
    """Liquid share of the gap where the rupture rule itself does not carry mass, shape (theta, z).

    Along the rotation each ruptured cell passes on what it receives: the flow that the wall drags
    in and what the pressure of filled neighbours pushes in. A ring ruptured all around passes its
    narrowest gap.
    """
    n, m = ruptured.shape
    fill = np.ones((n, m))
    step = -1 if speed < 0 else 1
    for j in range(m):
        if not ruptured[:, j].any():
            continue
        carried = film_face.min()
        for lap in range(2 * n):
            i = (step * lap) % n
            face = film_face[i if step > 0 else (i - 1) % n]
            if ruptured[i, j]:
                if speed != 0.0:
                    pushed = -outflow(p, i, j, around, axial)
                    carried += pushed * 2 / (abs(speed) * z_width[j])
                fill[i, j] = min(1.0, carried / face)
                carried = min(carried, face)
            else:
                carried = face
    return fill
