"""``orbitd rig new FOLDER``: a complete rig folder to edit, each key with what it means.

The figures come from a shipped rig or from a folder.  A shipped rig is no machine of yours, and
is known better than any: its uncertainties become the schema's defaults, which a lab can reach, and
its simulation follows the machine as you edit it.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import msgspec

from firmware_py import launch
from firmware_py.config import Config
from firmware_py.config.commented import commented
from firmware_py.config.limits import with_limits
from firmware_py.config.schema import ModelsConfig
from firmware_py.config.simulation import load_simulation
from firmware_py.config.source import shown
from firmware_py.config.written import FolderError, write_rig
from firmware_py.machine.folder import METAVAR, SIMULATION, find, own_set, shipped_names
from firmware_py.machine.parts import ACTUATOR, FEED, OTHERS, READINGS
from firmware_py.machine.probes import PROBES
from firmware_py.machine.simulation import Simulation
from firmware_py.machine.values import NAME_PATTERN, WORDS, MachineTable, Section

UNCERTAIN = "_error_"
"""In the name of every key that says how well another is known."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Folder, source and name."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="rig folder to make")
    parser.add_argument(
        "--from",
        dest="source",
        default="bench",
        metavar=METAVAR,
        help="shipped rig or rig folder whose figures it begins with (default: bench)",
    )
    parser.add_argument(
        "--monitor",
        action="store_true",
        help="a machine that is watched only: two probes and a mark; the rest behind a #",
    )
    parser.add_argument(
        "--name", metavar="NAME", help="of machine and rig (default: that of the folder)"
    )


def run(options: argparse.Namespace) -> int:
    """Write the folder, and say what comes next."""
    folder, source = options.folder, options.source
    name = name_of(options.name or folder.absolute().name)
    texts = texts_for(source, name, monitor=options.monitor)
    write_rig(texts, folder)
    where = shown(str(folder))
    print(f"{where}: {', '.join(texts)}, with the figures of {shown(source)}; edit them, then")
    print(f"  orbitd check {where}       what is wrong with it")
    print(f"  orbitd rig show {where}    what follows from it")
    return 0


def name_of(name: str) -> str:
    """``name`` if a machine may be called so.

    Raises
    ------
    FolderError
        It may not.
    """
    if not re.search(NAME_PATTERN, name):
        raise FolderError(f"{shown(name)}: not {WORDS[NAME_PATTERN]}; give one with --name")
    return name


def texts_for(source: str, name: str, *, monitor: bool = False) -> dict[str, str]:
    """The files of a rig ``name`` with the figures of the rig ``source``; ``monitor``: of a machine
    that has two probes and a mark, and no actuator.

    Raises
    ------
    ConfigError
        ``source`` has faults.
    """
    path = find(source)
    config, _ = launch.verified(path)
    simulated = (path / SIMULATION).is_file() or path.is_file()
    simulation = load_simulation(path) if simulated else None
    if source in shipped_names():
        config, simulation = as_known(config), following(simulation)
    if monitor:
        config, simulation = watched(config), None
    config = config.replaced(
        machine=msgspec.structs.replace(config.machine, name=name),
        models=of_no_other(config, path),
        device=msgspec.structs.replace(
            config.device, rig=name, instance="default", mode_at_start="monitor"
        ),
    )
    return commented(config, simulation, source)


def of_no_other(config: Config, rig: Path) -> ModelsConfig:
    """What ``config`` says of models, without the set that lies in the folder ``rig`` itself."""
    own = own_set(rig)
    theirs = own is not None and config.models.directory == str(own)
    return msgspec.structs.replace(config.models, directory="") if theirs else config.models


def watched(config: Config) -> Config:
    """``config`` of a machine with two probes and a mark at one bearing, whose clearance is
    fixed."""
    machine, limits = config.machine, config.limits
    fixed_um = machine.bearing.radial_clearance_nominal_um
    absent = (set(machine.absent) | {ACTUATOR, FEED, READINGS}) - {OTHERS}
    config = config.replaced(
        bearing=msgspec.structs.replace(
            machine.bearing, radial_clearance_min_um=fixed_um, radial_clearance_max_um=fixed_um
        ),
        channel=machine.channel[:PROBES],
        other_bearing=[],
        contact=None,
        reading=[],
        absent=tuple(sorted(name for name in absent if "/" not in name)),
        limits_at=[],
        measure=[],
        group=[],
        multiply=[],
        bus=msgspec.structs.replace(config.bus, schema=2),
    )
    off = with_limits({"limits": {}, "machine": msgspec.to_builtins(config.machine)})["limits"]
    return config.replaced(limits=msgspec.structs.replace(limits, **off))


def as_known(config: Config) -> Config:
    """``config`` with every uncertainty of machine at what a lab can reach: the schema's default,
    where it has one."""
    tables = {
        name: msgspec.structs.replace(table, **reachable(table))
        for name, table in config.machine.tables()
        if "[" not in name
    }
    return config.replaced(**tables)


def following(simulation: Simulation | None) -> Simulation | None:
    """``simulation`` without what may follow ``machine.toml``: a machine that is edited there is
    simulated as edited; the duty of a shipped rig is none of another machine."""
    if simulation is None:
        return None
    tables = {
        name: msgspec.structs.replace(
            table, **{f.name: None for f in msgspec.structs.fields(table) if f.default is None}
        )
        for name, table in msgspec.structs.asdict(simulation).items()
        if isinstance(table, Section)
    }
    return msgspec.structs.replace(simulation, **tables, duty=[])


def reachable(table: MachineTable) -> dict[str, float]:
    """Defaults of the uncertainties of ``table``."""
    return {
        field.name: field.default
        for field in msgspec.structs.fields(table)
        if UNCERTAIN in field.name and isinstance(field.default, float)
    }
