"""Oil that is fed and oil that warms: closed forms, scaling, the tabulated film, and the rotor that
follows in time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from sim_hil.film import FeedPatch
from sim_hil.film.fed import FedTable, fed_force
from sim_hil.film.thermal import thermal_equilibrium
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.response import simulate
from sim_hil.rigs import load_rig
from sim_hil.verify.closed_forms import MU, OMEGA, C, R
from sim_hil.verify.properties import apart, film_of, states
from sim_hil.verify.row import ComparisonRow, residual

_GROOVE = partial(FeedPatch, "groove", width_rad=math.radians(20), length_m=0.8 * R)


def feeds() -> Iterator[ComparisonRow]:
    """A groove all round has a closed form: pressure falls evenly to the ends, whatever the
    eccentricity.

    `Q = 2 (2 pi R) c^3 p_s / (12 mu a) (1 + 3/2 eps^2)`, a the land on either side.
    """
    width, pressure = 0.2 * R, 1e5
    ring = FeedPatch("groove", 0.0, 2 * math.pi, width, pressure)
    for eps in (0.0, 0.5):
        film = film_of((0.0, -eps * C), (0.0, 0.0), speed_rad_s=0.0, feed=[ring], grid=(96, 40))
        flow = 4 * math.pi * R * C**3 * pressure / (12 * MU * (R - width) / 2) * (1 + 1.5 * eps**2)
        source = "groove all round, closed form"
        yield ComparisonRow(
            f"fed all round, eps={eps}: flow in, L/min",
            6e4 * float(film.inflow_m3_s),
            6e4 * flow,
            source,
            1e-3,
        )
        yield ComparisonRow(
            f"fed all round, eps={eps}: flow out, L/min",
            6e4 * float(film.side_flow_m3_s),
            6e4 * flow,
            source,
            1e-3,
        )
    e, v = states(12, 4)
    top = _GROOVE(angle_rad=math.pi / 2, pressure_Pa=pressure)
    once = film_of(e, v, feed=[top])
    thrice = film_of(
        e,
        3 * v,
        speed_rad_s=3 * OMEGA,
        feed=[_GROOVE(angle_rad=math.pi / 2, pressure_Pa=3 * pressure)],
    )
    case = "fed groove, thrice speed, velocity and pressure: largest relative error"
    yield residual(case, apart(thrice.force_N, 3 * once.force_N), "homogeneity of degree one", 1e-9)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = film_of(
        e @ turn.T, v @ turn.T, feed=[_GROOVE(angle_rad=math.pi, pressure_Pa=pressure)]
    )
    case = "fed groove, all turned by 90 degrees: largest relative error"
    yield residual(case, apart(turned.force_N, once.force_N @ turn.T), "rotation", 1e-9)


def fed_table() -> Iterator[ComparisonRow]:
    """The tabulated film with a groove on top against the film itself on a fine grid."""
    law = FedTable.load(0.5, math.radians(20), 0.8).law(math.pi / 2)
    e, v = states(40, 5)
    for pressure in (0.5e5, 1e5, 3e5):
        found = np.array(
            [
                fed_force(law, *a, *b, OMEGA, C, MU, R, R, 0.0, pressure)
                for a, b in zip(e, v, strict=True)
            ]
        )
        exact = film_of(
            e, v, feed=[_GROOVE(angle_rad=math.pi / 2, pressure_Pa=pressure)], grid=(240, 40)
        )
        size = np.hypot(*exact.force_N.T) + 2 * R * R * pressure
        case = f"{pressure * 1e-5:g} bar, 40 random states, eps to 0.9:"
        force = np.hypot(*(found[:, :2] - exact.force_N).T) / size
        flow = np.abs(found[:, 3] / exact.side_flow_m3_s - 1)
        source = "film_force, fine grid;"
        typical = math.sqrt(float(np.mean(force * force)))
        yield residual(
            f"{case} force", typical, f"{source} root mean square, share of |F| + 2 R L p_s", 1e-2
        )
        yield residual(
            f"{case} side flow",
            float(np.median(flow)),
            f"{source} median of the relative error",
            1e-2,
        )
        yield ComparisonRow(
            f"{case} side flow",
            float(flow.max()),
            0.0,
            f"{source} largest relative error",
            None,
            True,
        )


def warm_oil() -> Iterator[ComparisonRow]:
    """Friction carried off by the oil, and the rotor's temperature after 40 s."""
    rig = replace(load_rig("bench"), windage_W_s3=0.0)
    bearing, jacket = rig.bearing, rig.thermal.jacket_flow_m3_s
    balanced = replace(Build.nominal(rig), unbalance_kg_m=0.0)
    for rpm, load in ((12000, 30), (3000, 100)):
        warm = thermal_equilibrium(
            oil=rig.oil,
            clearance_m=C,
            speed_rad_s=rpm * RAD_S_PER_RPM,
            load_N=load,
            jacket_flow_m3_s=jacket,
            radius_m=bearing.radius_m,
            length_m=bearing.length_m,
        )
        flow = warm.equilibrium.side_flow_m3_s + jacket
        carried = (
            rig.oil.density_kg_m3
            * rig.oil.heat_capacity_J_kgK
            * flow
            * (warm.oil_C - rig.oil.inlet_C)
        )
        case = f"{rpm} rpm, {load} N, 60 um:"
        yield ComparisonRow(
            f"{case} friction power, W",
            warm.power_W,
            carried,
            "heat that side and jacket flow carry off",
            1e-5,
        )
        duty = Duty.hold(rpm, load)
        run = simulate(
            rig, duty, seconds=40.0, clearance=C, rate_hz=2000.0, dt_s=1e-4, build=balanced
        ).last(1.0)
        source = "integrated rotor, balanced, after 40 s"
        yield ComparisonRow(
            f"{case} oil, degC", warm.oil_C, float(run.column("oil_C")[-1]), source, 0.01, True
        )
        yield ComparisonRow(
            f"{case} power with warm oil, W", warm.power_W, float(run.power_W.mean()), source, 1e-3
        )
