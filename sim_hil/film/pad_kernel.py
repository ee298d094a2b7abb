"""The tabulated film between fixed pads, callable from other compiled kernels: no allocation, no
Python objects.

Beside the effective squeeze velocity `v_s` of `table_kernel` the pads' own curvature drives the
film, at a rate `w = |omega| c s / 2` with `s` the pads' shift over the clearance.  The film is
positively homogeneous in both together, so that with `tau = w / (|v_s| + w)`

    F = (12 mu R^4 / c^3) (|v_s| + w) exp(S) D,   Q = R^2 (|v_s| + w) D_q

where `S` is a function of the eccentricity over its reach, of the angle from the eccentricity to
`v_s`, and of tau, and D (along the eccentricity, 90 degrees from it), D_q and the share of the
friction that comes from the pads' curvature are functions of those and of the angle from the first
pad to the eccentricity, which repeats from pad to pad.  The other way round the film is its mirror
image where the pads stand nearest in their middles; a bore of offset pads turns one way.
A moving clearance acts as in `table_kernel` at standstill, which neglects what it does to the pads'
own wedge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_hil.jit import kernel

from .fed_kernel import _place
from .pad_shape import PadShape, pad_gap, pad_reach, pad_shear
from .records import Floats
from .table_kernel import CONTACT_FRICTION, CONTACT_STIFFNESS_N_M, EPS_TABLE

_NEAR_CONTACT = 0.97
"""Share of the reach from which on the asperities are looked at, which touch by the gap."""


class PadLaw(NamedTuple):
    """What `pad_force` needs.

    Parameters
    ----------
    shape
        Of the pads.
    size
        Cubic B-spline coefficients of S, shape (cells of -log(1 - eps) + 3, cells of the turn from
        the eccentricity + 3, cells of tau + 3).
    share
        Those of (D_r, D_t, D_q, D_w): (cells of eps + 3, cells of a pad's pitch + 3, cells of the
        turn + 3, cells of tau + 3, 4).
    """

    shape: PadShape
    size: Floats
    share: Floats


@kernel
def pad_share(
    law: PadLaw, eps: float, alpha: float, gamma: float, tau: float
) -> tuple[float, float, float, float]:
    """exp(S) D_r, exp(S) D_t, exp(S) D_w and D_q at an eccentricity in [0, EPS_TABLE], alpha in
    [0, pitch), gamma in [0, 2 pi) and tau in [0, 1]."""
    share = law.share
    n_alpha, n_gamma, n_tau = share.shape[1], share.shape[2], share.shape[3]
    n_eps = share.shape[0]
    per_log = (n_eps - 3) / -math.log1p(-EPS_TABLE)
    i, wi = _place(-math.log1p(-eps) * per_log, n_eps - 3)
    j, wj = _place(alpha * (law.shape.pads * (n_alpha - 3) / (2 * math.pi)), n_alpha - 3)
    k, wk = _place(gamma * ((n_gamma - 3) / (2 * math.pi)), n_gamma - 3)
    m, wm = _place(tau * (n_tau - 3), n_tau - 3)
    size = radial = across = flow = wedge = 0.0
    for a in range(4):
        for g in range(4):
            for t in range(4):
                size += wi[a] * wk[g] * wm[t] * law.size[i + a, k + g, m + t]
    for a in range(4):
        for b in range(4):
            for g in range(4):
                weight = wi[a] * wj[b] * wk[g]
                for t in range(4):
                    each = weight * wm[t]
                    radial += each * share[i + a, j + b, k + g, m + t, 0]
                    across += each * share[i + a, j + b, k + g, m + t, 1]
                    flow += each * share[i + a, j + b, k + g, m + t, 2]
                    wedge += each * share[i + a, j + b, k + g, m + t, 3]
    scale = math.exp(size)
    return scale * radial, scale * across, scale * wedge, flow


@kernel
def pad_force(
    law: PadLaw,
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
    """Force (fx, fy), N, braking friction torque, N m, and side flow, m3/s; arguments as
    `table_force`."""
    count, angle, half_arc, shift, nearest = law.shape
    mirror = 1.0 if omega >= 0.0 else -1.0
    # a journal that turns the other way, seen in a mirror through the middle of the first pad
    ca, sa = math.cos(angle), math.sin(angle)
    x, y = (ex * ca + ey * sa) / c, mirror * (ey * ca - ex * sa) / c
    wx, wy = vx * ca + vy * sa, mirror * (vy * ca - vx * sa)
    e = math.sqrt(x * x + y * y)
    ux, uy = (x / e, y / e) if e > 0.0 else (1.0, 0.0)
    reach = pad_reach(count, 0.0, half_arc, shift, nearest, ux, uy)
    eps = min(e / reach, EPS_TABLE)
    film_x, film_y = eps * reach * ux, eps * reach * uy
    turn = mirror * omega
    sx, sy = wx + 0.5 * turn * film_y * c, wy - 0.5 * turn * film_x * c
    if c_rate != 0.0:
        pull = 3.0 * c_rate / (1.0 + 2.0 * eps * eps)
        sx, sy = sx - pull * film_x, sy - pull * film_y
    squeeze, wedge = math.sqrt(sx * sx + sy * sy), 0.5 * turn * c * shift
    total = squeeze + wedge
    fx = fy = flow = lean = 0.0
    if total > 0.0:
        pitch = 2 * math.pi / count
        alpha = math.atan2(uy, ux) + 0.5 * pitch
        alpha -= pitch * math.floor(alpha / pitch)
        gamma = math.atan2(ux * sy - uy * sx, ux * sx + uy * sy)
        gamma = gamma + 2 * math.pi if gamma < 0 else gamma
        radial, across, bent, through = pad_share(law, eps, alpha, gamma, wedge / total)
        gain = 12 * mu * R * (R / c) ** 3 * total
        fx = gain * (radial * ux - across * uy)
        fy = gain * (radial * uy + across * ux)
        lean, flow = gain * c * bent, R * R * total * through
    shear = pad_shear(count, 0.0, half_arc, shift, nearest, film_x, film_y)
    torque = mu * turn * R * R * R * L / c * shear
    torque += 0.5 * c * (film_x * fy - film_y * fx) - lean
    if eps >= _NEAR_CONTACT:
        film, nx, ny = pad_gap(count, 0.0, half_arc, shift, nearest, x, y)
        normal = max(0.0, CONTACT_STIFFNESS_N_M * c * (1.0 - EPS_TABLE - film))
        rub = CONTACT_FRICTION * normal if omega != 0.0 else 0.0
        fx, fy = fx - normal * nx + rub * ny, fy - normal * ny - rub * nx
        torque += rub * R
    fy *= mirror
    return fx * ca - fy * sa, fx * sa + fy * ca, torque, flow
