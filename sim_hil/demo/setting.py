"""What a demo is played with: configuration, rig and the build drawn from the seed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from firmware_py.config import SHIPPED, Config, load
from sim_hil.build import Build
from sim_hil.rigs import RigData, load_rig


@dataclass(frozen=True)
class Setting:
    """Device, rig, and one example of the rig."""

    config: Config
    rig: RigData
    build: Build

    def on(self, **bus: Any) -> Setting:
        """The same with other ``bus`` settings."""
        changed = msgspec.structs.replace(
            self.config, bus=msgspec.structs.replace(self.config.bus, **bus)
        )
        return Setting(changed, self.rig, self.build)


def prepare(rig_name: str, seed: int) -> Setting:
    """The shipped configuration of ``rig_name`` with provisional models allowed to act, and a drawn
    build.

    The device does not know the build: masses, stiffnesses, clearance, viscosity, runout and sensor
    errors are drawn from ``seed`` within the spreads of ``classes.json`` and ``sensors.json``.
    """
    config, _ = load(SHIPPED / f"{rig_name}.toml")
    authority = msgspec.structs.replace(config.authority, provisional_may_act=True)
    rig = load_rig(rig_name)
    return Setting(
        msgspec.structs.replace(config, authority=authority), rig, Build.of_seed(rig, seed)
    )


def write_config(config: Config, path: Path) -> None:
    """Write ``config`` as TOML, for the processes that read it."""
    path.write_text("\n".join(_toml(msgspec.to_builtins(config))) + "\n")


def _toml(table: dict[str, Any]) -> Iterator[str]:
    """The two-level tables of a configuration; JSON's scalars and lists are TOML's."""
    for key, value in table.items():
        if not isinstance(value, dict | list):
            yield f"{key} = {json.dumps(value)}"
    for key, value in table.items():
        for head, entries in _tables(key, value):
            yield head
            yield from (f"{name} = {json.dumps(entry)}" for name, entry in entries.items())


def _tables(key: str, value: object) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(value, dict):
        yield f"[{key}]", value
    elif isinstance(value, list):
        yield from ((f"[[{key}]]", entry) for entry in value)
