"""The tabulated film force, callable from other compiled kernels: no allocation, no Python objects.

With the effective squeeze velocity `v_s = v - (omega/2) z x e` and the film's pressure part only,

    F = (12 mu R^4 / c^3) |v_s| exp(a + a' r) * (unit vector against v_s, turned by d + d' r)
    Q = R^2 |v_s| q

where a, d, q, a', d' are functions of the eccentricity ratio and of the angle from e to v_s only,
and `r = (dc/dt) / |v_s|` brings in a moving clearance to first order. Where it is not small
(standstill), the journal instead squeezes the film against the moving wall, `v_s - 3 eps / (1 + 2
eps^2) (dc/dt) e/|e|`: the radial velocity that gives the same force, exact for the short full film,
and within 2 % for a resting journal near contact. The logarithm keeps the table smooth over the
five decades of the force, and the force opposing v_s whatever the interpolation error.
"""

import math

import numpy as np

from sim_hil.jit import inlined, kernel

from .records import Floats

EPS_TABLE = 0.99
CONTACT_STIFFNESS_N_M = 5e8
CONTACT_FRICTION = 0.1
RATE_LIMIT = 0.2
"""First order in the clearance rate up to here, squeeze against the moving wall from twice that
on."""
_MAX_TURN = math.pi / 2
_PER_LOG = -1 / math.log1p(-EPS_TABLE)
_1, _2, _3 = (
    np.uint64(1),
    np.uint64(2),
    np.uint64(3),
)  # unsigned: no check for an index from the end

Four = tuple[float, float, float, float]


@inlined
def _weights(t: float) -> Four:
    """Uniform cubic B-spline weights at t in [0, 1] of a cell."""
    s = 1.0 - t
    return (
        s * s * s / 6,
        (4 - 3 * t * t * (2 - t)) / 6,
        (4 - 3 * s * s * (2 - s)) / 6,
        t * t * t / 6,
    )


@inlined
def _cell(
    coefficients: Floats, eps: float, gamma: float
) -> tuple[np.uint64, np.uint64, Four, Four]:
    """Where to look: cell of an eccentricity ratio in [0, EPS_TABLE] and an angle in [0, pi], and
    its weights."""
    rows = coefficients.shape[0] - 3
    columns = coefficients.shape[1] - 3
    u = -math.log(1.0 - eps) * (rows * _PER_LOG)
    v = gamma * (columns * (1 / math.pi))
    i = min(max(int(u), 0), rows - 1)  # what is no number looks into the first cell, and gives none
    j = min(max(int(v), 0), columns - 1)
    return np.uint64(i), np.uint64(j), _weights(u - i), _weights(v - j)


@inlined
def _line(coefficients: Floats, i: np.uint64, j: np.uint64, weights: Four, column: int) -> float:
    """One value of the table along one of the four lines of a cell."""
    v0, v1, v2, v3 = weights
    c0, c1 = coefficients[i, j, column], coefficients[i, j + _1, column]
    c2, c3 = coefficients[i, j + _2, column], coefficients[i, j + _3, column]
    value: float = (v0 * c0 + v1 * c1) + (v2 * c2 + v3 * c3)
    return value


@inlined
def _blend(
    coefficients: Floats, cell: tuple[np.uint64, np.uint64, Four, Four], column: int
) -> float:
    """One value of the table in a cell."""
    i, j, (u0, u1, u2, u3), v = cell
    value: float = u0 * _line(coefficients, i, j, v, column) + u1 * _line(
        coefficients, i + _1, j, v, column
    )
    value += u2 * _line(coefficients, i + _2, j, v, column) + u3 * _line(
        coefficients, i + _3, j, v, column
    )
    return value


@inlined
def lookup(
    coefficients: Floats, eps: float, gamma: float, ratio: float = 0.0
) -> tuple[float, float, float]:
    """Table values (a + a' r, d + d' r, q) at an eccentricity ratio in [0, EPS_TABLE], an angle in
    [0, pi] and `r`.

    `coefficients` has shape (cells of -log(1 - eps) + 3, cells of the angle + 3, 5).
    """
    cell = _cell(coefficients, eps, gamma)
    a, d, q = (
        _blend(coefficients, cell, 0),
        _blend(coefficients, cell, 1),
        _blend(coefficients, cell, 2),
    )
    if ratio != 0.0:
        a += ratio * _blend(coefficients, cell, 3)
        d += ratio * _blend(coefficients, cell, 4)
    return a, d, q


@kernel
def contact_force(ex: float, ey: float, omega: float, c: float) -> tuple[float, float, float]:
    """Force of the asperities on a journal past EPS_TABLE (fx, fy), N, and its rubbing part, N.

    A linear spring with Coulomb friction against the rotation, none at standstill: a static load W
    rests W / k beyond EPS_TABLE, also beyond the clearance itself.
    """
    e = math.hypot(ex, ey)
    if e <= EPS_TABLE * c:
        return 0.0, 0.0, 0.0
    normal = CONTACT_STIFFNESS_N_M * (e - EPS_TABLE * c)
    rub = CONTACT_FRICTION * normal if omega != 0.0 else 0.0
    along = -rub if omega < 0 else rub
    return (-normal * ex + along * ey) / e, (-normal * ey - along * ex) / e, rub


@kernel
def _moving_wall(
    sx: float, sy: float, ex: float, ey: float, c: float, c_rate: float
) -> tuple[float, float, float]:
    """Squeeze velocity against a wall of clearance rate ``c_rate``, and the ratio that is left to
    first order."""
    squeeze = math.hypot(sx, sy)
    if abs(c_rate) <= RATE_LIMIT * squeeze:
        return sx, sy, c_rate / max(squeeze, 1e-30)
    wall = (
        1.0
        if abs(c_rate) >= 2 * RATE_LIMIT * squeeze
        else abs(c_rate) / (RATE_LIMIT * squeeze) - 1.0
    )
    shift = wall * c_rate * 3 / (1 + 2 * (ex * ex + ey * ey) / (c * c)) / c
    return sx - shift * ex, sy - shift * ey, math.copysign((1 - wall) * RATE_LIMIT, c_rate)


@kernel
def table_force(
    coefficients: Floats,
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
) -> tuple[float, float, float, float]:
    """Force (fx, fy) on the journal, N, braking friction torque, N m, and side flow, m3/s, of the
    unfed film.

    Parameters
    ----------
    coefficients
        `FilmTable.coefficients` of this length over diameter.
    ex, ey, vx, vy, omega
        Journal centre, m, and its velocity, m/s, relative to the bearing; speed, rad/s, any sign or
        zero.
    c, mu, R, L
        Radial clearance, m, viscosity, Pa s, journal radius and bearing length, m, all above zero.
    c_rate
        Rate of change of the clearance, m/s.

    Notes
    -----
    Past EPS_TABLE the film stays that of EPS_TABLE and asperities carry the rest, with Coulomb
    friction against the surface. Finite for every finite state; conventions of `film_force`,
    Couette part full.
    """
    film_x, film_y, eps = ex, ey, math.sqrt(ex * ex + ey * ey) / c
    contact_x = contact_y = rub = 0.0
    if eps > EPS_TABLE:
        contact_x, contact_y, rub = contact_force(ex, ey, omega, c)
        film_x *= EPS_TABLE / eps
        film_y *= EPS_TABLE / eps
        eps = EPS_TABLE
    sx = vx + 0.5 * omega * film_y
    sy = vy - 0.5 * omega * film_x
    ratio = 0.0
    if c_rate != 0.0:
        sx, sy, ratio = _moving_wall(sx, sy, film_x, film_y, c, c_rate)
    squeeze = math.sqrt(sx * sx + sy * sy)
    gamma = math.atan2(film_x * sy - film_y * sx, film_x * sx + film_y * sy)
    a, d, q = lookup(coefficients, eps, abs(gamma), ratio)
    gain = -12 * mu * R * (R / c) ** 3 * math.exp(a)
    turn = min(max(d, -_MAX_TURN), _MAX_TURN)
    turn = -turn if gamma < 0 else turn
    fx = gain * (math.cos(turn) * sx - math.sin(turn) * sy)
    fy = gain * (math.sin(turn) * sx + math.cos(turn) * sy)
    flow = R * R * squeeze * q
    sense = -1.0 if omega < 0 else 1.0
    shear = 2 * math.pi * mu * abs(omega) * R * R * R * L / (c * math.sqrt(1 - eps * eps))
    torque = shear + sense * 0.5 * (film_x * fy - film_y * fx)
    return fx + contact_x, fy + contact_y, torque + rub * R, flow
