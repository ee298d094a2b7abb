"""The rotor: modes with gyroscopic moments, the integrator, and the onset of whirl."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.response import Force, Trajectory, equilibrium_at, simulate
from sim_hil.plant.runs import run
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.film_law import LinearLaw
from sim_hil.rotor.modes import Support, modes, state_matrix
from sim_hil.rotor.parameters import TRUTH_COLUMNS, new_state
from sim_hil.rotor.rigid import COLUMNS, advance_rotor
from sim_hil.verify.row import ComparisonRow, residual

_FACTS = "rig_bench.json"


@cache
def _bench() -> RigData:
    return load_rig("bench")


def rigid_modes() -> Iterator[ComparisonRow]:
    """A symmetric rotor: bouncing at sqrt(2k/m), tilting split by the gyroscopic moment, free
    precession."""
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
            yield ComparisonRow(
                f"mode {i + 1} at {omega:g} rad/s, rad/s",
                float(found.frequency_rad_s[i]),
                value,
                source,
                1e-9,
            )
        if omega:
            turning = float(np.sign(omega))
            name = f"sense of the lower and upper tilting mode at {omega:g} rad/s"
            yield ComparisonRow(
                f"{name}: lower",
                float(found.forward[2]),
                -turning,
                "backward below, forward above",
                0,
                True,
            )
            yield ComparisonRow(
                f"{name}: upper",
                float(found.forward[3]),
                turning,
                "backward below, forward above",
                0,
                True,
            )
    free = modes(m, j_d, j_p, [Support(0.0, k)], 600.0).frequency_rad_s
    precession = float(free[free > 1e-3].min())
    yield ComparisonRow(
        "free precession J_p omega / J_d, rad/s",
        precession,
        j_p * 600.0 / j_d,
        "rigid body, Euler",
        1e-9,
    )


def linear_rotor() -> Iterator[ComparisonRow]:
    """The integrated rotor on springs against the matrix exponential of its own equation,
    gyroscopics included."""
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
        advance_rotor(
            plant.shaft,
            plant.film,
            plant.act,
            law,
            w,
            state.scalar,
            drive,
            np.tile([60e-6, 1e5], (n, 1)),
            period,
            steps,
            1,
            rows,
        )
        exact = (
            expm(state_matrix(s.mass, s.diametral, s.polar, supports, omega) * n * period) @ start
        )
        apart = float(np.linalg.norm(w[4:] - exact[4:]) / np.linalg.norm(start[4:]))
        allowed = (
            8e-3 / steps**2
        )  # second order: the stiffest mode (3600 rad/s) turns 0.18 rad in 50 us
        yield residual(
            f"free motion at {omega:g} rad/s, step {50 / steps:g} us",
            apart,
            "matrix exponential of equation (2) after 4 ms, share of the start",
            allowed,
        )


def step_halving() -> Iterator[ComparisonRow]:
    """The orbit at dt and dt/2 where the film is stiffest, and at the fastest points."""
    stiff = (1500, 300, 40e-6)
    for point in (stiff, (3000, 100, 60e-6), (10000, 100, 60e-6), (12000, 30, 60e-6)):
        coarse, fine = (_steady(*point, dt) for dt in (50e-6, 25e-6))
        yield from _halved(_case(*point), coarse, fine)
    yield from _halved(
        _case(*stiff) + " direct film,",
        *(_steady(*stiff, dt, force="direct") for dt in (50e-6, 25e-6)),
    )
    whole, finer = (_whole_machine(*stiff, dt) for dt in (40e-6, 20e-6))
    yield ComparisonRow(
        f"{_case(*stiff)} whole machine, p-p, um", whole, finer, "40 us beside 20 us", 5e-3
    )


def _case(rpm: float, load: float, clearance: float) -> str:
    return f"{rpm:g} rpm, {load:g} N, {clearance * 1e6:.0f} um:"


def _halved(case: str, coarse: Trajectory, fine: Trajectory) -> Iterator[ComparisonRow]:
    orbit = fine.peak_to_peak_m()
    apart = float(np.hypot(*(coarse.position_m - fine.position_m).T).max()) / (orbit / 2)
    yield ComparisonRow(
        f"{case} p-p, um", 1e6 * coarse.peak_to_peak_m(), 1e6 * orbit, "50 us beside 25 us", 5e-3
    )
    yield residual(
        f"{case} orbits apart, of one",
        apart,
        "largest distance of the orbits at 50 us and 25 us",
        5e-3,
    )
    yield ComparisonRow(
        f"{case} power, W",
        float(coarse.power_W.mean()),
        float(fine.power_W.mean()),
        "50 us beside 25 us",
        1e-3,
    )


def _whole_machine(rpm: float, load: float, clearance: float, dt: float) -> float:
    """Larger peak-to-peak of the two axes, um, over the last half of two seconds of the whole
    machine."""
    rig = _bench()
    machine = SimulatedMachine(
        rig, Build.nominal(rig), 0, clearance_m=clearance, thermal=False, max_step_s=dt
    )
    truth = run(machine, Duty.hold(rpm, load), 2.0, clearance=clearance).truth
    axes = [TRUTH_COLUMNS.index(f"eccentricity_{axis}_m") for axis in "xy"]
    return 1e6 * float(np.ptp(truth[len(truth) // 2 :, axes], axis=0).max())


def _steady(
    rpm: float,
    load: float,
    clearance: float,
    dt: float = 50e-6,
    *,
    unbalance: float = 1.0,
    force: Force = "table",
) -> Trajectory:
    """The last quarter of two seconds, isothermal."""
    rig = _bench()
    build = replace(Build.nominal(rig), unbalance_kg_m=unbalance * rig.rotor.unbalance_kg_m)
    duty = Duty.hold(rpm, load, 2.0)
    return simulate(
        rig, duty, clearance=clearance, dt_s=dt, thermal=False, build=build, force=force
    ).last(0.5)


def whirl_onset() -> Iterator[ComparisonRow]:
    """The linear threshold against the integrated rotor, and what the rig's file says of whirl."""
    for clearance in (60e-6, 80e-6):
        linear = brentq(lambda rpm, c=clearance: _linear_growth(rpm, c), 9000.0, 15000.0, xtol=1.0)
        below, above = (_growth(share * linear, clearance) for share in (0.97, 1.03))
        integrated = linear * (0.97 + 0.06 * below / (below - above))
        case = f"30 N, {clearance * 1e6:.0f} um, balanced: whirl from, rpm"
        yield ComparisonRow(
            case, integrated, linear, "eigenvalues of rotor, coupling and film's K, C", 1e-2
        )
    source = f"{_FACTS}: half-order whirl sets in between 60 and 70 um"
    for clearance, sets_in in ((60e-6, 0.0), (70e-6, 1.0)):
        whirls = float(_steady(12000, 30, clearance).peak_to_peak_m() > 0.5 * clearance)
        yield ComparisonRow(
            f"12000 rpm, 30 N, {clearance * 1e6:.0f} um: whirl", whirls, sets_in, source, 0, True
        )
    orbits = [_steady(12000, 30, 70e-6, unbalance=factor).peak_to_peak_m() for factor in (1.0, 4.0)]
    source = f"{_FACTS}: more unbalance quenches it"
    case = "12000 rpm, 30 N, 70 um: 4 x unbalance, smaller orbit"
    yield ComparisonRow(case, float(orbits[1] < orbits[0]), 1.0, source, 0, True)


def _linear_growth(rpm: float, clearance: float) -> float:
    """Largest real part of the eigenvalues under 30 N, 1/s."""
    rig, speed = _bench(), rpm * RAD_S_PER_RPM
    plant = assemble(rig, Build.nominal(rig), 5e-5, thermal=False)
    s, rest = plant.shaft, equilibrium_at(rig, plant, speed, 30.0, clearance)
    supports = [
        Support(s.to_bearing, rest.stiffness_N_m, rest.damping_N_s_m),
        Support(-s.to_coupling, s.coupling_stiffness, s.coupling_damping),
    ]
    return float(modes(s.mass, s.diametral, s.polar, supports, speed).eigenvalue_1_s.real.max())


def _growth(rpm: float, clearance: float) -> float:
    """Rate at which the orbit of the balanced rotor grows from rounding's first push, 1/s, between
    0.6 and 1 s."""
    build = replace(Build.nominal(_bench()), unbalance_kg_m=0.0)
    duty = Duty.hold(rpm, 30.0, 1.2)
    run = simulate(_bench(), duty, clearance=clearance, dt_s=50e-6, thermal=False, build=build)
    before, after = (
        np.ptp(run.position_m[(run.time_s > at) & (run.time_s < at + 0.2)], axis=0).max()
        for at in (0.6, 1.0)
    )
    return float(math.log(after / before) / 0.4)
