"""The rotor: modes with gyroscopic moments, the integrator, and the known facts of the rig `bench`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.linalg import expm

from sim_hil.build import Build
from sim_hil.duty import RAD_S_PER_RPM, Duty
from sim_hil.film import Equilibrium, equilibrium
from sim_hil.response import Trajectory, simulate
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.film_law import LinearLaw
from sim_hil.rotor.modes import Support, modes, state_matrix
from sim_hil.rotor.parameters import new_state
from sim_hil.rotor.rigid import COLUMNS, advance_rotor
from sim_hil.verify.row import Row, residual

_FACTS = "rig_bench.json"


@cache
def _bench() -> RigData:
    return load_rig("bench")


def rigid_modes() -> Iterator[Row]:
    """A symmetric rotor: bouncing at sqrt(2k/m), tilting split by the gyroscopic moment, free precession."""
    m, j_d, j_p, k, reach = 6.0, 0.06, 0.004, 1e6, 0.25
    tilting = 2 * k * reach**2
    for omega in (0.0, 600.0, -1200.0):
        found = modes(m, j_d, j_p, [Support(-reach, k), Support(reach, k)], omega)
        bounce = math.sqrt(2 * k / m)
        half = j_p * abs(omega) / (2 * j_d)
        root = math.sqrt(half**2 + tilting / j_d)
        expected = (bounce, bounce, root - half, root + half)
        source = "rigid rotor on two equal springs, closed form"
        for i, value in enumerate(expected):
            yield Row(f"mode {i + 1} at {omega:g} rad/s, rad/s", float(found.frequency_rad_s[i]), value, source, 1e-9)
        if omega:
            turning = float(np.sign(omega))
            name = f"sense of the lower and upper tilting mode at {omega:g} rad/s"
            yield Row(f"{name}: lower", float(found.forward[2]), -turning, "backward below, forward above", 0, True)
            yield Row(f"{name}: upper", float(found.forward[3]), turning, "backward below, forward above", 0, True)
    free = modes(m, j_d, j_p, [Support(0.0, k)], 600.0).frequency_rad_s
    precession = float(free[free > 1e-3].min())
    yield Row("free precession J_p omega / J_d, rad/s", precession, j_p * 600.0 / j_d, "rigid body, Euler", 1e-9)


def linear_rotor() -> Iterator[Row]:
    """The integrated rotor on springs against the matrix exponential of its own equation, gyroscopics included."""
    rig = _bench()
    quiet = replace(Build.nominal(rig), unbalance_kg_m=0.0)
    plant = assemble(rig, quiet, 5e-5, thermal=False)
    s = plant.shaft
    stiffness, damping = np.array([[4e6, 1e6], [-1e6, 2e6]]), np.array([[3e3, 5e2], [5e2, 2e3]])
    coupling = Support(-s.to_coupling, s.coupling_stiffness, s.coupling_damping)
    supports = [Support(s.to_bearing, stiffness, damping), coupling]
    load = rig.rotor.gravity_share_N
    law = LinearLaw.of((np.zeros(2), np.array([0.0, load])), stiffness, damping)
    start = np.array([5e-6, -2e-6, 2e-5, 1e-5, 1e-3, 2e-3, 4e-3, -8e-3])
    for omega, steps in ((0.0, 1), (1200.0, 1), (1200.0, 2)):
        w, state = start.copy(), new_state(1, 60e-6, 1e5, 40.0, 0.0)
        n, period = 80, 5e-5
        drive = np.tile([omega, load], (n + 1, 1))
        rows = np.empty((n, len(COLUMNS)))
        advance_rotor(plant.shaft, plant.film, plant.act, law, w, state.scalar, drive,
                      np.tile([60e-6, 1e5], (n, 1)), period, steps, 1, rows)  # fmt: skip
        exact = expm(state_matrix(s.mass, s.diametral, s.polar, supports, omega) * n * period) @ start
        apart = float(np.linalg.norm(w[4:] - exact[4:]) / np.linalg.norm(start[4:]))
        allowed = 8e-3 / steps**2  # second order: the stiffest mode (3600 rad/s) turns 0.18 rad in 50 us
        yield residual(f"free motion at {omega:g} rad/s after 4 ms, step {50 / steps:g} us, share of the start", apart,
                       "matrix exponential of equation (2)", allowed)  # fmt: skip


def step_halving() -> Iterator[Row]:
    """The orbit at dt and dt/2 where the film is stiffest, and at the fastest points."""
    for rpm, load, clearance in ((1500, 300, 40e-6), (3000, 100, 60e-6), (10000, 100, 60e-6), (12000, 30, 60e-6)):
        coarse, fine = (_steady(rpm, load, clearance, dt) for dt in (50e-6, 25e-6))
        orbit = fine.peak_to_peak_m() / 2
        apart = float(np.hypot(*(coarse.position_m - fine.position_m).T).max()) / orbit
        case = f"{rpm} rpm, {load} N, {clearance * 1e6:.0f} um:"
        yield residual(f"{case} orbit at 50 us and 25 us apart, share of the orbit", apart, "step halving", 5e-3)
        power = float(coarse.power_W.mean())
        yield Row(f"{case} power at 50 us, W", power, float(fine.power_W.mean()), "at 25 us", 1e-3)


def _steady(rpm: float, load: float, clearance: float, dt: float = 50e-6, unbalance: float = 1.0) -> Trajectory:
    """The last quarter of two seconds, isothermal."""
    rig = _bench()
    build = replace(Build.nominal(rig), unbalance_kg_m=unbalance * rig.rotor.unbalance_kg_m)
    run = simulate(rig, Duty.hold(rpm, load, 2.0), clearance=clearance, dt_s=dt, thermal=False, build=build)
    return run.last(0.5)


def whirl_onset() -> Iterator[Row]:
    """The linear threshold against the integrated rotor; effective mass of the rigid rotor at its bearing."""
    rig = _bench()
    yield Row("effective mass at the bearing, kg", rig.rotor.effective_mass_kg, 1.74, _FACTS, 1e-2)
    yield Row("gravity share at the bearing, N", rig.rotor.gravity_share_N, 29.4, _FACTS, 5e-3)
    source = f"{_FACTS}: half-order whirl sets in between 60 and 70 um"
    for clearance, sets_in in ((60e-6, 0.0), (70e-6, 1.0)):
        whirls = float(_steady(12000, 30, clearance).peak_to_peak_m() > 0.5 * clearance)
        yield Row(f"12000 rpm, 30 N, {clearance * 1e6:.0f} um: whirl", whirls, sets_in, source, 0, True)
    orbits = [_steady(12000, 30, 70e-6, unbalance=factor).peak_to_peak_m() for factor in (1.0, 4.0)]
    source = f"{_FACTS}: more unbalance quenches it"
    case = "12000 rpm, 30 N, 70 um: four times the unbalance, smaller orbit"
    yield Row(case, float(orbits[1] < orbits[0]), 1.0, source, 0, True)


def bench_facts() -> Iterator[Row]:
    """Minimum film over clearance, power and self-induced flow."""
    rig = _bench()
    bearing, mu = rig.bearing, rig.oil.viscosity_at(40.0)

    def rest(rpm: float, load: float, clearance: float) -> Equilibrium:
        return equilibrium(
            load_N=load, radius_m=bearing.radius_m, length_m=bearing.length_m, clearance_m=clearance,
            viscosity_Pa_s=mu, speed_rad_s=rpm * RAD_S_PER_RPM,
        )  # fmt: skip

    for clearance, film_um in ((40, 26.2), (60, 28.1), (80, 28.2), (100, 27.6), (160, 25.2)):
        value = float(rest(3000, 100, clearance * 1e-6).film.min_film_m) * 1e6
        yield Row(f"3000 rpm, 100 N, {clearance} um: minimum film, um", value, film_um, _FACTS, 0.1, True)
    state = rest(12000, 30, 60e-6)
    power = float(state.film.friction_torque_N_m) * 12000 * RAD_S_PER_RPM
    yield Row("12000 rpm, 30 N, 60 um: friction power, W", power, 265.0, _FACTS, 1e-2)
    yield Row("12000 rpm, 30 N, 60 um: side flow, L/min", state.side_flow_m3_s * 6e4, 0.13, _FACTS, 5e-2)
