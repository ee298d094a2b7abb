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
        changed = self.config.replaced(bus=msgspec.structs.replace(self.config.bus, **bus))
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
    return Setting(config.replaced(authority=authority), rig, Build.of_seed(rig, seed))


def write_config(config: Config, path: Path) -> None:
    """Write ``config`` as TOML, for the processes that read it."""
    path.write_text("\n".join(_toml(msgspec.to_builtins(config))) + "\n")


def _toml(table: dict[str, Any], above: str = "") -> Iterator[str]:
    """The tables of a configuration; JSON's scalars and lists of them are TOML's."""
    inner = {key: value for key, value in table.items() if _tables(value)}
    for key, value in table.items():
        if key not in inner and value is not None:
            yield f"{key} = {json.dumps(value)}"
    for key, value in inner.items():
        head = f"[[{above}{key}]]" if isinstance(value, list) else f"[{above}{key}]"
        for entry in _tables(value):
            yield head
            yield from _toml(entry, f"{above}{key}.")


def _tables(value: object) -> list[dict[str, Any]]:
    """The tables that ``value`` is; none of a scalar or a list of scalars."""
    each = value if isinstance(value, list) else [value]
    return [entry for entry in each if isinstance(entry, dict)]
