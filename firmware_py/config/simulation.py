"""Reads ``simulation.toml`` of a rig folder: for the simulator, and for ``orbitd check``."""

from __future__ import annotations

from pathlib import Path

import msgspec

from firmware_py.config.convert import convert
from firmware_py.config.source import ConfigError, read_file
from firmware_py.config.verify import toml_table
from firmware_py.machine.folder import SIMULATION
from firmware_py.machine.simulation import Simulation


def load_simulation(rig: Path) -> Simulation:
    """What ``simulation.toml`` of the folder ``rig`` says; all defaults where there is none.

    Raises
    ------
    ConfigError
        With every fault: the file, TOML, keys, values.
    """
    path = rig / SIMULATION
    if not path.exists():
        return Simulation()
    file = read_file(path, f"{rig.resolve().name}/{SIMULATION}")
    values, found = convert(toml_table(file), Simulation)
    if found:
        raise ConfigError([file.fault(*each) for each in found])
    return msgspec.convert(values, Simulation)
