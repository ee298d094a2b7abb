"""Where the film equation holds: laminar, and without inertia of the oil.

With the surface speed ``omega R``, the gap ``c`` and the viscosity ``mu``

    Re = rho omega R c / mu,   Ta = Re sqrt(c / R),   Re* = rho omega c^2 / mu

Taylor vortices begin at Ta = 41 between concentric cylinders (Taylor, Phil. Trans. R. Soc. A 223,
1923), and Reynolds' equation leaves out the inertia of the oil, which is of the order Re* of its
friction (Szeri, Fluid Film Lubrication).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from sim_hil.rigs import RigData

TAYLOR_LIMIT: Final = 41.0
INERTIA_LIMIT: Final = 1.0


@dataclass(frozen=True)
class Domain:
    """Reynolds number, Taylor number and reduced Reynolds number ``rho omega c^2 / mu`` of a
    film."""

    reynolds: float
    taylor: float
    inertia: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """Which assumption fails, with the number and its limit; empty inside the domain."""
        found = []
        if self.taylor > TAYLOR_LIMIT:
            found.append(f"not laminar: Ta = {self.taylor:.1f}, above {TAYLOR_LIMIT:g}")
        if self.inertia > INERTIA_LIMIT:
            found.append(
                f"oil inertia counts: rho omega c^2/mu = {self.inertia:.2g}, above "
                f"{INERTIA_LIMIT:g}"
            )
        return tuple(found)


def domain(rig: RigData, rpm: float, clearance_m: float, viscosity_Pa_s: float) -> Domain:
    """Where a film of ``rig`` stands; the speed counts without its sign."""
    surface_m_s = abs(rpm) * math.pi / 30 * rig.bearing.radius_m
    reynolds = rig.oil.density_kg_m3 * surface_m_s * clearance_m / viscosity_Pa_s
    ratio = clearance_m / rig.bearing.radius_m
    return Domain(reynolds, reynolds * math.sqrt(ratio), reynolds * ratio)


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
