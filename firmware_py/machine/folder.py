"""Rig folders: what lies in one, which ship with the package, and which one a person means.

my_rig/
  machine.toml      what the machine is
  device.toml       how the device runs there
  simulation.toml   what only a simulator needs besides; optional
  models/           a set of models that was trained for it; optional
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from firmware_py.model_sets.manifest import MANIFEST

MACHINE: Final = "machine.toml"
DEVICE: Final = "device.toml"
SIMULATION: Final = "simulation.toml"
MODELS: Final = "models"

SHIPPED: Final = Path(__file__).resolve().parent.parent / "rigs"
"""Folder of the rig folders that come with the package."""

METAVAR: Final = "NAME_OR_FOLDER"


def shipped_names() -> list[str]:
    """Names of the rigs that come with the package."""
    return sorted(path.parent.name for path in SHIPPED.glob(f"*/{MACHINE}"))


def own_set(rig: Path) -> Path | None:
    """The set of models in the rig folder ``rig`` itself; None without a whole one."""
    models = rig.resolve() / MODELS
    return models if (models / MANIFEST).is_file() else None


def simulated_names() -> list[str]:
    """Names of those that can be simulated."""
    return [name for name in shipped_names() if (SHIPPED / name / SIMULATION).is_file()]


def find(named: str) -> Path:
    """The rig that a person names: a shipped one, a folder, or a file of the first schema.

    A shipped rig's name wins; ``./bench`` is a folder in any case.
    """
    return SHIPPED / named if named in shipped_names() else Path(named)


def add_option(parser: argparse.ArgumentParser, text: str, default: Path | None = None) -> None:
    """``--rig``, and ``--config`` as it was called, to ``options.rig``; ``text`` says what for."""
    parser.add_argument(
        "--rig", "--config", dest="rig", type=find, default=default, metavar=METAVAR, help=text
    )
