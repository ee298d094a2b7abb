"""Where the film equation holds (:mod:`firmware_py.machine.domain`), for a simulated rig."""

from __future__ import annotations

import math

from firmware_py.machine.domain import FilmDomain, film_domain
from sim_hil.rigs import RigData


def domain(rig: RigData, rpm: float, clearance_m: float, viscosity_Pa_s: float) -> FilmDomain:
    """Where a film of ``rig`` stands; the speed counts without its sign."""
    bearing, speed_rad_s = rig.bearing, rpm * math.pi / 30
    return film_domain(
        bearing.radius_m, clearance_m, rig.oil.density_kg_m3, viscosity_Pa_s, speed_rad_s
    )


def describe(rig: RigData) -> list[str]:
    """Lines for people: the fastest film of the rig at its nominal and at its widest clearance, oil
    at the inlet."""
    mu, rpm = rig.oil.viscosity_at(rig.oil.inlet_C), rig.speed_max_rpm
    lines = []
    for clearance_m in (rig.bearing.clearance_nominal_m, rig.bearing.clearance_max_m):
        at = domain(rig, rpm, clearance_m, mu)
        where = f"{rpm:g} rpm, {clearance_m * 1e6:g} um"
        numbers = (
            f"Re = {at.reynolds:.0f}, Ta = {at.taylor:.1f}, rho omega c^2/mu = {at.inertia:.2f}"
        )
        lines.append(f"film at {where}: {numbers}")
        lines += [f"warning: film at {where}: {text}" for text in at.warnings]
    return lines
