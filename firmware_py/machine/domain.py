"""Where the film equation holds: laminar, and without inertia of the oil.

With the surface speed ``omega R``, the gap ``c`` and the viscosity ``mu``

    Re = rho omega R c / mu,   Ta = Re sqrt(c / R),   Re* = rho omega c^2 / mu

Taylor vortices begin at Ta = 41 between concentric cylinders (Taylor, Phil. Trans. R. Soc. A 223,
1923), and Reynolds' equation leaves out the inertia of the oil, which is of the order Re* of its
friction (Szeri, Fluid Film Lubrication).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import pi, sqrt
from typing import Final, NamedTuple

from firmware_py.machine.film import LENGTH_OVER_DIAMETER_MAX
from firmware_py.machine.lubricant import ViscosityTable
from firmware_py.machine.schema import Machine

TAYLOR_LIMIT: Final = 41.0
INERTIA_LIMIT: Final = 1.0


class FilmDomain(NamedTuple):
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


def film_domain(
    radius_m: float,
    clearance_m: float,
    density_kg_m3: float,
    viscosity_Pa_s: float,
    speed_rad_s: float,
) -> FilmDomain:
    """Where a film stands; the speed counts without its sign."""
    reynolds = density_kg_m3 * abs(speed_rad_s) * radius_m * clearance_m / viscosity_Pa_s
    ratio = clearance_m / radius_m
    return FilmDomain(reynolds, reynolds * sqrt(ratio), reynolds * ratio)


def fastest_film(machine: Machine, clearance_um: float) -> FilmDomain:
    """The film of ``machine`` in that radial clearance at its greatest speed in its hottest oil."""
    oil = machine.lubricant
    return film_domain(
        machine.bearing.journal_radius_m,
        clearance_um * 1e-6,
        oil.density_kg_m3,
        ViscosityTable(oil).law(oil.film_max_C),
        machine.operating.speed_max_rpm * pi / 30.0,
    )


def film_range(machine: Machine) -> tuple[FilmDomain, FilmDomain]:
    """The least and the greatest that a film of ``machine`` can be over its whole declared range:
    narrowest at the least speed in the coldest oil, widest at the greatest in the hottest."""
    b, o, oil = machine.bearing, machine.operating, machine.lubricant
    law = ViscosityTable(oil)
    low, high = (
        film_domain(
            b.journal_radius_m,
            (um + b.radial_clearance_offset_um) * 1e-6,
            oil.density_kg_m3,
            law.law(celsius),
            rpm * pi / 30.0,
        )
        for um, celsius, rpm in (
            (b.radial_clearance_min_um, oil.inlet_min_C, o.speed_min_rpm),
            (b.radial_clearance_max_um, oil.film_max_C, o.speed_max_rpm),
        )
    )
    return low, high


def laminar_up_to_um(machine: Machine) -> float:
    """Radial clearance from which on the film may be no longer laminar at the greatest speed in the
    hottest oil, as the actuator tells it: Ta grows as the clearance to 3/2."""
    offset_um = machine.bearing.radial_clearance_offset_um
    widest_um = machine.bearing.radial_clearance_max_um + offset_um
    taylor = film_range(machine)[1].taylor
    share: float = (TAYLOR_LIMIT / taylor) ** (2.0 / 3.0)
    return widest_um * share - offset_um


def outside_laws(machine: Machine) -> Iterator[str]:
    """Why the guard's laws of the film are not proven for ``machine``, each with value and limit;
    nothing where they are.

    The film is judged in the retreat value, where the machine ends whatever happens.
    """
    b = machine.bearing
    if machine.feed_port:
        count = Counter(port.kind for port in machine.feed_port)
        named = ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in count.items())
        yield (
            f"feed_port: {named}: the guard's laws know no feed but one groove at the supply "
            "pressure; what this one carries, and its stiffness, is not in them"
        )
    ratio = 0.5 * b.length_m / b.journal_radius_m
    if ratio > LENGTH_OVER_DIAMETER_MAX:
        yield (
            f"L/D = {ratio:.2f}: the guard's bounds are verified up to "
            f"{LENGTH_OVER_DIAMETER_MAX:g} (bearing.length_m {b.length_m:g}, journal_radius_m "
            f"{b.journal_radius_m:g})"
        )
    clearance_um = machine.actuator.safe_radial_clearance_um
    taylor = fastest_film(machine, clearance_um).taylor
    if taylor > TAYLOR_LIMIT:
        yield (
            f"Ta = {taylor:.3g}: the film is laminar up to {TAYLOR_LIMIT:g} (in the retreat value "
            f"{clearance_um:g} um at operating.speed_max_rpm {machine.operating.speed_max_rpm:g}, "
            f"oil of lubricant.film_max_C {machine.lubricant.film_max_C:g})"
        )
