"""The film with one axial groove, callable from other compiled kernels: no allocation, no Python
objects.

Reynolds rupture at ambient pressure between ambient ends, one groove held at its supply pressure
`p_s`. With the effective squeeze velocity `v_s = v - (omega/2) z x e`, the unfed film (F0, Q0) of
`table_kernel` and

    tau = f / (|F0| + f),   f = 2 R L p_s

(tau is 0 with a groove at ambient pressure, 1 in a hydrostatic bearing where nothing moves)
the film is positively homogeneous in (v_s, p_s) together, so that

    F = F0 + (|F0| + f) D,   Q = Q0 + (|F0| + f) / (2 R L) c^3 / (12 mu) D_q

where D (along the eccentricity and 90 degrees from it) and D_q are functions of four numbers only:
eccentricity ratio, angle from the groove to the eccentricity, angle from the eccentricity to v_s,
and tau. A moving clearance acts as in the unfed film; its interplay with the groove is neglected.
"""

import math
from typing import NamedTuple

import numpy as np

from sim_hil.jit import inlined, kernel

from .records import Floats
from .table_kernel import EPS_TABLE, Four, _weights, table_force

_1, _2, _3 = np.uint64(3), np.uint64(6), np.uint64(9)  # from one value of tau to the next ones


class FedLaw(NamedTuple):
    """What `fed_force` needs.

    Parameters
    ----------
    unfed
        `FilmTable.coefficients` of the same length over diameter.
    groove
        Cubic B-spline coefficients of (D_r, D_t, D_q), shape (cells of -log(1 - eps) + 3, cells of
        the half turn from the groove + 3, cells of the turn from the eccentricity + 3, cells of tau
        + 3, 3).
    groove_angle_rad
        Where the middle of the groove is.
    """

    unfed: Floats
    groove: Floats
    groove_angle_rad: float


@inlined
def _place(u: float, cells: int) -> tuple[int, Four]:
    """Cell of a coordinate that counts cells, and the spline weights there."""
    i = min(max(int(u), 0), cells - 1)
    return i, _weights(u - i)


@kernel
def groove_share(
    groove: Floats, eps: float, alpha: float, gamma: float, tau: float
) -> tuple[float, float, float]:
    """(D_r, D_t, D_q) at an eccentricity ratio in [0, EPS_TABLE], angles in [-pi, pi] and tau in
    [0, 1]."""
    mirror = alpha < 0
    if mirror:
        alpha, gamma = -alpha, -gamma
    if gamma < 0:
        gamma += 2 * math.pi
    n_eps, n_alpha, n_gamma, n_tau = (
        groove.shape[0],
        groove.shape[1],
        groove.shape[2],
        groove.shape[3],
    )
    i, wi = _place(-math.log1p(-eps) * ((n_eps - 3) / -math.log1p(-EPS_TABLE)), n_eps - 3)
    j, wj = _place(alpha * ((n_alpha - 3) / math.pi), n_alpha - 3)
    k, wk = _place(gamma * ((n_gamma - 3) / (2 * math.pi)), n_gamma - 3)
    m, (w0, w1, w2, w3) = _place(tau * (n_tau - 3), n_tau - 3)
    flat = groove.reshape(-1)
    radial = across = flow = 0.0
    for a in range(4):
        for b in range(4):
            for g in range(4):
                weight = wi[a] * wj[b] * wk[g]
                row = (((i + a) * n_alpha + j + b) * n_gamma + k + g) * n_tau + m
                s = np.uint64(3 * row)  # unsigned: no check for an index from the end
                t, q = s + np.uint64(1), s + np.uint64(2)
                radial += weight * (
                    w0 * flat[s] + w1 * flat[s + _1] + w2 * flat[s + _2] + w3 * flat[s + _3]
                )
                across += weight * (
                    w0 * flat[t] + w1 * flat[t + _1] + w2 * flat[t + _2] + w3 * flat[t + _3]
                )
                flow += weight * (
                    w0 * flat[q] + w1 * flat[q + _1] + w2 * flat[q + _2] + w3 * flat[q + _3]
                )
    return radial, -across if mirror else across, flow


@kernel
def fed_force(
    law: FedLaw,
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
) -> tuple[float, float, float, float, float]:
    """Force (fx, fy), N, braking friction torque, N m, side flow and feed flow, m3/s, of the film
    with a groove.

    Parameters
    ----------
    law
        `FedTable.law` of this length over diameter and groove.
    ex, ey, vx, vy, omega, c, mu, R, L, c_rate
        As in `table_force`.
    supply_Pa
        Pressure in the groove above ambient, Pa; below zero it counts as zero.

    Notes
    -----
    The feed flow is what the balance of oil asks: side flow and the growth of the gap. Past
    EPS_TABLE as `table_force`. Zero supply pressure is a groove at ambient pressure, not the film
    without groove.
    """
    fx, fy, torque, flow = table_force(law.unfed, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)
    supply = max(supply_Pa, 0.0)
    e = math.hypot(ex, ey)
    held = min(1.0, EPS_TABLE * c / e) if e > 0.0 else 1.0
    film_x, film_y = held * ex, held * ey
    sx = vx + 0.5 * omega * film_y
    sy = vy - 0.5 * omega * film_x
    if e > EPS_TABLE * c:  # the groove adds to the film, not to the contact
        unfed_x, unfed_y, _, _ = table_force(
            law.unfed, film_x, film_y, vx, vy, omega, c, mu, R, L, c_rate
        )
    else:
        unfed_x, unfed_y = fx, fy
    area = 2 * R * L * supply
    scale = math.hypot(unfed_x, unfed_y) + area
    if scale > 0.0:
        way_x, way_y = (ex / e, ey / e) if e > 0.0 else (1.0, 0.0)
        alpha = math.atan2(way_y, way_x) - law.groove_angle_rad
        alpha -= 2 * math.pi * math.floor(alpha / (2 * math.pi) + 0.5)
        gamma = math.atan2(way_x * sy - way_y * sx, way_x * sx + way_y * sy)
        radial, across, more = groove_share(
            law.groove, min(e / c, EPS_TABLE), alpha, gamma, area / scale
        )
        more_x = scale * (radial * way_x - across * way_y)
        more_y = scale * (radial * way_y + across * way_x)
        fx += more_x
        fy += more_y
        torque += math.copysign(0.5, omega) * (film_x * more_y - film_y * more_x)
        flow += scale / (2 * R * L) * c * c * c / (12 * mu) * more
    return fx, fy, torque, flow, flow + 2 * math.pi * R * L * c_rate
