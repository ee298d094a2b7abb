"""``orbitd rig show`` of a film that the device's own laws do not know: by the solver."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from math import degrees
from typing import Any, Final

from firmware_py.commands.rig_figures import (
    LINEAR,
    RPM,
    Cell,
    RigFigures,
    criticals_of,
    stiffness_of,
)
from firmware_py.config import Config
from firmware_py.guard.envelope.cost import Corner, corners
from firmware_py.machine import Machine
from firmware_py.machine.feeds import CAPILLARY, RESTRICTED, FeedPort
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.parts import ROTOR, has
from firmware_py.machine.restrictor import ENTRANCE_SHARE, LAMINAR_RE, bore_Re, restrictor
from firmware_py.machine.supply import nominal_bar

L_MIN: Final = 6e4
"""Of m3/s."""


def solved_tables(config: Config) -> Iterator[RigFigures | str]:
    """Film, feeds, coefficients, modes and whirl; or a line that says what is missing for them."""
    module, _, name = LINEAR.partition(":")
    try:
        solve = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        yield (
            "film, feeds, coefficients and whirl are left out: this film needs the solver, and "
            f"there is no {error.name}; pip install 'orbitd[sim]'"
        )
        return
    machine, b = config.machine, config.machine.bearing
    built_um = machine.actuator.safe_radial_clearance_um + b.radial_clearance_offset_um
    states = [
        (_named(corner), _solved(solve, config, built_um, corner)) for corner in corners(config)
    ]
    yield _film(config, built_um, states)
    if machine.feed_port:
        yield _feeds(config, states)
    yield stiffness_of([(name, at.stiffness_N_m if at else None, at) for name, at in states])
    if not has(machine, ROTOR):
        yield "whirl and critical speeds are left out: no [rotor]"
        return
    yield criticals_of([(name, at) for name, at in states])
    yield _whirl(config, solve)


def _named(corner: Corner) -> str:
    return f"{corner.speed_rad_s * RPM:.0f} rpm, {corner.load_N:g} N"


def _solved(solve: Any, config: Config, clearance_um: float, corner: Corner) -> Any | None:
    """The film at a corner, None where it does not carry the load."""
    mu = viscosity_Pa_s(config.machine.lubricant, config.machine.lubricant.inlet_max_C)
    try:
        return solve(config.machine, clearance_um * 1e-6, mu, *corner)
    except ValueError:  # of the film: the load is more than it carries
        return None


def _film(config: Config, built_um: float, states: list[tuple[str, Any]]) -> RigFigures:
    machine = config.machine
    rows: list[list[Cell]] = []
    for (name, at), corner in zip(states, corners(config), strict=True):
        speed = corner.speed_rad_s
        wind_W = machine.rotor.windage_W_s3 * speed * speed * speed
        found: list[Cell] = [None] * 5
        if at:
            found = [
                at.film_m * 1e6, at.eccentricity, degrees(at.attitude_rad),
                at.friction_W + wind_W, at.flow_m3_s * L_MIN,
            ]  # fmt: skip
        rows.append([name, *found])
    return RigFigures(
        "film", "Film at rest at the corners",
        f"by the solver, {_fed(machine)}, in {built_um:g} um, "
        f"oil at {machine.lubricant.inlet_max_C:g} degC; it must stay above limits.min_film_um = "
        f"{config.limits.min_film_um:g} um; -: it does not carry the load",
        ("corner", "film um", "eccentricity", "attitude deg", "power W", "flow L/min"), rows,
    )  # fmt: skip


def _feeds(config: Config, states: list[tuple[str, Any]]) -> RigFigures:
    """Pressure in each opening, and the Reynolds number of its bore, at the corners."""
    machine = config.machine
    oil = machine.lubricant
    mu, radius_m = viscosity_Pa_s(oil, oil.inlet_max_C), machine.bearing.journal_radius_m
    rows: list[list[Cell]] = []
    for i, port in enumerate(machine.feed_port):
        restricted = any(restrictor(port, radius_m, oil.density_kg_m3)[:4])
        supply = nominal_bar(machine.feed) if port.pressure_bar is None else port.pressure_bar
        bars: list[Cell] = []
        most = 0.0
        for _, at in states:
            known = at is not None and at.feed_Pa
            bars.append(1e-5 * at.feed_Pa[i] if known else None if restricted else supply)
            if known and port.kind in RESTRICTED:
                most = max(most, bore_Re(port, at.feed_flow_m3_s[i], oil.density_kg_m3, mu))
        word = _regime(port, most) if port.kind == CAPILLARY else ""
        rows.append([f"{port.kind} at {port.angle_deg:g} deg", *bars, most or None, word])
    return RigFigures(
        "feeds", "Pressure in the feeds at the corners",
        f"bar, of {nominal_bar(machine.feed):g} before the restrictors; 0.3 .. 0.7 of it is "
        f"stiffest; Re of the bore, a capillary's law ends at {LAMINAR_RE:g}",
        ("feed", *(name for name, _ in states), "Re at most", "flow"), rows,
    )  # fmt: skip


def _regime(port: FeedPort, most_Re: float) -> str:
    """Whether the law of a capillary holds up to that Reynolds number."""
    developing_mm = ENTRANCE_SHARE * most_Re * (port.bore_mm or 0.0)
    if most_Re > LAMINAR_RE:
        return "NOT LAMINAR"
    return "laminar" if developing_mm < (port.capillary_length_mm or 0.0) else "ENTRANCE COUNTS"


def _whirl(config: Config, solve: Any) -> RigFigures:
    """Mass that just whirls, over clearance."""
    b = config.machine.bearing
    values = {b.radial_clearance_min_um, b.radial_clearance_nominal_um, b.radial_clearance_max_um}
    rows: list[list[Cell]] = []
    for um in sorted(values):
        row: list[Cell] = [um]
        for corner in corners(config):
            at = _solved(solve, config, um, corner)
            row.append(None if at is None else at.whirl_kg)
        rows.append(row)
    mass = config.machine.rotor.mass_at_bearing_kg
    return RigFigures(
        "whirl", "Mass at the bearing that just whirls, kg, over clearance",
        f"of a balanced rigid rotor, by the solver; this one has {mass:.3g} kg, and must stay well "
        "below each; inf: none whirls, -: the film does not carry the load",
        ("clearance um", *(_named(corner) for corner in corners(config))), rows,
    )  # fmt: skip


def _fed(machine: Machine) -> str:
    """How the film gets its oil."""
    if machine.feed_port:
        return f"with its feed at {nominal_bar(machine.feed):g} bar"
    return "from grooves between its pads at ambient pressure"
