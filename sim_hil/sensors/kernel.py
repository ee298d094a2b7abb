"""Sensor signals of the compiled plant, and the loop over sampling instants.

Signals are SI (m, m/s2, Pa, bar, V) in the order of :data:`firmware_py.records.CHANNELS`.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.machine.contact import ASPERITY_OHM
from sim_hil.film.elementary import direction_of, exp_of
from sim_hil.jit import inlined, kernel
from sim_hil.rotor.bearing import bearing_force, gap, heat_oil, oil_now
from sim_hil.rotor.film_law import Law
from sim_hil.rotor.film_slopes import knows_slopes
from sim_hil.rotor.kernel import move_actuator, relative, substep
from sim_hil.rotor.parameters import (
    ANGLE,
    CLEARANCE,
    FLOW,
    OIL,
    POWER,
    PRESSURE,
    RING,
    TIME,
    TURNS,
    ContactParameters,
    FilmOil,
    Floats,
    Four,
    Pickup,
    Plant,
    State,
)

_BAR_PER_PASCAL = 1e-5
_PUMP_TEETH_RAD_S = 2 * math.pi * 225.0
_PUMP_RIPPLE = 0.01


@inlined
def contact_voltage(min_film: float, roughness: float, circuit: ContactParameters) -> float:
    """Voltage over the film: its resistance (proportional to the minimum film) beside asperity
    contacts.

    ``R_film``, proportional to ``h``, and ``R_asperity = 10 exp(h / sigma)``, both ohm, in
    parallel, behind the series resistor of the circuit (:mod:`firmware_py.machine.contact`).
    ``sigma`` is the composite roughness; the exponential height distribution of asperities is
    Greenwood and Williamson's (1966).
    """
    h = max(min_film, 0.0)
    film = circuit.film_ohm_per_m * h
    asperity = ASPERITY_OHM * exp_of(min(h / roughness, 60.0))
    if film <= 0.0:
        return 0.0
    parallel = 1.0 / (1.0 / film + 1.0 / asperity)
    volt: float = circuit.volt * parallel / (parallel + circuit.ohm)
    return volt


@inlined
def housing_mode(pickup: Pickup, mode: Floats, i: int, base: float, dt: float) -> float:
    """Acceleration at sensor ``i``: that of its base plus a share of a local housing mode
    (ringing)."""
    w = pickup.mode_rad_s[i]
    inner = -2 * pickup.mode_damping * w * mode[3 + i] - w * w * mode[i]
    mode[3 + i] += dt * (inner - base)
    mode[i] += dt * mode[3 + i]
    signal: float = base + pickup.mode_gain * inner
    return signal


@inlined
def sense(plant: Plant, st: State, c: float, dt: float) -> None:
    """Signals of this instant through the sensor lags into the anti-alias history."""
    p, q, v, a, scalar = plant.pickup, st.q, st.v, st.a, st.scalar
    ex, ey = relative(plant, q)
    c1, s1 = direction_of(scalar[ANGLE])
    c2, s2 = c1 * c1 - s1 * s1, 2 * s1 * c1
    c3, s3 = c2 * c1 - s2 * s1, s2 * c1 + c2 * s1
    taps = st.ring.shape[0] // 2
    at = int(scalar[RING])
    _, tooth = direction_of(plant.excite.teeth * scalar[ANGLE])
    _, pump = direction_of(_PUMP_TEETH_RAD_S * scalar[TIME])
    ripple = 1 + _PUMP_RIPPLE * pump
    cos_x, sin_x = p.runout_cos[0], p.runout_sin[0]
    cos_y, sin_y = p.runout_cos[1], p.runout_sin[1]
    wobble_x = (
        cos_x[0] * c1
        + cos_x[1] * c2
        + cos_x[2] * c3
        + sin_x[0] * s1
        + sin_x[1] * s2
        + sin_x[2] * s3
    )
    wobble_y = (
        cos_y[0] * c1
        + cos_y[1] * c2
        + cos_y[2] * c3
        + sin_y[0] * s1
        + sin_y[1] * s2
        + sin_y[2] * s3
    )
    now = (
        p.probe[0][0] * ex + p.probe[0][1] * ey + wobble_x,
        p.probe[1][0] * ex + p.probe[1][1] * ey + wobble_y,
        housing_mode(p, st.mode, 0, a[5], dt),
        housing_mode(p, st.mode, 1, a[4] - plant.pedestal.axis_height * a[6], dt),
        housing_mode(p, st.mode, 2, a[8], dt),
        p.sound * (v[4] + v[5] + v[7] + v[8]) + p.tooth_sound * tooth,
        scalar[PRESSURE] * _BAR_PER_PASCAL * ripple,
        contact_voltage(gap(plant.film, ex, ey, c), p.roughness, p.contact),
    )
    for i in range(8):
        st.lag[i] += p.lag_share[i] * (now[i] - st.lag[i])
        st.ring[at, i] = st.ring[at + taps, i] = st.lag[i]
    scalar[RING] = (at + 1) % taps


@inlined
def _pair(to: Four, tap: float, ring: Floats, i: np.uint64, j: np.uint64, first: int) -> Four:
    """Four channels of two instants that share a tap, added to what the others gave."""
    return (
        to[0] + tap * (ring[i, first] + ring[j, first]),
        to[1] + tap * (ring[i, first + 1] + ring[j, first + 1]),
        to[2] + tap * (ring[i, first + 2] + ring[j, first + 2]),
        to[3] + tap * (ring[i, first + 3] + ring[j, first + 3]),
    )


@inlined
def filtered(ring: Floats, start: int, taps: Floats, out: Floats) -> None:
    """Anti-alias filter: the last ``len(taps)`` instants of each channel against the impulse
    response, whose two halves mirror one another."""
    low = high = (0.0, 0.0, 0.0, 0.0)
    half = taps.size // 2
    # unsigned: no check for an index from the end
    i, j = np.uint64(start), np.uint64(start + taps.size - 1)
    for k in range(half):
        low, high = _pair(low, taps[k], ring, i, j, 0), _pair(high, taps[k], ring, i, j, 4)
        i, j = i + np.uint64(1), j - np.uint64(1)
    middle = 0.5 * taps[half]
    out[0], out[1], out[2], out[3] = _pair(low, middle, ring, i, i, 0)
    out[4], out[5], out[6], out[7] = _pair(high, middle, ring, i, i, 4)


@kernel
def advance(
    plant: Plant, st: State, law: Law, taps: Floats, drive: Floats, target: Floats, ambient: Floats,
    period: float, substeps: int, kept: int, signals: Floats, truth: Floats, marks: Floats,
) -> None:  # fmt: skip
    """Advance by ``len(signals)`` sampling periods.

    Parameters
    ----------
    drive
        Shape (n + 1, 2): speed, rad/s, and static bearing load, N, at the borders of the periods.
    target
        Clearance, m, and supply pressure, Pa, that the actuator is to reach.
    ambient
        Shape (n, 4): broadband force on pedestal (x, y) and motor (x, y), N, held over a period.
    period
        Sampling period, s; ``substeps`` equal steps each, with fresh slopes of a film that
        does not know its own every ``kept``.
    signals, truth, marks
        Written: filtered channels (n, 8); :data:`TRUTH_COLUMNS` (n, 14); time of a mark edge from
        the start of the period, s, or -1 (n,).
    """
    film, scalar = plant.film, st.scalar
    dt = period / substeps
    turn = 2 * math.pi
    for n in range(signals.shape[0]):
        alpha = (drive[n + 1, 0] - drive[n, 0]) / period
        c_rate = move_actuator(plant.act, scalar, target[0], target[1], period)
        c = scalar[CLEARANCE] + film.wear
        oil = oil_now(film, scalar)
        marks[n] = -1.0
        power = 0.0
        for k in range(substeps):
            omega = drive[n, 0] + alpha * dt * k
            load = drive[n, 1] + (drive[n + 1, 1] - drive[n, 1]) * k / substeps
            before = scalar[ANGLE]
            fresh = knows_slopes(law) or k % kept == 0
            substep(plant, st, law, fresh, omega, alpha, load, c, c_rate, oil, ambient[n], dt)
            power += scalar[POWER]
            if scalar[ANGLE] >= turn or scalar[ANGLE] < 0.0:
                sign = 1.0 if scalar[ANGLE] >= turn else -1.0
                edge = turn if sign > 0 else 0.0
                marks[n] = dt * (k + (edge - before) / (scalar[ANGLE] - before))
                scalar[ANGLE] -= sign * turn
                scalar[TURNS] += sign
            sense(plant, st, c, dt)
        scalar[POWER] = power / substeps
        heat_oil(film, scalar, period)
        filtered(st.ring, int(scalar[RING]), taps, signals[n])
        _write_truth(plant, st, law, drive[n + 1], c, oil, truth[n])


@inlined
def _write_truth(
    plant: Plant, st: State, law: Law, drive: Floats, c: float, oil: FilmOil, row: Floats
) -> None:
    film, scalar = plant.film, st.scalar
    ex, ey = relative(plant, st.q)
    wx, wy = relative(plant, st.ahead)
    fx, fy, _, _ = bearing_force(law, film, oil, ex, ey, wx, wy, drive[0], c, 0.0)
    row[0] = scalar[ANGLE] + 2 * math.pi * scalar[TURNS]
    row[1], row[2] = drive[0], drive[1]
    row[3], row[4], row[5], row[6] = c, scalar[PRESSURE], scalar[OIL], oil.viscosity
    row[7], row[8], row[9] = ex, ey, gap(film, ex, ey, c)
    row[10], row[11], row[12], row[13] = scalar[POWER], scalar[FLOW], fx, fy
