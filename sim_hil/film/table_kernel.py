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

from .elementary import angle_of, exp_of, log_of, turn_of
from .records import Floats

EPS_TABLE = 0.99
CONTACT_STIFFNESS_N_M = 5e8
CONTACT_FRICTION = 0.1
RATE_LIMIT = 0.2
"""First order in the clearance rate up to here, squeeze against the moving wall from twice that
on."""
_MAX_TURN = math.pi / 2
_SIXTH = 1 / 6
_PER_LOG = -1 / math.log1p(-EPS_TABLE)
_1, _2, _3 = (
    np.uint64(1),
    np.uint64(2),
    np.uint64(3),
)  # unsigned: no check for an index from the end

_LEAST_SQUEEZE = 1e-40
_LEAST_SHARE = 1e-4
"""Square of the squeeze velocity, m2/s2, and eccentricity ratio below which neither has a
direction."""

Four = tuple[float, float, float, float]
Eight = tuple[float, float, float, float, float, float, float, float]


@inlined
def _weights(t: float) -> Four:
    """Uniform cubic B-spline weights at t in [0, 1] of a cell."""
    s = 1.0 - t
    return (
        s * s * s * _SIXTH,
        (4 - 3 * t * t * (2 - t)) * _SIXTH,
        (4 - 3 * s * s * (2 - s)) * _SIXTH,
        t * t * t * _SIXTH,
    )


@inlined
def _cell_at(
    coefficients: Floats, eps: float, gamma: float
) -> tuple[np.uint64, np.uint64, float, float]:
    """Where to look: cell of an eccentricity ratio in [0, EPS_TABLE] and an angle in [0, pi], and
    the place within it, each in [0, 1]."""
    rows = coefficients.shape[0] - 3
    columns = coefficients.shape[1] - 3
    u = -log_of(1.0 - eps) * (rows * _PER_LOG)
    v = gamma * (columns * (1 / math.pi))
    i = min(max(int(u), 0), rows - 1)  # what is no number looks into the first cell, and gives none
    j = min(max(int(v), 0), columns - 1)
    return np.uint64(i), np.uint64(j), u - i, v - j


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
    i, j, u, v = _cell_at(coefficients, eps, gamma)
    cell = i, j, _weights(u), _weights(v)
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
    across = film_x * sy - film_y * sx
    gamma = angle_of(abs(across), film_x * sx + film_y * sy)
    a, d, q = lookup(coefficients, eps, gamma, ratio)
    gain = -12 * mu * R * (R / c) ** 3 * exp_of(a)
    cosine, sine = turn_of(math.copysign(min(max(d, -_MAX_TURN), _MAX_TURN), d * across))
    fx = gain * (cosine * sx - sine * sy)
    fy = gain * (sine * sx + cosine * sy)
    flow = R * R * squeeze * q
    sense = -1.0 if omega < 0 else 1.0
    shear = 2 * math.pi * mu * abs(omega) * R * R * R * L / (c * math.sqrt(1 - eps * eps))
    torque = shear + sense * 0.5 * (film_x * fy - film_y * fx)
    return fx + contact_x, fy + contact_y, torque + rub * R, flow


@inlined
def _weight_slopes(t: float) -> Four:
    """Derivatives of :func:`_weights`."""
    s = 1.0 - t
    return -0.5 * s * s, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), 0.5 * t * t


@inlined
def _surface(
    coefficients: Floats, i: np.uint64, j: np.uint64, u: Four, du: Four, v: Four, dv: Four, k: int
) -> tuple[float, float, float]:
    """One value of the table in a cell, and its slopes by the two coordinates, both in cells."""
    p0, p1 = _line(coefficients, i, j, v, k), _line(coefficients, i + _1, j, v, k)
    p2, p3 = _line(coefficients, i + _2, j, v, k), _line(coefficients, i + _3, j, v, k)
    d0, d1 = _line(coefficients, i, j, dv, k), _line(coefficients, i + _1, j, dv, k)
    d2, d3 = _line(coefficients, i + _2, j, dv, k), _line(coefficients, i + _3, j, dv, k)
    return (
        (u[0] * p0 + u[1] * p1) + (u[2] * p2 + u[3] * p3),
        (du[0] * p0 + du[1] * p1) + (du[2] * p2 + du[3] * p3),
        (u[0] * d0 + u[1] * d1) + (u[2] * d2 + u[3] * d3),
    )


@inlined
def table_slopes(
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
    c_rate: float,
) -> tuple[Four, Eight]:
    """What :func:`table_force` gives within EPS_TABLE, and its slopes at a fixed clearance rate.

    With the squeeze velocity `s`, the turned unit vector and F as in the module, the slopes are

        dF = F da + (z x F) d(turn) + G ds,   d(gamma) = (s x ds) / s^2 - (e x de) / e^2

    where G is the turned gain and `a`, `turn` change with the eccentricity ratio and with gamma.
    What a moving clearance adds to `a` and `turn` counts in the force, not in the slopes.

    Returns
    -------
    forces, slopes
        fx, fy, N, torque, N m, flow, m3/s; dF/de (xx, xy, yx, yy), N/m, then dF/dv, N s/m.
    """
    per_c = 1 / c
    e = math.sqrt(ex * ex + ey * ey)
    eps = e * per_c
    sx, sy, ratio = vx + 0.5 * omega * ey, vy - 0.5 * omega * ex, 0.0
    if c_rate != 0.0:
        sx, sy, ratio = _moving_wall(sx, sy, ex, ey, c, c_rate)
    s2 = sx * sx + sy * sy
    across = ex * sy - ey * sx
    i, j, u, v = _cell_at(coefficients, eps, angle_of(abs(across), ex * sx + ey * sy))
    rows, columns = coefficients.shape[0] - 3, coefficients.shape[1] - 3
    wu, wv, du, dv = _weights(u), _weights(v), _weight_slopes(u), _weight_slopes(v)
    a, a_u, a_v = _surface(coefficients, i, j, wu, du, wv, dv, 0)
    d, d_u, d_v = _surface(coefficients, i, j, wu, du, wv, dv, 1)
    q = _blend(coefficients, (i, j, wu, wv), 2)
    if ratio != 0.0:
        a += ratio * _blend(coefficients, (i, j, wu, wv), 3)
        d += ratio * _blend(coefficients, (i, j, wu, wv), 4)
    sense = math.copysign(1.0, across)
    r_c = R * per_c
    gain = -12 * mu * R * (r_c * r_c * r_c) * exp_of(a)
    cosine, sine = turn_of(sense * min(max(d, -_MAX_TURN), _MAX_TURN))
    gc, gs = gain * cosine, gain * sine
    fx, fy = gc * sx - gs * sy, gs * sx + gc * sy
    per_gamma = columns * (1 / math.pi)
    a_v, d_v = sense * per_gamma * a_v, per_gamma * d_v
    round_x, round_y = a_v * fx - d_v * fy, a_v * fy + d_v * fx
    radius, share = max(e, _LEAST_SHARE * c), c * (1.0 - eps)
    per_s, per_share = 1 / (s2 + _LEAST_SQUEEZE), 1 / (share * radius)
    per_e = (per_share * share) * (per_share * share)
    cxx, cxy = gc - round_x * sy * per_s, round_x * sx * per_s - gs
    cyx, cyy = gs - round_y * sy * per_s, round_y * sx * per_s + gc
    outward = rows * _PER_LOG * per_share
    a_u, d_u = a_u * outward, sense * d_u * outward
    out_x, out_y = a_u * fx - d_u * fy, a_u * fy + d_u * fx
    half = 0.5 * omega
    slopes = (
        out_x * ex + round_x * ey * per_e - half * cxy,
        out_x * ey - round_x * ex * per_e + half * cxx,
        out_y * ex + round_y * ey * per_e - half * cyy,
        out_y * ey - round_y * ex * per_e + half * cyx,
        cxx,
        cxy,
        cyx,
        cyy,
    )
    shear = 2 * math.pi * mu * abs(omega) * R * R * L * r_c / math.sqrt(1 - eps * eps)
    torque = shear + math.copysign(0.5, omega) * (ex * fy - ey * fx)
    return (fx, fy, torque, R * R * math.sqrt(s2) * q), slopes
