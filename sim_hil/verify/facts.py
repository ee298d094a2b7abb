"""What the reference files say of rigs, duty and sensors, beside what the simulator makes of
them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from sim_hil.film import Equilibrium, equilibrium
from sim_hil.film.domain import domain
from sim_hil.plant.build import unbalance_of_grade
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import load_rig
from sim_hil.sensors.antialias import antialias_taps
from sim_hil.verify.row import ComparisonRow, residual

_BENCH = "rig_bench.json"


def bench() -> Iterator[ComparisonRow]:
    """Rotor at its bearing, minimum film over clearance, power and self-induced flow of the rig
    `bench`."""
    rig = load_rig("bench")
    bearing, mu = rig.bearing, rig.oil.viscosity_at(40.0)

    def rest(rpm: float, load: float, clearance: float) -> Equilibrium:
        return equilibrium(
            load_N=load,
            radius_m=bearing.radius_m,
            length_m=bearing.length_m,
            clearance_m=clearance,
            viscosity_Pa_s=mu,
            speed_rad_s=rpm * RAD_S_PER_RPM,
        )

    yield ComparisonRow(
        "effective mass at the bearing, kg", rig.rotor.effective_mass_kg, 1.74, _BENCH, 1e-2
    )
    yield ComparisonRow(
        "gravity share at the bearing, N", rig.rotor.gravity_share_N, 29.4, _BENCH, 5e-3
    )
    grade = rig.rotor.unbalance_kg_m / unbalance_of_grade(rig, 1.0)
    yield ComparisonRow(
        "balance grade of the normal unbalance at 6000 rpm", grade, 6.0, f"{_BENCH}: about G6", 5e-2
    )
    for clearance, film_um in ((40, 26.2), (60, 28.1), (80, 28.2), (100, 27.6), (160, 25.2)):
        value = float(rest(3000, 100, clearance * 1e-6).film.min_film_m) * 1e6
        yield ComparisonRow(
            f"3000 rpm, 100 N, {clearance} um: minimum film, um", value, film_um, _BENCH, 0.1, True
        )
    state = rest(12000, 30, 60e-6)
    power = float(state.film.friction_torque_N_m) * 12000 * RAD_S_PER_RPM
    yield ComparisonRow("12000 rpm, 30 N, 60 um: friction power, W", power, 265.0, _BENCH, 1e-2)
    yield ComparisonRow(
        "12000 rpm, 30 N, 60 um: side flow, L/min", state.side_flow_m3_s * 6e4, 0.13, _BENCH, 5e-2
    )
    thin = float(rest(1500, 300, 60e-6).film.min_film_m) < float(
        rest(1500, 30, 60e-6).film.min_film_m
    )
    yield ComparisonRow(
        "1500 rpm, 60 um: film thinner under 300 N than 30 N",
        float(thin),
        1.0,
        f"{_BENCH}: worst load",
        0,
        True,
    )


def seed() -> Iterator[ComparisonRow]:
    """The authors' rig in water, and their simulation, which keeps negative pressure."""
    rig = load_rig("seed")
    rocking = (150e-6 + 100e-6) / 2
    clearance = rig.bearing.clearance_nominal_m
    yield ComparisonRow(
        "seed rig: radial clearance from rocking, um",
        1e6 * clearance,
        1e6 * rocking / 2,
        "rig_seed.json",
        1e-9,
    )
    viscosity, density, radius, omega = 1e-3, 998.0, 0.02, 3000 * RAD_S_PER_RPM
    at, source = domain(rig, 3000, clearance, viscosity), "rig_seed.json: domain_check"
    reynolds = density * omega * radius * clearance / viscosity
    yield ComparisonRow("seed rig at 3000 rpm: Re", at.reynolds, reynolds, source, 1e-9)
    yield ComparisonRow(
        "seed rig at 3000 rpm: Ta",
        at.taylor,
        reynolds * math.sqrt(clearance / radius),
        source,
        1e-9,
    )
    inertia = density * omega * clearance**2 / viscosity
    yield ComparisonRow("seed rig at 3000 rpm: rho omega c^2/mu", at.inertia, inertia, source, 1e-9)
    yield ComparisonRow(
        "seed rig at 3000 rpm: warned of inertia", float(bool(at.warnings)), 1.0, source, 0, True
    )
    film = equilibrium(
        eccentricity_ratio=0.3,
        rupture="full",
        radius_m=radius,
        length_m=0.02,
        clearance_m=95e-6,
        viscosity_Pa_s=viscosity,
        speed_rad_s=omega,
        end_pressure_Pa=(105e3, 100e3),
    )
    k, d = film.stiffness, film.damping
    held = (
        k[0, 0] * d[1, 1] + k[1, 1] * d[0, 0] - k[0, 1] * d[1, 0] - k[1, 0] * d[0, 1]
    ) / np.trace(d)
    source = "zero: a film without rupture has no stable speed (Lund 1966)"
    yield residual(
        "authors' simulation (full film): stiffness against whirl, K c/W", float(held), source, 1e-6
    )
    attitude = math.degrees(film.attitude_rad)
    yield ComparisonRow(
        "authors' simulation (full film): attitude, deg",
        attitude,
        90.0,
        "full film, symmetry",
        1e-3,
        True,
    )


def duty_and_sensors() -> Iterator[ComparisonRow]:
    """Length and holds of the published duty; damping of the anti-alias filter."""
    duty = Duty.published(load_rig("bench"))
    yield ComparisonRow("published duty: length, s", duty.seconds, 66.0, "duty_bench.json", 1e-9)
    points = zip(duty.speed_rpm, duty.load_N, strict=True)
    holds = sum(before == after for before, after in pairwise(points))
    yield ComparisonRow(
        "published duty: holds, the first taken twice",
        float(holds),
        7.0,
        "duty_bench.json",
        0,
        True,
    )
    for rate_hz, steps in ((5000, 5), (10000, 3)):
        taps = antialias_taps(steps)
        gain = np.abs(np.fft.rfft(taps, 1 << 16))
        beyond = np.fft.rfftfreq(1 << 16, 1 / (rate_hz * steps)) >= rate_hz / 2
        above_dB = max(0.0, 20 * math.log10(gain[beyond].max() / gain[0]) + 60)
        yield residual(
            f"anti-alias filter at {rate_hz} Hz: gain above -60 dB from Nyquist up, dB",
            above_dB,
            "sensors.json: -60 dB from the Nyquist frequency up",
            0.0,
        )
