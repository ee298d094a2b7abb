"""The film together with the flow through the restrictors of its feeds.

Between two changes of the rupture the film is linear: its pressure is that without feed pressure
and, for each feed, its answer to one unit of pressure there, from one elimination with many right
sides. That leaves as many equations as there are feeds, the flow through each restrictor being that
into the film and into the store behind it; then the active set of `solver` or `conserving` goes on.
Scaled as there.
"""

from typing import NamedTuple

import numpy as np

from sim_hil.jit import allocating

from .records import Floats
from .solver import MAX_SWEEPS, fold, outflow

_DRAIN = 1e-12  # as in `conserving`
_NEWTON_MAX = 60


class ScaledFeeds(NamedTuple):
    """The feeds of one state, scaled: pressures in 1/s, flows over `c R^2` and the meshed copies.

    Parameters
    ----------
    place
        Which feed holds each node, -1 for none, shape (theta, z).
    supply
        Pressure before the restrictor.
    quadratic, linear
        Pressure drop `quadratic Q |Q| + linear Q`.
    store, before
        Flow into the store per pressure since one time step ago, and the pressure then; zeros in
        the steady state.
    """

    place: np.ndarray
    supply: Floats
    quadratic: Floats
    linear: Floats
    store: Floats
    before: Floats


@allocating
def _assemble(
    p: Floats,
    fixed: np.ndarray,
    place: np.ndarray,
    ruptured: np.ndarray,
    around: Floats,
    axial: Floats,
    supply: Floats,
    drag: Floats,
    kept: Floats,
    step: int,
    floor: float,
    mixed: bool,
    band: Floats,
    rhs: Floats,
) -> None:
    """Matrix of one active set; right sides: without feed pressure, then one unit of each feed."""
    n, m = p.shape
    w = 2 * m
    band[:] = 0.0
    rhs[:] = 0.0
    for i in range(n):
        up = (i - step) % n
        drag_in = drag[up if step > 0 else i]
        drag_out = drag[i if step > 0 else (i - 1) % n]
        for j in range(m):
            row = fold(i, n) * m + j
            if fixed[i, j] or (ruptured[i, j] and not mixed):
                band[row, w] = 1.0
                if not fixed[i, j]:
                    rhs[row, 0] = floor
                elif place[i, j] >= 0:
                    rhs[row, 1 + place[i, j]] = 1.0
                else:
                    rhs[row, 0] = p[i, j]
                continue
            rhs[row, 0] = supply[i, j]
            for ii, jj, g in (
                ((i + 1) % n, j, around[i, j]),
                ((i - 1) % n, j, around[(i - 1) % n, j]),
                (i, j - 1, axial[i, j - 1] if j > 0 else 0.0),
                (i, j + 1, axial[i, j] if j < m - 1 else 0.0),
            ):
                if g == 0.0:
                    continue
                if ruptured[i, j]:
                    rhs[row, 0] -= g * floor
                else:
                    band[row, w] += g
                if fixed[ii, jj] and place[ii, jj] >= 0:
                    rhs[row, 1 + place[ii, jj]] += g
                elif fixed[ii, jj]:
                    rhs[row, 0] += g * p[ii, jj]
                elif ruptured[ii, jj]:
                    rhs[row, 0] += g * floor
                else:
                    band[row, w + fold(ii, n) * m + jj - row] -= g
            if ruptured[i, j]:
                band[row, w] += drag_out[j] * (1 + _DRAIN) + kept[i, j]
            if mixed and ruptured[up, j] and not fixed[up, j]:
                band[row, w + fold(up, n) * m + j - row] -= drag_in[j]


@allocating
def eliminate_many(band: Floats, rhs: Floats) -> None:
    """`solver.eliminate` for several right sides at once, shape (unknowns, sides)."""
    size = band.shape[0]
    w = band.shape[1] // 2
    sides = rhs.shape[1]
    for k in range(size):
        inverse = 1.0 / band[k, w]
        for i in range(k + 1, min(k + w + 1, size)):
            factor = band[i, w + k - i] * inverse
            if factor != 0.0:
                shift = w + k - i
                for d in range(1, w + 1):
                    band[i, shift + d] -= factor * band[k, w + d]
                for s in range(sides):
                    rhs[i, s] -= factor * rhs[k, s]
    for k in range(size - 1, -1, -1):
        last = min(w, size - 1 - k)
        for s in range(sides):
            total = rhs[k, s]
            for d in range(1, last + 1):
                total -= band[k, w + d] * rhs[k + d, s]
            rhs[k, s] = total / band[k, w]


@allocating
def _spread(
    side: int,
    rhs: Floats,
    fixed: np.ndarray,
    ruptured: np.ndarray,
    floor: float,
    mixed: bool,
    p: Floats,
    void: Floats,
) -> None:
    """One solution as pressure and void share on the mesh; the floor belongs to the first alone."""
    n, m = p.shape
    for i in range(n):
        for j in range(m):
            value = rhs[fold(i, n) * m + j, side]
            void[i, j] = 0.0
            if mixed and ruptured[i, j] and not fixed[i, j]:
                void[i, j] = -value
                p[i, j] = floor if side == 0 else 0.0
            else:
                p[i, j] = value


@allocating
def _feed_flows(
    p: Floats,
    void: Floats,
    place: np.ndarray,
    around: Floats,
    axial: Floats,
    drag: Floats,
    step: int,
    flows: Floats,
) -> None:
    """Flow out of each feed by pressure, and what it fills up of the voids that are dragged in."""
    n, m = p.shape
    flows[:] = 0.0
    for i in range(n):
        up = (i - step) % n
        drag_in = drag[up if step > 0 else i]
        for j in range(m):
            if place[i, j] >= 0:
                flows[place[i, j]] += outflow(p, i, j, around, axial)
                if place[up, j] < 0:
                    flows[place[i, j]] += drag_in[j] * void[up, j]


@allocating
def balance_feeds(film: Floats, free: Floats, feeds: ScaledFeeds, pressure: Floats) -> bool:
    """Feed pressures in place at which the flow through each restrictor is that into film and
    store.

    Parameters
    ----------
    film
        Flow out of each feed (row) per pressure of each feed (column); an M-matrix.
    free
        Flow out of each at no feed pressure.
    pressure
        On return the feed pressures.

    Notes
    -----
    Newton on the flows `Q` of `film (p_s - q Q|Q| - l Q) + free = Q - store (p - before)`: smooth
    where the flow turns, and linear where there is no restrictor.
    """
    count = feeds.supply.size
    whole = film + np.diag(feeds.store)
    rest = free - feeds.store * feeds.before
    square, plain, flow = feeds.quadratic, feeds.linear, np.zeros(count)
    most = np.max(np.abs(feeds.supply)) + 1e-300
    for _ in range(_NEWTON_MAX):
        pressure[:] = feeds.supply - square * flow * np.abs(flow) - plain * flow
        excess = whole @ pressure + rest - flow
        slope = np.eye(count) + whole * (2 * square * np.abs(flow) + plain)
        move = np.linalg.solve(slope, excess)
        flow += move
        pressure[:] = feeds.supply - square * flow * np.abs(flow) - plain * flow
        still = np.max(np.abs((2 * square * np.abs(flow) + plain) * move))
        if still <= 1e-13 * most and np.max(np.abs(move)) <= 1e-11 * (
            np.max(np.abs(flow)) + 1e-300
        ):
            return True
    return False


@allocating
def solve_restricted(
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
    complementary: bool,
    mixed: bool,
    feeds: ScaledFeeds,
    pressure: Floats,
    gain: Floats,
) -> int:
    """Pressure, void share and feed pressures in place; returns the number of solves, 0 if it did
    not settle.

    Arguments as `solver.solve_pressure` and, with `mixed`, `conserving.solve_conserving`; without
    it `drag` and `kept` are not looked at. `gain` returns the film's flow per feed pressure.
    """
    n, m = p.shape
    count = feeds.supply.size
    band = np.empty((n * m, 4 * m + 1))
    rhs = np.empty((n * m, 1 + count))
    flows = np.empty((1 + count, count))
    part, part_void = np.empty((n, m)), np.empty((n, m))
    walls = np.zeros(count)
    for i in range(n):
        for j in range(m):
            if feeds.place[i, j] >= 0:
                walls[feeds.place[i, j]] += supply[i, j]
    if not complementary:
        ruptured[:] = False
    for sweep in range(1, MAX_SWEEPS + 1):
        _assemble(
            p, fixed, feeds.place, ruptured, around, axial, supply, drag, kept, step, floor, mixed,
            band, rhs,
        )  # fmt: skip
        eliminate_many(band, rhs)
        for s in range(1 + count):
            _spread(s, rhs, fixed, ruptured, floor, mixed, part, part_void)
            _feed_flows(part, part_void, feeds.place, around, axial, drag, step, flows[s])
        gain[:] = flows[1:].T
        if not balance_feeds(gain, flows[0] - walls, feeds, pressure):
            return 0
        for k in range(n * m):
            for s in range(count):
                rhs[k, 0] += rhs[k, 1 + s] * pressure[s]
        _spread(0, rhs, fixed, ruptured, floor, mixed, p, void)
        if not complementary or not _changed(
            p, void, fixed, ruptured, around, axial, supply, floor, mixed
        ):
            return sweep
    return 0


@allocating
def _changed(
    p: Floats,
    void: Floats,
    fixed: np.ndarray,
    ruptured: np.ndarray,
    around: Floats,
    axial: Floats,
    supply: Floats,
    floor: float,
    mixed: bool,
) -> int:
    """Move nodes between full and ruptured; returns how many."""
    n, m = p.shape
    tiny_p = (1e-11 if mixed else 1e-12) * np.max(np.abs(p - floor))
    tiny_q = 1e-12 * np.max(np.abs(supply))
    changes = 0
    for i in range(n):
        for j in range(m):
            if fixed[i, j]:
                continue
            if ruptured[i, j]:
                if mixed:
                    heals = void[i, j] < -1e-11
                else:
                    heals = outflow(p, i, j, around, axial) < supply[i, j] - tiny_q
                if heals:
                    ruptured[i, j] = False
                    changes += 1
            elif p[i, j] < floor - tiny_p:
                ruptured[i, j] = True
                changes += 1
    return changes
