"""The rotor of equation (2) alone: four degrees of freedom on a film and a coupling, both on firm
ground.

Coordinates `x, y, A = dx/dz, B = dy/dz`; the equation with its omissions mended is that of
`rotor.kernel`. One step is ROS2 (Verwer, Spee, Blom and Hundsdorfer 1999), second order and
L-stable with gamma = 1 - 1/sqrt(2):

    (I - gamma dt J) k1 = dt f(w),   (I - gamma dt J) k2 = dt f(w + k1) - 2 k1,   w += 3/2 k1 + 1/2
    k2

J holds the film alone (the rest is not stiff) and is renewed every few steps, and when the journal
has moved by a share of its gap since, or its squeeze has turned: ROS2 keeps its order with any J,
its stability needs one that is near.  Near contact, where the film is not smooth over a step, the
step is linearly implicit Euler's (:mod:`sim_hil.rotor.film_step`); so it is where the squeeze of a
fed film turns within the step: between a ruptured film that retreats and a full one that
approaches, ROS2 has fixed points of its own, where a loaded journal hangs in mid-air.
"""

from __future__ import annotations

import math

from numba import njit, prange

from sim_hil.jit import inlined, kernel
from sim_hil.rotor.bearing import bearing_force, gap, heat_oil, oil_now
from sim_hil.rotor.film_law import Forces, Law, is_fed
from sim_hil.rotor.film_step import crossing, film_slopes, turned
from sim_hil.rotor.kernel import GRAVITY, move_actuator
from sim_hil.rotor.parameters import (
    ANGLE,
    CLEARANCE,
    FLOW,
    OIL,
    POWER,
    PRESSURE,
    ActuatorParameters,
    Eight,
    FilmOil,
    FilmParameters,
    Floats,
    Four,
    Shaft,
    Two,
)

GAMMA = 1 - math.sqrt(0.5)
RENEW_STEPS = 4
_RENEW_SHARE = 0.1
COLUMNS = (
    "x_m",
    "y_m",
    "vx_m_s",
    "vy_m_s",
    "min_film_m",
    "clearance_m",
    "power_W",
    "oil_C",
    "angle_rad",
    "side_flow_m3_s",
    "pressure_Pa",
)
"""Columns of the output: journal at the bearing; smallest film, mean power and side flow since the
row before."""


@inlined
def journal(shaft: Shaft, w: Eight) -> Four:
    """Place and velocity of the journal at the bearing: x, y, m, and their rates."""
    b = shaft.to_bearing
    return w[0] + b * w[2], w[1] + b * w[3], w[4] + b * w[6], w[5] + b * w[7]


@inlined
def squeeze(shaft: Shaft, w: Eight, omega: float) -> Two:
    """Effective squeeze velocity of the film, m/s."""
    ex, ey, vx, vy = journal(shaft, w)
    return vx + 0.5 * omega * ey, vy - 0.5 * omega * ex


@inlined
def direction(shaft: Shaft, angle: float) -> Two:
    """Cosine and sine of the unbalance's angle."""
    return math.cos(angle + shaft.unbalance_angle), math.sin(angle + shaft.unbalance_angle)


@inlined
def rates(
    shaft: Shaft, force: Forces, w: Eight, heavy: Two, omega: float, alpha: float, load: float
) -> Eight:
    """Rates of change of ``w``: the coordinates (x, y, A, B) and their rates.

    `force` is the film's, `heavy` the direction of the unbalance, `load` the total static load at
    the bearing, N.
    """
    s, b, d = shaft, shaft.to_bearing, shaft.to_coupling
    x, y, tilt_x, tilt_y, x_rate, y_rate, tilt_x_rate, tilt_y_rate = w
    fx, fy, cosine, sine = force[0], force[1], heavy[0], heavy[1]
    gravity_share = s.mass * GRAVITY * d / (b + d)
    bx = fx + s.unbalance * (omega * omega * cosine + alpha * sine)
    by = fy + s.unbalance * (omega * omega * sine - alpha * cosine) - (load - gravity_share)
    k, damping = s.coupling_stiffness, s.coupling_damping
    cx = -k * (x - d * tilt_x) - damping * (x_rate - d * tilt_x_rate)
    cy = (
        -k * (y - d * tilt_y)
        - damping * (y_rate - d * tilt_y_rate)
        + s.mass * GRAVITY
        - gravity_share
    )
    return (
        x_rate,
        y_rate,
        tilt_x_rate,
        tilt_y_rate,
        (bx + cx) / s.mass,
        (by + cy) / s.mass - GRAVITY,
        (b * bx - d * cx - s.polar * (omega * tilt_y_rate + alpha * tilt_y)) / s.diametral,
        (b * by - d * cy + s.polar * (omega * tilt_x_rate + alpha * tilt_x)) / s.diametral,
    )


@inlined
def solve_stage(shaft: Shaft, slopes: Eight, reach: float, move: Eight) -> Eight:
    """Solve `(I - reach J) k = move` for positions and rates, with the film as the only J."""
    b = shaft.to_bearing
    mobility = 1 / shaft.mass + b * b / shaft.diametral
    kxx, kxy, kyx, kyy, cxx, cxy, cyx, cyy = slopes
    m0, m1, m2, m3, m4, m5, m6, m7 = move
    ex, ey, vx, vy = m0 + b * m2, m1 + b * m3, m4 + b * m6, m5 + b * m7
    gxx, gxy, gyx, gyy = cxx + reach * kxx, cxy + reach * kxy, cyx + reach * kyx, cyy + reach * kyy
    h = reach * mobility
    rx = vx + h * (kxx * ex + kxy * ey)
    ry = vy + h * (kyx * ex + kyy * ey)
    mxx, mxy, myx, myy = 1 - h * gxx, -h * gxy, -h * gyx, 1 - h * gyy
    det = mxx * myy - mxy * myx
    ux, uy = (myy * rx - mxy * ry) / det, (mxx * ry - myx * rx) / det
    fx, fy = (ux - vx) / mobility, (uy - vy) / mobility
    k4, k5 = m4 + fx / shaft.mass, m5 + fy / shaft.mass
    k6, k7 = m6 + b * fx / shaft.diametral, m7 + b * fy / shaft.diametral
    return m0 + reach * k4, m1 + reach * k5, m2 + reach * k6, m3 + reach * k7, k4, k5, k6, k7


@inlined
def mixed(p: float, a: Eight, q: float, b: Eight) -> Eight:
    """`p a + q b`."""
    return (
        p * a[0] + q * b[0],
        p * a[1] + q * b[1],
        p * a[2] + q * b[2],
        p * a[3] + q * b[3],
        p * a[4] + q * b[4],
        p * a[5] + q * b[5],
        p * a[6] + q * b[6],
        p * a[7] + q * b[7],
    )


@inlined
def step(
    shaft: Shaft,
    film: FilmParameters,
    law: Law,
    oil: FilmOil,
    slopes: Eight,
    rough: bool,
    force: Forces,
    w: Eight,
    heavy: Two,
    ahead: Two,
    omega: float,
    alpha: float,
    load: float,
    c: float,
    c_rate: float,
    dt: float,
) -> Eight:
    """State after one step (numbers, not arrays: these stay in registers).

    `force` acts at its start; the unbalance points in the direction `heavy` there and `ahead` at
    its end.
    """
    rate = rates(shaft, force, w, heavy, omega, alpha, load)
    if rough:
        after: Eight = mixed(
            1.0, w, 1.0, solve_stage(shaft, slopes, dt, mixed(dt, rate, 0.0, rate))
        )
    else:
        k1 = solve_stage(shaft, slopes, GAMMA * dt, mixed(dt, rate, 0.0, rate))
        probe = mixed(1.0, w, 1.0, k1)
        if is_fed(law) and turned(*squeeze(shaft, probe, omega), *squeeze(shaft, w, omega)):
            euler: Eight = mixed(
                1.0, w, 1.0, solve_stage(shaft, slopes, dt, mixed(dt, rate, 0.0, rate))
            )
            return euler
        omega += alpha * dt
        ex, ey, vx, vy = journal(shaft, probe)
        force = bearing_force(law, film, oil, ex, ey, vx, vy, omega, c, c_rate)
        rate = rates(shaft, force, probe, ahead, omega, alpha, load)
        k2 = solve_stage(shaft, slopes, GAMMA * dt, mixed(dt, rate, -2.0, k1))
        after = mixed(1.0, mixed(1.0, w, 1.5, k1), 0.5, k2)
    return after


@kernel
def advance_rotor(
    shaft: Shaft,
    film: FilmParameters,
    act: ActuatorParameters,
    law: Law,
    w: Floats,
    scalar: Floats,
    drive: Floats,
    target: Floats,
    period: float,
    substeps: int,
    renew: int,
    out: Floats,
) -> None:
    """Advance by `len(out)` periods of `substeps` steps, renewing J every `renew` steps.

    Parameters
    ----------
    w, scalar
        State (8,) and the scalars of `rotor.parameters`, in place.
    drive
        Speed, rad/s, and load, N, at the borders of the periods, shape (n + 1, 2).
    target
        Clearance, m, and pressure, Pa, at the start of each period, shape (n, 2).
    out
        Written: `COLUMNS`, shape (n, 11).
    """
    dt = period / substeps
    now = (w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7])
    slopes = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    age, old_x, old_y, old_sx, old_sy = renew, 0.0, 0.0, 0.0, 0.0
    heavy = direction(shaft, scalar[ANGLE])
    for n in range(out.shape[0]):
        alpha = (drive[n + 1, 0] - drive[n, 0]) / period
        load_rate = (drive[n + 1, 1] - drive[n, 1]) / period
        c = scalar[CLEARANCE] + film.wear
        c_rate = move_actuator(act, scalar, target[n, 0], target[n, 1], period)
        oil = oil_now(film, scalar)
        power, flow, smallest = 0.0, 0.0, 1e9
        for i in range(substeps):
            omega, load = drive[n, 0] + alpha * dt * i, drive[n, 1] + load_rate * dt * i
            ex, ey, vx, vy = journal(shaft, now)
            force = bearing_force(law, film, oil, ex, ey, vx, vy, omega, c, c_rate)
            thin = gap(film, ex, ey, c)
            rough = crossing(thin, vx, vy, c, dt)
            sx, sy = vx + 0.5 * omega * ey, vy - 0.5 * omega * ex
            dx, dy, near = ex - old_x, ey - old_y, _RENEW_SHARE * max(thin, 0.01 * c)
            moved = dx * dx + dy * dy > near * near
            if rough or moved or age >= renew or turned(sx, sy, old_sx, old_sy):
                slopes = film_slopes(law, film, oil, force, ex, ey, vx, vy, omega, c, c_rate)
                age, old_x, old_y, old_sx, old_sy = 0, ex, ey, sx, sy
            age += 1
            scalar[ANGLE] += (omega + 0.5 * alpha * dt) * dt
            ahead = direction(shaft, scalar[ANGLE])
            now = step(
                shaft,
                film,
                law,
                oil,
                slopes,
                rough,
                force,
                now,
                heavy,
                ahead,
                omega,
                alpha,
                load,
                c,
                c_rate,
                dt,
            )
            heavy = ahead
            power += (
                force[2] * abs(omega)
                - (force[0] * vx + force[1] * vy)
                + film.windage * abs(omega) ** 3
            )
            flow += force[3]
            c += c_rate * dt
            ex, ey, _, _ = journal(shaft, now)
            smallest = min(smallest, gap(film, ex, ey, c))
        scalar[POWER], scalar[FLOW] = power / substeps, force[3]
        heat_oil(film, scalar, period)
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = journal(shaft, now)
        out[n, 4], out[n, 5], out[n, 6], out[n, 7] = smallest, c, scalar[POWER], scalar[OIL]
        out[n, 8], out[n, 9], out[n, 10] = scalar[ANGLE], flow / substeps, scalar[PRESSURE]
    for i in range(8):
        w[i] = now[i]


@njit(parallel=True, cache=True)
def advance_rotors(
    shaft: Shaft,
    film: FilmParameters,
    act: ActuatorParameters,
    law: Floats,
    w: Floats,
    scalar: Floats,
    drive: Floats,
    target: Floats,
    period: float,
    substeps: int,
    renew: int,
    out: Floats,
) -> None:
    """Many rotors on the table film, one a thread: the arrays of `advance_rotor` with a leading
    axis."""
    for r in prange(w.shape[0]):
        advance_rotor(
            shaft,
            film,
            act,
            law,
            w[r],
            scalar[r],
            drive[r],
            target[r],
            period,
            substeps,
            renew,
            out[r],
        )
