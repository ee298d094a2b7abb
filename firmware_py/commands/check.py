"""``orbitd check RIG``: everything the device would refuse at start, found before it starts.

All faults at once, each with file, line, key, value, limit and next step.  Exit code 0: good; 1:
good, but a model is not used; 2: refused.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import msgspec

from firmware_py import launch
from firmware_py.brain.store import Models
from firmware_py.commands.building import build, surroundings
from firmware_py.config import Config, ConfigError, Source
from firmware_py.config.source import shown
from firmware_py.machine.folder import METAVAR, find
from firmware_py.machine.values import MachineTable


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
    options = parser.parse_args(argv)
    try:
        return _check(options.rig, options.json)
    except ConfigError as error:
        if options.json:
            print(msgspec.json.encode({"good": False, "faults": error.faults}).decode())
            return error.exit_code
        raise


def _check(path: Path, as_json: bool) -> int:
    config, source = launch.verified(path)
    missing = [
        source.fault(*found) for found in surroundings(config, launch.folder_of(config), os.environ)
    ]
    if missing:
        raise ConfigError(missing)
    built = build(config)
    low_um, high_um = built.admissible_um
    if as_json:
        found = {
            "good": True,
            "config": config,
            "admissible_everywhere_um": [low_um, high_um],
            "models": _labels(built.models),
            "refused_models": built.models.refusals,
        }
        print(msgspec.json.encode(found).decode())
    else:
        print(f"{shown(path.name)}: good")
        print(
            f"  safe radial clearance {config.machine.actuator.safe_radial_clearance_um:g} um; "
            f"{low_um:.1f} .. {high_um:.1f}"
            " um is admissible over the whole declared range"
        )
        print("\n".join(f"  model {label}" for label in _labels(built.models)))
        for kind, reason in built.models.refusals.items():
            print(f"  REFUSED {kind}: {reason}")
        if path.is_file():
            print("  first schema: `orbitd migrate OLD.toml FOLDER` makes a rig folder of it")
        for line in _provenance(config):
            print(f"  {line}")
        for line in _defaults(config, source):
            print(f"  default {line}")
    return 1 if built.models.refusals else 0


def _labels(models: Models) -> list[str]:
    return [model.label for model in (models.classifier, models.actor, models.surrogate) if model]


def _provenance(config: Config) -> list[str]:
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
    return [f"{source.place(key)[1]} = {value!r}" for key, value in keys if not source.written(key)]
