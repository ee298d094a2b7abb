"""``orbitd check RIG``: everything the device would refuse at start, found before it starts.

All faults at once, each with file, line, key, value, limit and next step.  Exit code 0: good; 1:
good, but a model is not used that a machine like this could use; 2: refused.
"""

from __future__ import annotations

import argparse
import os
from math import isinf
from pathlib import Path
from textwrap import shorten
from typing import Final

import msgspec

from firmware_py import launch
from firmware_py.brain.store import Model, Models
from firmware_py.commands import set_points
from firmware_py.commands.building import build, surroundings
from firmware_py.config import Config, ConfigError, Source, sampling
from firmware_py.config.limits import LIMITS_OFF
from firmware_py.config.simulation import load_simulation
from firmware_py.config.source import shown
from firmware_py.guard.plausibility.reading_rows import power_max_W
from firmware_py.machine import supply
from firmware_py.machine.domain import (
    TAYLOR_LIMIT,
    fastest_film,
    film_range,
    laminar_up_to_um,
)
from firmware_py.machine.feeds import RESTRICTED
from firmware_py.machine.folder import METAVAR, find
from firmware_py.machine.lubricant import viscosity_Pa_s
from firmware_py.machine.parts import (
    FEED,
    ROTOR,
    absences,
    has,
    has_film,
    monitor_only,
    stand_in_keys,
)
from firmware_py.machine.probes import probe_errors
from firmware_py.machine.restrictor import restrictor
from firmware_py.machine.simulation import Simulation
from firmware_py.machine.static import shaft_beyond_m
from firmware_py.machine.values import MachineTable

FIRST_ORDER_SHARE: Final = 0.6
"""Of the greatest runout, as ``spread.runout_max_um`` has it."""
REASON_SHOWN: Final = 300
"""Characters of a refusal that names many figures; ``--all`` shows it whole."""
MORE: Final = " .. and more: --all shows them"


LATE_TURN: Final = 0.02
"""Lag of a recess, in turns at the greatest speed, above which its pressure no longer follows the
orbit at once: damping falls, and with much air a recess hammers."""


def main(argv: list[str]) -> int:
    """Verify the configuration as the processes do, build what they build, and look at what they
    need around them."""
    parser = argparse.ArgumentParser(prog="orbitd check", description=__doc__)
    parser.add_argument(
        "rig",
        type=find,
        metavar=METAVAR,
        help="shipped rig, rig folder, or file of the first schema",
    )
    parser.add_argument(
        "--json", action="store_true", help="the effective configuration, or the faults, as JSON"
    )
    parser.add_argument(
        "--all", action="store_true", help="also every key at its default, and refusals in full"
    )
    options = parser.parse_args(argv)
    try:
        return _check(options.rig, options.json, options.all)
    except ConfigError as error:
        if options.json:
            print(msgspec.json.encode({"good": False, "faults": error.faults}).decode())
            return error.exit_code
        raise


def _read(path: Path) -> tuple[Config, Source]:
    """As the processes do, and ``simulation.toml``, which they leave alone; all faults at once."""
    faults = []
    try:
        if path.is_dir():
            load_simulation(path)
    except ConfigError as error:
        faults = error.faults
    try:
        read = launch.verified(path)
    except ConfigError as error:
        raise ConfigError(error.faults + faults) from error
    if faults:
        raise ConfigError(faults)
    return read


def _check(path: Path, as_json: bool, whole: bool) -> int:
    config, source = _read(path)
    missing = [
        source.fault(*found) for found in surroundings(config, launch.folder_of(config), os.environ)
    ]
    if missing:
        raise ConfigError(missing)
    built = build(config)
    machine, low_high_um = config.machine, built.admissible_um
    why, refused = monitor_only(machine), built.models.refusals
    if as_json:
        found = {
            "good": True,
            "config": config,
            "admissible_everywhere_um": low_high_um,
            "film_laws_up_to_um": low_high_um and laminar_up_to_um(machine),
            "monitor_only": why,
            "cautions": list(set_points.remarks(config)),
            "absent": [absence._asdict() for absence in absences(machine)],
            "samples_per_turn": sampling.samples_per_turn(config),
            "analysis_up_to_rpm": sampling.highest_rpm(config, sampling.ANALYSIS),
            "models": [model.label for model in _used(built.models)],
            "refused_models": refused,
            "models_off": built.models.off,
        }
        print(msgspec.json.encode(found).decode())
    else:
        print(f"{shown(path.name)}: good")
        print("\n".join(f"  {line}" for line in _rights(config, low_high_um)))
        for absence in absences(machine):
            print(f"  absent {absence.name}: off is {absence.off}")
        for kind, reason in built.models.off.items():
            print(f"  off {kind}: {reason}")
        for model in _used(built.models):
            print(f"  model {model.described}")
        for kind, reason in refused.items():
            said = reason if whole else shorten(reason, REASON_SHOWN, placeholder=MORE)
            print(f"  REFUSED {kind}: {said}")
        for line in simulated_apart(config, load_simulation(path)) if path.is_dir() else ():
            print(f"  {line}")
        if path.is_file():
            print("  first schema: `orbitd migrate OLD.toml FOLDER` makes a rig folder of it")
        for line in [*set_points.remarks(config), *_film(config), sampling.described(config)]:
            print(f"  {line}")
        for line in [*derived(config), *provenance(config)]:
            print(f"  {line}")
        defaults = _defaults(config, source)
        if whole:
            print("\n".join(f"  default {line}" for line in defaults))
        else:
            print(f"  {len(defaults)} keys at their default: --all shows them")
    shipped_for_others = why and not config.models.directory
    return 1 if refused and not shipped_for_others else 0


def simulated_apart(config: Config, simulation: Simulation) -> list[str]:
    """Where the simulator would run another machine than the one described: cautions, no faults."""
    operating, drive, spread = config.machine.operating, simulation.drive, simulation.spread
    ends = (
        ("drive.start_speed_rpm", drive.start_speed_rpm, operating.speed_min_rpm,
         operating.speed_max_rpm, "rpm"),
        ("drive.start_load_N", drive.start_load_N, operating.load_min_N, operating.load_max_N, "N"),
        ("duty.speed_rpm", max((corner.speed_rpm for corner in simulation.duty), default=None),
         0.0, operating.speed_max_rpm, "rpm"),
    )  # fmt: skip
    said = [
        f"{key} = {value:g} {unit} is outside what the machine is declared for, {low:g} .. {high:g}"
        for key, value, low, high, unit in ends
        if value is not None and not low <= value <= high
    ]
    declared_um = 1e6 * probe_errors(config.machine).runout_m
    first_um = FIRST_ORDER_SHARE * (spread.runout_max_um or 0.0)
    if first_um > declared_um * (1.0 + 1e-9):
        said.append(
            f"spread.runout_max_um = {spread.runout_max_um:g} um gives probes {first_um:g} um of "
            f"the first order, declared are {declared_um:g}"
        )
    return [f"simulation.toml: {line}; leave the key out to follow the machine" for line in said]


def _film(config: Config) -> list[str]:
    """Which regime the film is in over the whole declared range, and where it leaves its equation,
    though the guard's laws stand: a caution, no fault."""
    machine = config.machine
    if not has_film(machine):
        return []
    clearance_um, rpm = machine.actuator.safe_radial_clearance_um, machine.operating.speed_max_rpm
    low, high = film_range(machine)
    lines = [
        f"film over the declared range: Re {low.reynolds:.3g} .. {high.reynolds:.3g}, Ta "
        f"{low.taylor:.3g} .. {high.taylor:.3g}, laminar up to Ta = {TAYLOR_LIMIT:g}"
    ]
    if high.taylor > TAYLOR_LIMIT:
        lines.append(
            f"film wider than {laminar_up_to_um(machine):.3g} um at {rpm:g} rpm in oil of "
            f"{machine.lubricant.film_max_C:g} degC: not laminar; friction is greater there, and "
            "whirl begins elsewhere, than the laws of the device have it"
        )
    return lines + [
        f"film in {clearance_um:g} um at {rpm:g} rpm: {warning}; its figures are estimates"
        for warning in fastest_film(machine, clearance_um).warnings
    ]


def _rights(config: Config, admissible_um: tuple[float, float] | None) -> list[str]:
    """Which clearances are admissible; of a machine that is monitor only, why it is."""
    if admissible_um is None:
        return [f"monitor only: {reason}" for reason in monitor_only(config.machine)]
    low_um, high_um = admissible_um
    safe_um = config.machine.actuator.safe_radial_clearance_um
    laws_um = laminar_up_to_um(config.machine)
    beyond = (
        f"; CAUTION: the laws of the film hold up to {laws_um:.1f} um, a wider bearing is judged "
        "by laws that are not proven there"
    )
    return [
        f"safe radial clearance {safe_um:g} um; {low_um:.1f} .. {high_um:.1f} um is admissible "
        f"over the whole declared range{beyond if high_um > laws_um else ''}"
    ]


def _used(models: Models) -> list[Model]:
    return [model for model in (models.classifier, models.actor, models.surrogate) if model]


def derived(config: Config) -> list[str]:
    """What follows from the figures of the machine, for people to compare with what they know."""
    machine, errors = config.machine, probe_errors(config.machine)
    lines = [
        f"{machine.name}: probes within {errors.zero_m * 1e6:.3g} um of zero, "
        f"{100 * errors.gain_share:.3g} % of gain, {errors.runout_m * 1e6:.3g} um of runout"
    ]
    if has(machine, ROTOR):
        most_W = machine.readings.shaft_power_max_W or power_max_W(config)
        lines.append(
            f"rotor {machine.rotor.mass_at_bearing_kg:.4g} kg at the bearing; shaft power up to "
            f"{most_W:.4g} W is believed"
        )
        if (beyond_m := shaft_beyond_m(machine)) is not None:
            lines.append(f"shaft: ends {beyond_m:.3g} m behind the bearing")
    lines += feeds(config)
    return [*lines, *_oil(config)] if has(machine, FEED) else lines


def feeds(config: Config) -> list[str]:
    """What each restrictor lets through, and how late its recess follows."""
    machine, oil = config.machine, config.machine.lubricant
    film_m = machine.bearing.radial_clearance_nominal_um * 1e-6
    mu = viscosity_Pa_s(oil, oil.inlet_max_C)
    lines = []
    for i, port in enumerate(machine.feed_port):
        if port.kind not in RESTRICTED:
            continue
        law = restrictor(port, machine.bearing.journal_radius_m, oil.density_kg_m3)
        own = port.pressure_bar
        supply_Pa = 1e5 * (supply.nominal_bar(machine.feed) if own is None else own)
        flow, lag_s = (each(supply_Pa, mu, film_m) for each in (law.flow_m3_s, law.lag_s))
        turn = lag_s * machine.operating.speed_max_rpm / 60.0
        late = f"; LATE, by {turn:.2g} of a turn" if turn > LATE_TURN else ""
        lines.append(
            f"feed_port[{i}]: this {port.kind} at {port.angle_deg:g} deg lets {6e4 * flow:.3g} "
            f"L/min at most through at {1e-5 * supply_Pa:g} bar; its recess follows within "
            f"{lag_s:.2g} s{late}"
        )
    return lines


def _oil(config: Config) -> list[str]:
    """Limits of the oil, and how long it lasts without a pump."""
    (low_bar, least_bar), (hot_C, hottest_C) = (
        config.oil_pressure_limits_bar,
        config.oil_outlet_limits_C,
    )
    machine, source = config.machine, supply.source_bar(config.machine)
    pump = "any pressure" if isinf(source) else f"{source:.3g} bar at the film's greatest flow"
    held = supply.held_s(machine.feed, low_bar)
    return [
        f"oil: alert below {low_bar:.4g} bar and above {hot_C:.4g} degC, danger below "
        f"{least_bar:.4g} bar and above {hottest_C:.4g} degC",
        f"oil supply: the weakest pump gives {pump}; after its loss the film stays full for "
        f"{held:.3g} s from the alert on, and a retreat takes {supply.retreat_s(machine):.3g} s",
    ]


def provenance(config: Config) -> list[str]:
    """Figures of the machine that were measured or assumed, by table; the others are drawn."""
    named = [
        (word, name, keys)
        for name, table in config.machine.tables()
        for word, keys in (("measured", table.measured), ("assumed", table.assumed))
        if keys
    ]
    return [f"{word} in {name}: {', '.join(keys)}" for word, name, keys in named]


def _defaults(config: Config, source: Source) -> list[str]:
    """Every setting that the files leave to its default, with the value in force."""
    device = {
        name: table
        for name, table in msgspec.structs.asdict(config).items()
        if isinstance(table, msgspec.Struct) and name != "machine"
    }
    machine = {
        f"machine.{name}": table for name, table in config.machine.tables() if "[" not in name
    }
    keys = [
        (f"{name}.{key}", value)
        for name, table in (machine | device).items()
        for key, value in msgspec.structs.asdict(table).items()
        if key not in MachineTable.__struct_fields__ and value is not None
    ]
    lacking = stand_in_keys(msgspec.to_builtins(config.machine))
    lacking |= {key for key in LIMITS_OFF if not source.written(key)} if lacking else frozenset()
    return [
        f"{source.place(key)[1]} = {value!r}"
        for key, value in keys
        if not source.written(key) and not {key, key.rpartition(".")[0]} & lacking
    ]
