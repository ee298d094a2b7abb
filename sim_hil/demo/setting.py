"""What a demo is played with: configuration, rig and the build drawn from the seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec

from firmware_py.config import SHIPPED, Config, load
from sim_hil.plant.build import Build
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
    errors are drawn from ``seed`` within the spreads of the rig folder.
    """
    config, _ = load(SHIPPED / rig_name)
    authority = msgspec.structs.replace(config.authority, provisional_may_act=True)
    rig = load_rig(rig_name)
    return Setting(config.replaced(authority=authority), rig, Build.of_seed(rig, seed))
