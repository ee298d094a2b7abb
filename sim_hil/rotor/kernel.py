"""Equation of motion of the whole machine, advanced in place by compiled code.

Positions stand at whole steps, velocities at half steps (leap-frog, second order); velocities at
whole steps, which the dampers ask for, are forecast from the last accelerations.  The film is far
stiffer than any affordable step, so its force is solved for in the two components that it joins
(:mod:`sim_hil.rotor.film_step`).  The gyroscopic coupling is a Cayley rotation.

Rotor (equation (2) of the paper with its omissions mended: the skew coupling carries the speed,
gravity acts, moments are cross products), tilts ``A = dx/dz``, ``B = dy/dz``::

    m x'' = sum Fx                     J_d A'' = sum z Fx - J_p (omega B' + alpha B)
    m y'' = sum Fy - m g               J_d B'' = sum z Fy + J_p (omega A' + alpha A)

Unbalance with run-up: ``U (omega^2 cos + alpha sin, omega^2 sin - alpha cos)`` of the shaft angle.
"""

from __future__ import annotations

import math

from sim_hil.film.elementary import direction_of
from sim_hil.jit import inlined
from sim_hil.rotor.bearing import gap
from sim_hil.rotor.film_law import Law
from sim_hil.rotor.film_step import crossing, meet_film
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
    State,
    Two,
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
    tooth = e.tooth_force * direction_of(e.teeth * angle)[1]
    carried = s.mass * GRAVITY * s.to_bearing / (s.to_coupling + s.to_bearing)
    fx = -s.coupling_stiffness * x - s.coupling_damping * vx + 0.5 * tooth
    fy = -s.coupling_stiffness * y - s.coupling_damping * vy + tooth + carried
    if e.misaligned_kg_m != 0.0:
        spin = 4 * omega * omega * e.misaligned_kg_m
        cosine, sine = direction_of(2 * angle)
        fx += spin * cosine
        fy += spin * sine
    return fx, fy


@inlined
def accelerate_pedestal(
    plant: Plant, st: State, push_x: float, push_y: float, ambient: Floats
) -> None:
    """Pedestal accelerations into ``st.a[4:7]``: feet, reaction at the axis, ambient force."""
    q, v, ped = st.q, st.ahead, plant.pedestal
    fx, fy, moment = foot_forces(ped, q[4], q[5], q[6], v[4], v[5], v[6], st.slip, 0)
    per_mass, per_inertia = 1 / ped.mass, 1 / ped.inertia
    st.a[4] = (fx - push_x + ambient[0]) * per_mass
    st.a[5] = (fy - push_y + ambient[1]) * per_mass - GRAVITY
    st.a[6] = (moment + ped.axis_height * push_x) * per_inertia


@inlined
def accelerate_motor(
    plant: Plant, st: State, coupling_x: float, coupling_y: float, omega: float, ambient: Floats
) -> None:
    """Motor accelerations into ``st.a[7:10]``: feet, coupling reaction, own unbalance,
    line-frequency force."""
    q, v, motor, e = st.q, st.ahead, plant.motor, plant.excite
    fx, fy, moment = foot_forces(motor, q[7], q[8], q[9], v[7], v[8], v[9], st.slip, 4)
    cosine, sine = direction_of(st.scalar[ANGLE] + e.motor_angle)
    spin = e.motor_unbalance * omega * omega
    line = e.line_force * direction_of(e.line_rad_s * st.scalar[TIME])[1]
    push = -coupling_x + spin * cosine
    per_mass, per_inertia = 1 / motor.mass, 1 / motor.inertia
    st.a[7] = (fx + push + ambient[2]) * per_mass
    st.a[8] = (fy - coupling_y + spin * sine + line + ambient[3]) * per_mass - GRAVITY
    st.a[9] = (moment - motor.axis_height * push) * per_inertia


@inlined
def film_mobility(plant: Plant) -> Two:
    """Acceleration of the journal against the housing by a unit force, in x and y, 1/kg."""
    s, pedestal = plant.shaft, plant.pedestal
    b, height = s.to_bearing, pedestal.axis_height
    across = 1 / s.mass + b * b / s.diametral + 1 / pedestal.mass
    return across + height * height / pedestal.inertia, across


@inlined
def accelerate(
    plant: Plant, st: State, omega: float, alpha: float, load: float, ambient: Floats
) -> float:
    """Accelerations of all bodies but for the film into ``st.a``; returns the braking friction of a
    rub, N."""
    s, film, q, v, a, scalar = plant.shaft, plant.film, st.q, st.ahead, st.a, st.scalar
    b = s.to_bearing
    rub_x = rub_y = drag = 0.0
    if plant.excite.rub_stiffness > 0.0:
        ex, ey = relative(plant, q)
        wx, wy = relative(plant, v)
        dx, dy = ex - scalar[MEAN_X], ey - scalar[MEAN_Y]
        rub_x, rub_y, drag = rub_force(plant.excite, dx, dy, wx, wy, film.radius * omega)
    cosine, sine = direction_of(scalar[ANGLE] + s.unbalance_angle)
    share = s.mass * GRAVITY * s.to_coupling / (s.to_coupling + b)
    at_x = s.unbalance * (omega * omega * cosine + alpha * sine) + rub_x
    at_y = s.unbalance * (omega * omega * sine - alpha * cosine) + rub_y - (load - share)
    coupling_x, coupling_y = coupling_force(plant, q, v, scalar[ANGLE], omega)
    accelerate_motor(plant, st, coupling_x, coupling_y, omega, ambient)
    accelerate_pedestal(plant, st, rub_x, rub_y, ambient)
    per_mass, per_inertia = 1 / s.mass, 1 / s.diametral
    a[0] = (at_x + coupling_x) * per_mass
    a[1] = (at_y + coupling_y) * per_mass - GRAVITY
    turning = plant.excite.misaligned_N_m - s.polar * alpha * q[3]
    a[2] = (b * at_x - s.to_coupling * coupling_x + turning) * per_inertia
    a[3] = (b * at_y - s.to_coupling * coupling_y + s.polar * alpha * q[2]) * per_inertia
    return drag


@inlined
def push(plant: Plant, a: Floats, fx: float, fy: float) -> None:
    """Add what the film's force on the journal (x, y), N, gives rotor and pedestal."""
    s, pedestal = plant.shaft, plant.pedestal
    per_mass, per_inertia, per_pedestal = 1 / s.mass, s.to_bearing / s.diametral, 1 / pedestal.mass
    a[0] += fx * per_mass
    a[1] += fy * per_mass
    a[2] += fx * per_inertia
    a[3] += fy * per_inertia
    a[4] -= fx * per_pedestal
    a[5] -= fy * per_pedestal
    a[6] += pedestal.axis_height / pedestal.inertia * fx


@inlined
def drive_on(plant: Plant, st: State, omega: float, alpha: float, dt: float) -> None:
    """Velocities, positions, angle and time after ``dt`` of the accelerations ``st.a``."""
    s, q, v, a, scalar = plant.shaft, st.q, st.v, st.a, st.scalar
    g = 0.5 * dt * s.polar * omega / s.diametral
    tilt_x = v[2] - g * v[3] + dt * a[2]
    tilt_y = v[3] + g * v[2] + dt * a[3]
    for i in range(10):
        v[i] += dt * a[i]
    per_turn = 1 / (1 + g * g)
    v[2] = (tilt_x - g * tilt_y) * per_turn
    v[3] = (tilt_y + g * tilt_x) * per_turn
    for i in range(10):
        q[i] += dt * v[i]
        st.ahead[i] = v[i] + 0.5 * dt * a[i]
    scalar[ANGLE] += (omega + 0.5 * alpha * dt) * dt
    scalar[TIME] += dt


@inlined
def substep(
    plant: Plant,
    st: State,
    law: Law,
    fresh: bool,
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

    ``fresh``: take new slopes of the film.
    """
    film, a, scalar, held = plant.film, st.a, st.scalar, st.film
    ex, ey = relative(plant, st.q)
    wx, wy = relative(plant, st.v)
    ahead = relative(plant, st.ahead)
    rough = crossing(gap(film, ex, ey, c), ex, ey, wx, wy, c, dt)
    if plant.excite.rub_stiffness <= 0.0:
        scalar[MEAN_X] += _MEAN_RATE * dt * (ex - scalar[MEAN_X])
        scalar[MEAN_Y] += _MEAN_RATE * dt * (ey - scalar[MEAN_Y])
    drag = accelerate(plant, st, omega, alpha, load, ambient)
    px, py = relative(plant, a)
    turning = plant.shaft.to_bearing * plant.shaft.polar * omega / plant.shaft.diametral
    gyroscopic_x, gyroscopic_y = -turning * st.ahead[3], turning * st.ahead[2]
    slopes = held[0], held[1], held[2], held[3], held[4], held[5], held[6], held[7]
    force, mean, slopes, stale = meet_film(
        film, law, oil, slopes, fresh or rough or held[8] > 0.0, rough, 1, (ex, ey, wx, wy),
        (wx, wy) if rough else ahead, (px + gyroscopic_x, py + gyroscopic_y), film_mobility(plant),
        0.0, omega, c, c_rate, dt,
    )  # fmt: skip
    for i in range(8):
        held[i] = slopes[i]
    held[8] = 1.0 if stale else 0.0
    fx, fy = mean[0], mean[1]
    push(plant, a, fx, fy)
    drive_on(plant, st, omega, alpha, dt)
    # work of the force that acted, over the way that was gone (mean of the two half-step
    # velocities)
    after_x, after_y = relative(plant, st.v)
    work = 0.5 * (fx * (wx + after_x) + fy * (wy + after_y))
    torque, flow = force[2], force[3]
    scalar[POWER] = (
        torque * abs(omega) + drag * film.radius * omega - work + film.windage * abs(omega) ** 3
    )
    scalar[FLOW] = flow
