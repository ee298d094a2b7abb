"""What a demo is played with: configuration, rig and the build drawn from the seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from firmware_py.config import Config, load
from firmware_py.machine.folder import SIMULATION, find
from sim_hil.plant.build import Build
from sim_hil.rigs import RigData, load_rig


@dataclass(frozen=True)
class Setting:
    """Device, rig, and one example of the rig."""

    config: Config
    rig: RigData
    build: Build
    simulation: str = ""
    """Text of the rig folder's ``simulation.toml``."""

    def on(self, **bus: Any) -> Setting:
        """The same with other ``bus`` settings."""
        changed = self.config.replaced(bus=msgspec.structs.replace(self.config.bus, **bus))
        return Setting(changed, self.rig, self.build, self.simulation)


def prepare(rig_name: str, seed: int) -> Setting:
    """The configuration of ``rig_name``, a shipped rig or a folder, with provisional models allowed
    to act, and a drawn build.

    The device does not know the build: masses, stiffnesses, clearance, viscosity, runout and sensor
    errors are drawn from ``seed`` within the spreads of the rig folder.
    """
    folder = find(rig_name)
    config, _ = load(folder)
    authority = msgspec.structs.replace(config.authority, provisional_may_act=True)
    rig = load_rig(rig_name)
    told = folder / SIMULATION
    text = told.read_text(encoding="utf-8") if told.is_file() else ""
    return Setting(config.replaced(authority=authority), rig, Build.of_seed(rig, seed), text)
