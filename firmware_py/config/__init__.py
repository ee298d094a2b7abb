"""The device's configuration: a rig folder, typed, with a unit in every name and one place per
limit.

:func:`load` reads and verifies it (:mod:`~firmware_py.config.verify`).  Every fault is told at
once, each with file, line, key, value, limit and next step: :class:`ConfigError`.
"""

from __future__ import annotations

from firmware_py.config.schema import (
    AuthorityConfig,
    Bus,
    Config,
    DeviceConfig,
    Drive,
    Limits,
    Metrics,
    ModelsConfig,
    RecorderConfig,
    Sampling,
    Zenoh,
)
from firmware_py.config.source import ConfigError, ConfigFile, Fault, Source
from firmware_py.config.verify import Check, decode, load, parse, read_device, read_machine
from firmware_py.machine.folder import SHIPPED

__all__ = [
    "SHIPPED",
    "AuthorityConfig",
    "Bus",
    "Check",
    "Config",
    "ConfigError",
    "ConfigFile",
    "DeviceConfig",
    "Drive",
    "Fault",
    "Limits",
    "Metrics",
    "ModelsConfig",
    "RecorderConfig",
    "Sampling",
    "Source",
    "Zenoh",
    "decode",
    "load",
    "parse",
    "read_device",
    "read_machine",
]
