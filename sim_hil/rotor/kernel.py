"""Equation of motion of the whole machine, advanced in place by compiled code.

Positions stand at whole steps, velocities at half steps (leap-frog, second order).  The film is far
stiffer than any affordable step, so its force is taken linearly implicit: with the reaction ``G,
r`` of film and contact (:mod:`sim_hil.rotor.film_step`) and the mobility ``A`` of journal and
housing, ``(I - dt A G) a = A (F + r) + ...`` is solved for the two components that the film joins.
The gyroscopic coupling is a Cayley rotation.

Rotor (equation (2) of the paper with its omissions mended: the skew coupling carries the speed,
gravity acts, moments are cross products), tilts ``A = dx/dz``, ``B = dy/dz``::

    m x'' = sum Fx                     J_d A'' = sum z Fx - J_p (omega B' + alpha B)
    m y'' = sum Fy - m g               J_d B'' = sum z Fy + J_p (omega A' + alpha A)

Unbalance with run-up: ``U (omega^2 cos + alpha sin, omega^2 sin - alpha cos)`` of the shaft angle.
"""

from __future__ import annotations

import math

from sim_hil.jit import inlined
from sim_hil.rotor.bearing import bearing_force
from sim_hil.rotor.film_law import Law
from sim_hil.rotor.joints import foot_forces
from sim_hil.rotor.parameters import (
    ANGLE,
    CLEARANCE,
    DELAY,
    DELAY_AT,
    DELAY_PHASE,
    DEMAND,
    FLOW,
    MEAN_X,
    MEAN_Y,
    N_DELAY,
    POSITION,
    POWER,
    PRESSURE,
    TIME,
    ActuatorParameters,
    FilmOil,
    Floats,
    Plant,
    Six,
    State,
)
from sim_hil.rotor.stator import rub_force

GRAVITY = 9.81
_MEAN_RATE = 10.0


@inlined
def relative(plant: Plant, z: Floats) -> tuple[float, float]:
    """Journal minus housing at the bearing, for positions or velocities ``z``."""
    b, height = plant.shaft.to_bearing, plant.pedestal.axis_height
    return z[0] + b * z[2] - (z[4] - height * z[6]), z[1] + b * z[3] - z[5]


@inlined
def delayed_target(act: ActuatorParameters, scalar: Floats, pressure: float, dt: float) -> float:
    """The pressure target of one dead time ago, to a sixteenth of it."""
    if act.pressure_dead_time <= 0.0:
        return pressure
    scalar[DELAY_PHASE] += min(N_DELAY * dt / act.pressure_dead_time, float(N_DELAY))
    while scalar[DELAY_PHASE] >= 1.0:
        scalar[DELAY_PHASE] -= 1.0
        scalar[DELAY + int(scalar[DELAY_AT])] = pressure
        scalar[DELAY_AT] = (scalar[DELAY_AT] + 1.0) % N_DELAY
    oldest: float = scalar[DELAY + int(scalar[DELAY_AT])]
    return oldest


@inlined
def move_supply(act: ActuatorParameters, scalar: Floats, pressure: float, dt: float) -> None:
    """Supply pressure: dead time, what the pump gives at the present flow, lag and slew.

    Where the pump gives less than is asked for and there is a hold-up, the check valve is closed:
    the pressure falls with the hold-up alone, and through the valve down to its target.
    """
    wanted = delayed_target(act, scalar, pressure, dt)
    source = act.shut_off * (1.0 - max(0.0, scalar[FLOW]) / act.flow_max)
    available = act.pressure_gain * max(0.0, min(wanted, source))
    now = scalar[PRESSURE]
    follows = 1 - math.exp(-dt / act.pressure_time_constant)
    if act.hold_up > 0.0 and available < wanted and available < now:
        step = (available - now) * (1 - math.exp(-dt / act.hold_up))
        step += min(0.0, wanted - now) * follows
    else:
        step = (available - now) * follows
    most = act.pressure_slew * dt
    scalar[PRESSURE] += min(max(step, -most), most)


@inlined
def move_actuator(
    act: ActuatorParameters, scalar: Floats, clearance: float, pressure: float, dt: float
) -> float:
    """Rate limit, first-order lag, backlash; returns the rate of change of the clearance, m/s.

    The supply pressure moves as :func:`move_supply` says.
    """
    step = min(max(clearance - scalar[DEMAND], -act.rate * dt), act.rate * dt)
    scalar[DEMAND] += step
    scalar[POSITION] += (scalar[DEMAND] - scalar[POSITION]) * (
        1 - math.exp(-dt / act.time_constant)
    )
    before = scalar[CLEARANCE]
    play = 0.5 * act.backlash
    scalar[CLEARANCE] = min(max(before, scalar[POSITION] - play), scalar[POSITION] + play)
    move_supply(act, scalar, pressure, dt)
    rate: float = (scalar[CLEARANCE] - before) / dt
    return rate


@inlined
def coupling_force(
    plant: Plant, q: Floats, v: Floats, angle: float, omega: float
) -> tuple[float, float]:
    """On the rotor's coupling end: linear spring and damper, alignment preload, misalignment, tooth
    force."""
    s, e = plant.shaft, plant.excite
    x = q[0] - s.to_coupling * q[2] - (q[7] - plant.motor.axis_height * q[9])
    y = q[1] - s.to_coupling * q[3] - q[8]
    vx = v[0] - s.to_coupling * v[2] - (v[7] - plant.motor.axis_height * v[9])
    vy = v[1] - s.to_coupling * v[3] - v[8]
    tooth = e.tooth_force * math.sin(e.teeth * angle)
    carried = s.mass * GRAVITY * s.to_bearing / (s.to_coupling + s.to_bearing)
    fx = -s.coupling_stiffness * x - s.coupling_damping * vx + 0.5 * tooth
    fy = -s.coupling_stiffness * y - s.coupling_damping * vy + tooth + carried
    if e.misaligned_kg_m != 0.0:
        spin = 4 * omega * omega * e.misaligned_kg_m
        fx += spin * math.cos(2 * angle)
        fy += spin * math.sin(2 * angle)
    return fx, fy


@inlined
def accelerate_feet(plant: Plant, st: State, film_x: float, film_y: float, ambient: Floats) -> None:
    """Pedestal accelerations into ``st.a[4:7]``: feet, film reaction at the axis, ambient force."""
    q, v, ped = st.q, st.v, plant.pedestal
    fx, fy, moment = foot_forces(ped, q[4], q[5], q[6], v[4], v[5], v[6], st.slip, 0)
    st.a[4] = (fx - film_x + ambient[0]) / ped.mass
    st.a[5] = (fy - film_y + ambient[1]) / ped.mass - GRAVITY
    st.a[6] = (moment + ped.axis_height * film_x) / ped.inertia


@inlined
def accelerate_motor(
    plant: Plant, st: State, coupling_x: float, coupling_y: float, omega: float, ambient: Floats
) -> None:
    """Motor accelerations into ``st.a[7:10]``: feet, coupling reaction, own unbalance,
    line-frequency force."""
    q, v, motor, e = st.q, st.v, plant.motor, plant.excite
    fx, fy, moment = foot_forces(motor, q[7], q[8], q[9], v[7], v[8], v[9], st.slip, 4)
    angle = st.scalar[ANGLE] + e.motor_angle
    spin = e.motor_unbalance * omega * omega
    line = e.line_force * math.sin(e.line_rad_s * st.scalar[TIME])
    push = -coupling_x + spin * math.cos(angle)
    st.a[7] = (fx + push + ambient[2]) / motor.mass
    st.a[8] = (fy - coupling_y + spin * math.sin(angle) + line + ambient[3]) / motor.mass - GRAVITY
    st.a[9] = (moment - motor.axis_height * push) / motor.inertia


@inlined
def join_film(plant: Plant, a: Floats, reaction: Six, dt: float) -> tuple[float, float]:
    """What the film force changes by during the step, ``dF = dt G a + r``, N, added to the
    accelerations."""
    s, pedestal = plant.shaft, plant.pedestal
    b, height = s.to_bearing, pedestal.axis_height
    ground_y = 1 / s.mass + b * b / s.diametral + 1 / pedestal.mass
    ground_x = ground_y + height * height / pedestal.inertia
    gxx, gxy, gyx, gyy, rx, ry = reaction
    ax, ay = relative(plant, a)
    ax += ground_x * rx
    ay += ground_y * ry
    mxx, mxy = 1 - dt * ground_x * gxx, -dt * ground_x * gxy
    myx, myy = -dt * ground_y * gyx, 1 - dt * ground_y * gyy
    det = mxx * myy - mxy * myx
    new_x, new_y = (myy * ax - mxy * ay) / det, (mxx * ay - myx * ax) / det
    dfx, dfy = dt * (gxx * new_x + gxy * new_y) + rx, dt * (gyx * new_x + gyy * new_y) + ry
    a[0] += dfx / s.mass
    a[1] += dfy / s.mass
    a[2] += b * dfx / s.diametral
    a[3] += b * dfy / s.diametral
    a[4] -= dfx / pedestal.mass
    a[5] -= dfy / pedestal.mass
    a[6] += height * dfx / pedestal.inertia
    return dfx, dfy


@inlined
def substep(
    plant: Plant,
    st: State,
    law: Law,
    reaction: Six,
    omega: float,
    alpha: float,
    load: float,
    c: float,
    c_rate: float,
    oil: FilmOil,
    ambient: Floats,
    dt: float,
) -> None:
    """One step of ``dt``: accelerations into ``st.a``, then velocities, positions, angle and time.

    ``reaction`` is what :func:`sim_hil.rotor.film_step.film_reaction` says of this step.
    """
    s, film, q, v, a, scalar = plant.shaft, plant.film, st.q, st.v, st.a, st.scalar
    b = s.to_bearing
    ex, ey = relative(plant, q)
    wx, wy = relative(plant, v)
    fx, fy, torque, flow = bearing_force(law, film, oil, ex, ey, wx, wy, omega, c, c_rate)
    rub_x = rub_y = drag = 0.0
    if plant.excite.rub_stiffness <= 0.0:
        scalar[MEAN_X] += _MEAN_RATE * dt * (ex - scalar[MEAN_X])
        scalar[MEAN_Y] += _MEAN_RATE * dt * (ey - scalar[MEAN_Y])
    else:
        dx, dy = ex - scalar[MEAN_X], ey - scalar[MEAN_Y]
        rub_x, rub_y, drag = rub_force(plant.excite, dx, dy, wx, wy, film.radius * omega)
    angle = scalar[ANGLE] + s.unbalance_angle
    cosine, sine = math.cos(angle), math.sin(angle)
    share = s.mass * GRAVITY * s.to_coupling / (s.to_coupling + b)
    at_x = s.unbalance * (omega * omega * cosine + alpha * sine) + rub_x
    at_y = s.unbalance * (omega * omega * sine - alpha * cosine) + rub_y - (load - share)
    coupling_x, coupling_y = coupling_force(plant, q, v, scalar[ANGLE], omega)
    accelerate_motor(plant, st, coupling_x, coupling_y, omega, ambient)
    accelerate_feet(plant, st, fx + rub_x, fy + rub_y, ambient)

    a[0] = (fx + at_x + coupling_x) / s.mass
    a[1] = (fy + at_y + coupling_y) / s.mass - GRAVITY
    turning = plant.excite.misaligned_N_m - s.polar * alpha * q[3]
    a[2] = (b * (fx + at_x) - s.to_coupling * coupling_x + turning) / s.diametral
    a[3] = (b * (fy + at_y) - s.to_coupling * coupling_y + s.polar * alpha * q[2]) / s.diametral

    dfx, dfy = join_film(plant, a, reaction, dt)
    g = 0.5 * dt * s.polar * omega / s.diametral
    tilt_x = v[2] - g * v[3] + dt * a[2]
    tilt_y = v[3] + g * v[2] + dt * a[3]
    for i in range(10):
        v[i] += dt * a[i]
    v[2] = (tilt_x - g * tilt_y) / (1 + g * g)
    v[3] = (tilt_y + g * tilt_x) / (1 + g * g)
    for i in range(10):
        q[i] += dt * v[i]
    # work of the force that acted, over the way that was gone (mean of the two half-step
    # velocities)
    after_x, after_y = relative(plant, v)
    work = 0.5 * ((fx + dfx) * (wx + after_x) + (fy + dfy) * (wy + after_y))
    scalar[POWER] = (
        torque * abs(omega) + drag * film.radius * omega - work + film.windage * abs(omega) ** 3
    )
    scalar[FLOW] = flow
    scalar[ANGLE] += (omega + 0.5 * alpha * dt) * dt
    scalar[TIME] += dt
