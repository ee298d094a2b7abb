"""The film with any openings and restrictors, callable from other compiled kernels.

A full film is linear: with the effective squeeze velocity `v_s` of `table_kernel` and the pressures
`p_k` of the openings its pressure and the flows out of the openings are

    p = u(v_s) + sum_k phi_k (p_k - p0_k),   Q_k = sum_l G_kl (p_l - p0_l),   p0 = H v_s,

`u` the unfed film and `p0_k` what it leaves in opening k, where phi, G and H are functions of the
journal's place alone, tabulated for one bearing shape and its openings (`port_table`), the pressure
as its integral along the axis in stations around. The flow through each restrictor, at any
viscosity, clearance and supply, gives the pressures.

A ruptured film holds no suction. With `w`, the share of the unfed film's suction that the feeds
leave, the flows and a second field take `max(p0, 0)` and `max(u, 0)` in this share, the pressure is
cut off where the lesser of the two fields is below zero, and `1 - (1 - w)^2` times the difference
between the unfed Reynolds film of `table_kernel` and the unfed film cut off alike is added. Without
suction, and without feed, this is exact for small openings; `port_table` measures it between.
"""

import math
from typing import NamedTuple

import numpy as np

from sim_hil.jit import allocating, kernel

from .records import Floats
from .table_kernel import EPS_TABLE, Four, _weights, table_force

STATIONS = 48
"""Around the bearing, the first at angle zero."""
EACH = 2 + STATIONS
"""Columns of one opening: H (radial, across) and the integral of phi along the axis."""
_NEWTON_MAX = 40


class PortLaw(NamedTuple):
    """What `port_force` needs.

    Parameters
    ----------
    unfed
        `FilmTable.coefficients` of the same length over diameter.
    table
        Spline coefficients, shape (cells of -log(1 - eps) + 3, cells of the turn + 3, columns):
        `EACH` per opening, then the lower triangle of G; scaled as `port_table` says.
    bare
        Spline coefficients of the unfed full film around, counted from e, at unit velocity along e
        and across, shape (cells of -log(1 - eps) + 3, cells of the turn + 3, 2).
    angle_rad
        Middle of each opening.
    restrictor
        q0, q1, l0, l1 of each (`firmware_py.machine.restrictor`).
    own_Pa
        Supply pressure of its own, nan: the common one.
    ring
        Integrals of cosine and sine over each station, shape (2, stations).
    """

    unfed: Floats
    table: Floats
    bare: Floats
    angle_rad: Floats
    restrictor: Floats
    own_Pa: Floats
    ring: Floats


@kernel
def _spot(u: float, cells: int) -> tuple[int, Four]:
    """Cell of a coordinate that counts cells, and the spline weights there."""
    i = min(max(int(u), 0), cells - 1)
    return i, _weights(u - i)


@allocating
def columns_at(table: Floats, eps: float, alpha: float) -> Floats:
    """All columns at an eccentricity ratio in [0, EPS_TABLE] and an angle in [0, 2 pi)."""
    n_eps, n_alpha = table.shape[0] - 3, table.shape[1] - 3
    i, wi = _spot(-math.log1p(-eps) * (n_eps / -math.log1p(-EPS_TABLE)), n_eps)
    j, wj = _spot(alpha * (n_alpha / (2 * math.pi)), n_alpha)
    count = table.shape[2]
    found = np.zeros(count)
    flat = table.reshape(-1)
    for a in range(4):
        start = ((i + a) * table.shape[1] + j) * count
        w0, w1, w2, w3 = wi[a] * wj[0], wi[a] * wj[1], wi[a] * wj[2], wi[a] * wj[3]
        s = flat[start : start + 4 * count]
        for k in range(count):
            found[k] += (
                w0 * s[k] + w1 * s[count + k] + w2 * s[2 * count + k] + w3 * s[3 * count + k]
            )
    return found


@allocating
def bare_film(bare: Floats, eps: float, alpha: float, along: float, across: float) -> Floats:
    """The unfed full film at the stations, for a velocity along e and across; scaled."""
    n_eps, n_psi = bare.shape[0] - 3, bare.shape[1] - 3
    i, wi = _spot(-math.log1p(-eps) * (n_eps / -math.log1p(-EPS_TABLE)), n_eps)
    rows = np.empty((n_psi + 3, 2))
    for j in range(n_psi + 3):
        for d in range(2):
            rows[j, d] = (
                wi[0] * bare[i, j, d] + wi[1] * bare[i + 1, j, d]
                + wi[2] * bare[i + 2, j, d] + wi[3] * bare[i + 3, j, d]
            )  # fmt: skip
    found = np.empty(STATIONS)
    for k in range(STATIONS):
        psi = k / STATIONS - alpha / (2 * math.pi)
        psi -= math.floor(psi)
        j, (w0, w1, w2, w3) = _spot(psi * n_psi, n_psi)
        found[k] = along * (
            w0 * rows[j, 0] + w1 * rows[j + 1, 0] + w2 * rows[j + 2, 0] + w3 * rows[j + 3, 0]
        ) + across * (
            w0 * rows[j, 1] + w1 * rows[j + 1, 1] + w2 * rows[j + 2, 1] + w3 * rows[j + 3, 1]
        )
    return found


@allocating
def solve_small(matrix: Floats, right: Floats) -> None:
    """Solve a small system of a diagonally heavy matrix in place."""
    n = right.size
    for k in range(n):
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, n):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrix[i, j] -= factor * matrix[k, j]
                right[i] -= factor * right[k]
    for k in range(n - 1, -1, -1):
        total = right[k]
        for j in range(k + 1, n):
            total -= matrix[k, j] * right[j]
        right[k] = total / matrix[k, k]


@allocating
def balance_ports(
    film: Floats, free: Floats, supply: Floats, square: Floats, plain: Floats, flow: Floats
) -> Floats:
    """Pressures at which `film p - free` is the flow through each restrictor, `square Q |Q| +
    plain Q` being its drop; `flow` is the start and the answer.

    Newton on the flows, as `restricted.balance_feeds`.
    """
    n = flow.size
    pressure, slope, move = np.empty(n), np.empty((n, n)), np.empty(n)
    for _ in range(_NEWTON_MAX):
        for k in range(n):
            pressure[k] = supply[k] - (square[k] * abs(flow[k]) + plain[k]) * flow[k]
        size = worst = 0.0
        for k in range(n):
            total = -free[k] - flow[k]
            for j in range(n):
                total += film[k, j] * pressure[j]
                slope[k, j] = film[k, j] * (2 * square[j] * abs(flow[j]) + plain[j])
            slope[k, k] += 1.0
            move[k] = total
        solve_small(slope, move)
        for k in range(n):
            flow[k] += move[k]
            size, worst = max(size, abs(flow[k])), max(worst, abs(move[k]))
        if worst <= 1e-12 * size:
            break
    for k in range(n):
        pressure[k] = supply[k] - (square[k] * abs(flow[k]) + plain[k]) * flow[k]
    return pressure


@allocating
def port_force(
    law: PortLaw,
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
    supply_Pa: float,
) -> tuple[float, float, float, float]:
    """Force (fx, fy), N, braking friction torque, N m, and side flow, m3/s.

    Parameters
    ----------
    law
        `PortTable.law` of this bearing.
    ex, ey, vx, vy, omega, c, mu, R, L, c_rate
        As in `table_force`.
    supply_Pa
        Common supply pressure above ambient, Pa.

    Notes
    -----
    Past EPS_TABLE as `table_force`. Recesses store nothing here: their pressure follows at once.
    """
    fx, fy, torque, flow = table_force(law.unfed, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)
    e = math.hypot(ex, ey)
    held = min(1.0, EPS_TABLE * c / e) if e > 0.0 else 1.0
    film_x, film_y = held * ex, held * ey
    unfed_x, unfed_y = fx, fy
    if e > EPS_TABLE * c:  # the openings add to the film, not to the contact
        unfed_x, unfed_y, _, _ = table_force(
            law.unfed, film_x, film_y, vx, vy, omega, c, mu, R, L, c_rate
        )
    eps = min(e / c, EPS_TABLE)
    way_x, way_y = (ex / e, ey / e) if e > 0.0 else (1.0, 0.0)
    sx, sy = vx + 0.5 * omega * film_y, vy - 0.5 * omega * film_x
    wall = 3 * c_rate / (1 + 2 * eps * eps) / c
    sx, sy = (sx - wall * film_x) / c, (sy - wall * film_y) / c
    along, across = sx * way_x + sy * way_y, sy * way_x - sx * way_y
    alpha = math.atan2(way_y, way_x)
    turn = alpha + 2 * math.pi if alpha < 0 else alpha
    columns = columns_at(law.table, eps, turn)
    bare = bare_film(law.bare, eps, turn, along, across)
    cut_x, cut_y, bare_x, bare_y, through, share = _film(
        law, columns, bare, eps, alpha, along, across, c, mu, R, supply_Pa
    )
    scale = 12 * mu * (R / c) ** 2 * R * R
    settled = (1 - share) * (1 - share)
    more_x = scale * (cut_x - (1 - settled) * bare_x) - settled * unfed_x
    more_y = scale * (cut_y - (1 - settled) * bare_y) - settled * unfed_y
    fx += more_x
    fy += more_y
    torque += math.copysign(0.5, omega) * (film_x * more_y - film_y * more_x)
    return fx, fy, torque, share * flow + through * c * R * R


@allocating
def _film(
    law: PortLaw,
    columns: Floats,
    bare: Floats,
    eps: float,
    alpha: float,
    along: float,
    across: float,
    c: float,
    mu: float,
    R: float,
    supply_Pa: float,
) -> tuple[float, float, float, float, float, float]:
    """Scaled force (x, y) of the film cut off where it would hold suction, and of the unfed one cut
    off alike; scaled flow of all feeds; and the share of the suction that is left."""
    n = law.angle_rad.size
    scale, unit = 12 * mu * (R / c) ** 2, c * R * R
    film, free = np.empty((n, n)), np.zeros(n)
    supply, square, plain = np.empty(n), np.empty(n), np.empty(n)
    hydro, clipped, flow, height = np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    at = EACH * n
    for k in range(n):
        h = 1 - eps * math.cos(alpha - law.angle_rad[k])
        height[k] = h * math.sqrt(h)
        hydro[k] = (columns[EACH * k] * along + columns[EACH * k + 1] * across) / (
            height[k] * height[k]
        )
        clipped[k] = max(hydro[k], 0.0)
        own = law.own_Pa[k]
        supply[k] = (max(supply_Pa, 0.0) if math.isnan(own) else own) / scale
        per_h2 = 1 / (c * h * c * h)
        square[k] = (law.restrictor[k, 0] + law.restrictor[k, 1] * per_h2) * unit * unit / scale
        plain[k] = (law.restrictor[k, 2] + law.restrictor[k, 3] * per_h2) * mu * unit / scale
        for j in range(k + 1):
            film[k, j] = film[j, k] = columns[at] * height[k] * height[j]
            at += 1
    for k in range(n):
        for j in range(n):
            free[k] += film[k, j] * clipped[j]
    pressure = balance_ports(film, free, supply, square, plain, flow)
    field = bare.copy()
    _add_fields(columns, pressure - clipped, field)
    left = whole = 0.0
    for i in range(STATIONS):
        left += max(0.0, -field[i])
        whole += max(0.0, -bare[i])
    share = min(1.0, left / whole) if whole > 0.0 else 0.0
    free[:] = 0.0
    for k in range(n):
        clipped[k] = (1 - share) * hydro[k] + share * clipped[k]
    for k in range(n):
        for j in range(n):
            free[k] += film[k, j] * clipped[j]
    pressure = balance_ports(film, free, supply, square, plain, flow)
    field[:] = bare
    _add_fields(columns, pressure - hydro, field)
    second = np.zeros(STATIONS)
    _add_fields(columns, pressure - clipped, second)
    cut_x = cut_y = bare_x = bare_y = through = 0.0
    for i in range(STATIONS):
        positive = max(bare[i], 0.0)
        other = second[i] + (1 - share) * bare[i] + share * positive
        kept = max(0.0, min(field[i], other))
        cut_x -= kept * law.ring[0, i]
        cut_y -= kept * law.ring[1, i]
        bare_x -= positive * law.ring[0, i]
        bare_y -= positive * law.ring[1, i]
    for k in range(n):
        through += flow[k]
    return cut_x, cut_y, bare_x, bare_y, through, share


@allocating
def _add_fields(columns: Floats, pressure: Floats, field: Floats) -> None:
    for k in range(pressure.size):
        at = EACH * k + 2
        for i in range(STATIONS):
            field[i] += pressure[k] * columns[at + i]
