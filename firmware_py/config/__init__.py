"""The device's configuration: one TOML file, typed, with a unit in every name and one place per
limit.

:func:`load` reads and verifies it (:mod:`~firmware_py.config.verify`).  Every fault is told at
once, each with file, line, key, value, limit and next step: :class:`ConfigError`.
"""

from __future__ import annotations

from pathlib import Path

from firmware_py.config.schema import (
    Actuator,
    Authority,
    Bearing,
    Bus,
    Channel,
    Config,
    Device,
    Drive,
    Feed,
    Limits,
    Metrics,
    Models,
    Oil,
    Operating,
    Readings,
    Recorder,
    Rotor,
    Sampling,
    Zenoh,
)
from firmware_py.config.source import ConfigError, ConfigFile, Fault
from firmware_py.config.verify import Check, decode, load, parse, read_device

__all__ = [
    "SHIPPED",
    "Actuator",
    "Authority",
    "Bearing",
    "Bus",
    "Channel",
    "Check",
    "Config",
    "ConfigError",
    "ConfigFile",
    "Device",
    "Drive",
    "Fault",
    "Feed",
    "Limits",
    "Metrics",
    "Models",
    "Oil",
    "Operating",
    "Readings",
    "Recorder",
    "Rotor",
    "Sampling",
    "Zenoh",
    "decode",
    "load",
    "parse",
    "read_device",
]

SHIPPED = Path(__file__).resolve().parent.parent / "configs"
"""Folder of the configurations that come with the package."""
