"""The mass-conserving film (Jakobsson, Floberg 1957; Olsson 1965): pressure where full, fill where
ruptured.

Scaled as in `solver`. With the liquid share `1 - b` of the gap,

    div(H^3 grad p) = omega/2 d(H (1 - b))/dtheta + d(H (1 - b))/dt,   p >= floor, b >= 0, one of
    them equal,

upwind in b, implicit in time. Every mixture of the two kinds of column is an M-matrix, so the
complementarity is solved by the same active set as Reynolds rupture.
"""

import numpy as np

from sim_hil.jit import allocating

from .records import Floats
from .solver import MAX_SWEEPS, eliminate, fold

# A ring ruptured all around keeps no oil in the steady state; this share of the drag selects that
# answer.
_DRAIN = 1e-12


@allocating
def _solve_mixed(
    p: Floats,
    void: Floats,
    fixed: np.ndarray,
    ruptured: np.ndarray,
    around: Floats,
    axial: Floats,
    supply: Floats,
    drag: Floats,
    kept: Floats,
    step: int,
    floor: float,
    band: Floats,
    rhs: Floats,
) -> None:
    """Solve the balance of every free cell for its pressure, or where ruptured for its void
    share."""
    n, m = p.shape
    w = 2 * m
    band[:] = 0.0
    for i in range(n):
        up = (i - step) % n
        drag_in = drag[up if step > 0 else i]
        drag_out = drag[i if step > 0 else (i - 1) % n]
        for j in range(m):
            row = fold(i, n) * m + j
            if fixed[i, j]:
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
                if ruptured[i, j]:
                    rhs[row] -= g * floor
                else:
                    band[row, w] += g
                if fixed[ii, jj]:
                    rhs[row] += g * p[ii, jj]
                elif ruptured[ii, jj]:
                    rhs[row] += g * floor
                else:
                    band[row, w + fold(ii, n) * m + jj - row] -= g
            if ruptured[i, j]:
                band[row, w] += drag_out[j] * (1 + _DRAIN) + kept[i, j]
            if ruptured[up, j] and not fixed[up, j]:
                band[row, w + fold(up, n) * m + j - row] -= drag_in[j]
    eliminate(band, rhs)
    for i in range(n):
        for j in range(m):
            if not fixed[i, j]:
                value = rhs[fold(i, n) * m + j]
                p[i, j] = floor if ruptured[i, j] else value
                void[i, j] = -value if ruptured[i, j] else 0.0


@allocating
def solve_conserving(
    p: Floats,
    void: Floats,
    fixed: np.ndarray,
    ruptured: np.ndarray,
    around: Floats,
    axial: Floats,
    supply: Floats,
    drag: Floats,
    kept: Floats,
    step: int,
    floor: float,
) -> int:
    """Pressure and void share in place; returns the number of solves, 0 if it did not settle.

    Parameters
    ----------
    p, void
        On entry the fixed pressures, and zeros; on return pressure and void share, shape (theta,
        z).
    ruptured
        Guess of the ruptured cells on entry, the ruptured cells on return.
    supply
        What the walls deliver to each cell if full, less what refills the voids of one time step
        ago.
    drag
        Flow that the wall drags through each face between stations if full, shape (theta, z), not
        negative.
    kept
        Rate at which a void of one is stored in each cell.
    step
        Sense of rotation, +1 or -1.
    """
    n, m = p.shape
    band = np.empty((n * m, 4 * m + 1))
    rhs = np.empty(n * m)
    for sweep in range(1, MAX_SWEEPS + 1):
        _solve_mixed(
            p, void, fixed, ruptured, around, axial, supply, drag, kept, step, floor, band, rhs
        )
        tiny = 1e-11 * np.max(np.abs(p - floor))
        changes = 0
        for i in range(n):
            for j in range(m):
                if fixed[i, j]:
                    continue
                if ruptured[i, j] and void[i, j] < -1e-11:
                    ruptured[i, j] = False
                    changes += 1
                elif not ruptured[i, j] and p[i, j] < floor - tiny:
                    ruptured[i, j] = True
                    changes += 1
        if changes == 0:
            return sweep
    return 0
