"""What a demo is played with: configuration, rig and the build drawn from the seed."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from firmware_py.config import SHIPPED, Config, load
from sim_hil.build import Build
from sim_hil.rigs import RigData, load_rig


@dataclass(frozen=True)
class Setting:
    """Device, rig, and one example of the rig."""

    config: Config
    rig: RigData
    build: Build


def prepare(rig_name: str, seed: int, link: str = "can") -> Setting:
    """The shipped configuration of ``rig_name`` with provisional models allowed to act, and a drawn build.

    The device does not know the build: masses, stiffnesses, clearance, viscosity, runout and sensor errors
    are drawn from ``seed`` within the spreads of ``classes.json`` and ``sensors.json``.
    """
    config, _ = load(SHIPPED / f"{rig_name}.toml")
    authority = msgspec.structs.replace(config.authority, provisional_may_act=True)
    config = msgspec.structs.replace(config, authority=authority)
    rig = load_rig(rig_name)
    return Setting(config, rig, Build.draw(rig, np.random.default_rng([seed, 3])))
