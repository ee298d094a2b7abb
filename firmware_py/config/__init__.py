"""The device's configuration: one TOML file, typed, with a unit in every name and one place per limit.

:func:`load` reads it; an unknown key, a wrong type or a value outside its own range is a
:class:`ConfigError` that names file, line, key, value, limit and next step.  Checks that need more than
one value live beside what they protect and report through :meth:`ConfigFile.error`.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec

from firmware_py.config.checks import check_related
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
    Recorder,
    Rotor,
    Sampling,
    Zenoh,
)
from firmware_py.config.source import ConfigError, ConfigFile

__all__ = [
    "SHIPPED",
    "Actuator",
    "Authority",
    "Bearing",
    "Bus",
    "Channel",
    "Config",
    "ConfigError",
    "ConfigFile",
    "Device",
    "Drive",
    "Feed",
    "Limits",
    "Metrics",
    "Models",
    "Oil",
    "Operating",
    "Recorder",
    "Rotor",
    "Sampling",
    "Zenoh",
    "load",
    "parse",
]

SHIPPED = Path(__file__).resolve().parent.parent / "configs"
"""Folder of the configurations that come with the package."""


def load(path: Path) -> tuple[Config, ConfigFile]:
    """Read and check ``path``.

    Returns
    -------
    The configuration and the :class:`ConfigFile` through which later checks report.

    Raises
    ------
    ConfigError
        Missing file, TOML syntax, unknown key, wrong type, value outside its own or a related limit.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        cause = f"cannot be read ({error}); name a readable TOML file"
        raise ConfigError(f"config error: {path}: {cause}") from error
    return parse(text, path)


def parse(text: str, path: Path = Path("<text>")) -> tuple[Config, ConfigFile]:
    """As :func:`load`, from the TOML ``text``."""
    source = ConfigFile(path, text)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"config error: {path.name}: not valid TOML: {error}") from error
    try:
        config = msgspec.convert(table, Config)
    except msgspec.ValidationError as error:
        raise _typed_error(source, str(error), table) from error
    check_related(config, source)
    return config, source


def _typed_error(source: ConfigFile, text: str, table: object) -> ConfigError:
    """A msgspec message (``... - at `$.a.b` ``) as ours."""
    cause, _, path = text.partition(" - at `$")
    key = path.rstrip("`").lstrip(".")
    for pattern, advice in (
        (r"unknown field `(\w+)`", "unknown key; remove it or correct its spelling"),
        (r"missing required field `(\w+)`", "missing; set it"),
    ):
        if found := re.search(pattern, cause):
            return source.error(f"{key}.{found.group(1)}".lstrip("."), None, advice)
    return source.error(key, _value_at(table, key), f"{cause[0].lower()}{cause[1:]}; correct the value")


def _value_at(table: object, key: str) -> object:
    """The plain value at the dotted ``key``, None for a table or a list."""
    for part in re.findall(r"\w+", key):
        if isinstance(table, dict):
            table = table.get(part)
        elif isinstance(table, list) and part.isdigit():
            table = table[int(part)]
    return None if isinstance(table, dict | list) else table
