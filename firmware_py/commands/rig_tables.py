"""Which tables of figures a rig folder allows, in their order."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import Any

from firmware_py.commands.rig_figures import (
    LINEAR,
    RigFigures,
    admissible,
    budget,
    criticals,
    film,
    groups,
    onset,
    rotor,
    sampling,
    stable,
    states,
    stiffness,
)
from firmware_py.commands.rig_solved import solved_tables
from firmware_py.config import Config
from firmware_py.guard.envelope.cost import costs
from firmware_py.machine.parts import LOAD, ROTOR, has, has_film, has_film_law, monitor_only


def tables(config: Config) -> Iterator[RigFigures | str]:
    """Every table that the machine allows, and a line for each that is left out."""
    machine, why = config.machine, monitor_only(config.machine)
    yield sampling(config)
    if has(machine, ROTOR) and has(machine, LOAD):
        yield rotor(config)
    if has_film(machine) and not has_film_law(machine):
        yield groups(config)
        yield from solved_tables(config)
        yield "admissible clearance and error budget are left out: " + "; ".join(why)
        return
    if not has_film_law(machine):
        yield "film, whirl and admissible clearance are left out: " + "; ".join(why)
        return
    yield groups(config)
    yield film(config)
    if has(machine, ROTOR):
        yield onset(config)
        yield stable(config)
        linear, lacking = _linear(config)
        yield stiffness(config, linear)
        if linear:
            yield criticals(config, linear)
        else:
            yield f"damping and critical speeds are left out: {lacking}"
    else:
        yield stiffness(config, [])
        yield "whirl, damping and critical speeds are left out: no [rotor]"
    if why:
        yield "admissible clearance and error budget are left out: " + "; ".join(why)
        return
    found = costs(config, machine.lubricant.inlet_max_C)
    yield admissible(config, found)
    yield budget(config, found)


def _linear(config: Config) -> tuple[list[Any], str]:
    """Damping and modes at the corners by the simulator's film, None where it does not carry the
    load; or why there are none."""
    module, _, name = LINEAR.partition(":")
    try:
        linear = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        return [], f"no {error.name}; pip install 'orbitd[sim]'"
    return [
        linear(config.machine, state.clearance_m, state.viscosity, *state.corner)
        if state.rest
        else None
        for state in states(config)
    ], ""
