"""The rotor of equation (2) alone: four degrees of freedom on a film and a coupling, both on firm
ground.

Coordinates `x, y, A = dx/dz, B = dy/dz`; the equation with its omissions mended is that of
`rotor.kernel`. One step is the midpoint rule: unbalance, coupling and gyroscopic moment are taken
at a forecast of the middle of the step, and the film is solved for there
(:mod:`sim_hil.rotor.film_step` says how, and where the step is Euler's instead).
"""

from __future__ import annotations

from numba import njit, prange

from sim_hil.film.elementary import direction_of
from sim_hil.jit import inlined, kernel
from sim_hil.rotor.bearing import gap, heat_oil, oil_now
from sim_hil.rotor.film_law import Law
from sim_hil.rotor.film_step import crossing, meet_film, near
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
    FilmParameters,
    Floats,
    Four,
    Shaft,
)

RENEW_STEPS = 4
"""Steps for which the slopes of the film are kept where it is smooth."""
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
def moved(w: Eight, a: Four, share: float, dt: float) -> Eight:
    """The state after ``dt`` at accelerations ``a``, gone at the velocity ``share`` of the way."""
    into = share * dt
    return (
        w[0] + dt * (w[4] + into * a[0]),
        w[1] + dt * (w[5] + into * a[1]),
        w[2] + dt * (w[6] + into * a[2]),
        w[3] + dt * (w[7] + into * a[3]),
        w[4] + dt * a[0],
        w[5] + dt * a[1],
        w[6] + dt * a[2],
        w[7] + dt * a[3],
    )


@inlined
def without_film(
    shaft: Shaft, w: Eight, angle: float, omega: float, alpha: float, load: float
) -> Four:
    """Accelerations of the coordinates (x, y, A, B) without the film.

    `angle` is that of the shaft, `load` the total static load at the bearing, N.
    """
    s, b, d = shaft, shaft.to_bearing, shaft.to_coupling
    x, y, tilt_x, tilt_y, x_rate, y_rate, tilt_x_rate, tilt_y_rate = w
    cosine, sine = direction_of(angle + s.unbalance_angle)
    gravity_share = s.mass * GRAVITY * d / (b + d)
    bx = s.unbalance * (omega * omega * cosine + alpha * sine)
    by = s.unbalance * (omega * omega * sine - alpha * cosine) - (load - gravity_share)
    k, damping = s.coupling_stiffness, s.coupling_damping
    cx = -k * (x - d * tilt_x) - damping * (x_rate - d * tilt_x_rate)
    cy = (
        -k * (y - d * tilt_y)
        - damping * (y_rate - d * tilt_y_rate)
        + s.mass * GRAVITY
        - gravity_share
    )
    per_mass, per_inertia = 1 / s.mass, 1 / s.diametral
    return (
        (bx + cx) * per_mass,
        (by + cy) * per_mass - GRAVITY,
        (b * bx - d * cx - s.polar * (omega * tilt_y_rate + alpha * tilt_y)) * per_inertia,
        (b * by - d * cy + s.polar * (omega * tilt_x_rate + alpha * tilt_x)) * per_inertia,
    )


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
    s, b = shaft, shaft.to_bearing
    mobility = 1 / s.mass + b * b / s.diametral
    per_mass, per_inertia = 1 / s.mass, b / s.diametral
    now = (w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7])
    slopes = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    a = (0.0, 0.0, 0.0, 0.0)
    tries, age = 2, renew  # the first step knows no acceleration to forecast with
    per_period = 1 / period
    ex, ey, wx, wy = journal(s, now)
    gain_x = gain_y = 0.0
    thin = gap(film, ex, ey, scalar[CLEARANCE] + film.wear)
    for n in range(out.shape[0]):
        alpha = (drive[n + 1, 0] - drive[n, 0]) * per_period
        load_rate = (drive[n + 1, 1] - drive[n, 1]) * per_period
        c = scalar[CLEARANCE] + film.wear
        c_rate = move_actuator(act, scalar, target[n, 0], target[n, 1], period)
        oil = oil_now(film, scalar)
        power, flow, smallest = 0.0, 0.0, 1e9
        for i in range(substeps):
            half = (i + 0.5) * dt
            omega, load = drive[n, 0] + alpha * half, drive[n, 1] + load_rate * half
            middle = moved(now, a, 0.5, 0.5 * dt)
            angle = scalar[ANGLE] + 0.5 * dt * (omega - 0.25 * alpha * dt)
            a = without_film(s, middle, angle, omega, alpha, load)
            # the journal's own motion, which the next film waits for, comes straight from the film
            vx, vy = wx + gain_x, wy + gain_y
            x, y = ex + 0.5 * dt * vx, ey + 0.5 * dt * vy
            rough = crossing(thin, ex, ey, wx, wy, c, dt) or near(film, x, y, c)
            age += 1
            fresh = rough or age >= renew
            age = 0 if fresh else age
            force, mean, slopes, stale = meet_film(
                film, law, oil, slopes, fresh, rough, tries, (ex, ey, wx, wy),
                (wx, wy) if rough else (vx, vy),
                (a[0] + b * a[2], a[1] + b * a[3]), (mobility, mobility), 0.5 * dt, omega,
                c + 0.5 * dt * c_rate, c_rate, dt,
            )  # fmt: skip
            tries, age = 1, renew if stale else age
            fx, fy, vx, vy = mean
            a = (
                a[0] + fx * per_mass,
                a[1] + fy * per_mass,
                a[2] + fx * per_inertia,
                a[3] + fy * per_inertia,
            )
            scalar[ANGLE] += omega * dt
            power += force[2] * abs(omega) - (fx * vx + fy * vy) + film.windage * abs(omega) ** 3
            flow += force[3]
            c += c_rate * dt
            now = moved(now, a, 1.0 if rough else 0.5, dt)
            gain_x, gain_y = vx - wx, vy - wy
            ex, ey = ex + dt * vx, ey + dt * vy
            wx, wy = (vx, vy) if rough else (vx + gain_x, vy + gain_y)
            gain_x, gain_y = (0.5 * gain_x, 0.5 * gain_y) if rough else (gain_x, gain_y)
            thin = gap(film, ex, ey, c)
            smallest = min(smallest, thin)
        scalar[POWER], scalar[FLOW] = power / substeps, force[3]
        heat_oil(film, scalar, period)
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = journal(s, now)
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
