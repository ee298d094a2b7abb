"""The one way from the text of a configuration to a verified one: every fault at once, or none."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.config.checks import RELATED
from firmware_py.config.convert import FaultedError, Found, convert, ends_of, view
from firmware_py.config.limits import with_limits
from firmware_py.config.schema import Config, DeviceConfig
from firmware_py.config.source import (
    ConfigError,
    ConfigFile,
    Fault,
    Source,
    one_file,
    read_file,
    two_files,
)
from firmware_py.machine import Machine
from firmware_py.machine.folder import DEVICE, MACHINE, find, own_set
from firmware_py.machine.migrate import is_first, upgrade, without_retired
from firmware_py.machine.parts import completed, stand_in_keys

Check = Callable[[Config], Iterator[Found]]
"""Yields key, value and cause; reads only what it needs, and is left out where that has a fault of
its own."""


def load(path: Path, laws: Sequence[Check] = ()) -> tuple[Config, Source]:
    """Read and verify ``path``.

    Parameters
    ----------
    path
        A rig folder, or a file of the first schema.
    laws
        Checks of later stages, made only of what the others found right.

    Returns
    -------
    The configuration, and where each key stands, for messages.

    Raises
    ------
    ConfigError
        With every fault: the files, TOML, keys, values alone, values together, laws.
    """
    return _verified(*_folder(path), laws) if path.is_dir() else _one(read_file(path), laws)


def parse(
    text: str, path: Path = Path("<text>"), laws: Sequence[Check] = ()
) -> tuple[Config, Source]:
    """As :func:`load`, from the ``text`` of a file of the first schema."""
    return _one(ConfigFile(path, text), laws)


def read_machine(named: str) -> Machine:
    """The machine of the rig ``named``: a shipped name, or a folder.

    Raises
    ------
    ConfigError
        No such rig, or any fault in it.
    """
    return load(find(named))[0].machine


def read_device(path: Path) -> DeviceConfig:
    """Who the device of ``path`` is, whatever else is wrong with it.

    Raises
    ------
    ConfigError
        No readable TOML, or a fault in the table ``device``.
    """
    file = _part(path, DEVICE) if path.is_dir() else read_file(path)
    source = one_file(file, first=True)
    values, found = convert(upgrade(toml_table(file)))
    faults = [_placed(source, *each) for each in found if each[0].partition(".")[0] == "device"]
    if faults:
        raise ConfigError(faults)
    return msgspec.convert(values["device"], DeviceConfig)


def decode(data: str | bytes, path: Path) -> Config:
    """A configuration as JSON, as a recording carries it; ``path`` is for messages.

    Raises
    ------
    ConfigError
        No JSON, or any fault.
    """
    file = ConfigFile(path, "")
    try:
        table = msgspec.json.decode(data, type=dict[str, Any])
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise file.error(
            "", None, f"no configuration ({error}); name an intact recording"
        ) from error
    table, source = _upgraded(table, file)
    config, faults = verify(table, source)
    if config is None:
        raise ConfigError(faults)
    return config


def verify(
    table: dict[str, Any], source: Source, laws: Sequence[Check] = ()
) -> tuple[Config | None, list[Fault]]:
    """The configuration of ``table``, or all that is wrong with it.

    A check that reads a stand-in of a part that the machine lacks is left out, as one that reads a
    value with a fault is.
    """
    values, found = convert(table)
    lacking = stand_in_keys(table.get("machine"))
    for checks in (RELATED, laws):
        seen = view(values, lacking | {key for key, _, _ in found})
        found = found + [fault for check in checks for fault in _run(check, seen)]
    if found:
        return None, [_placed(source, *each) for each in found]
    return msgspec.convert(values, Config), []


def _run(check: Check, seen: Config) -> list[Found]:
    """What ``check`` finds, as far as what it reads is right."""
    found = []
    try:
        for fault in check(seen):
            found.append(fault)  # noqa: PERF402 -- what came before the end counts
    except FaultedError:
        pass
    return found


def _placed(source: Source, key: str, value: object, cause: str) -> Fault:
    least, greatest = ends_of(key)
    return msgspec.structs.replace(source.fault(key, value, cause), least=least, greatest=greatest)


def _one(file: ConfigFile, laws: Sequence[Check]) -> tuple[Config, Source]:
    return _verified(*_upgraded(toml_table(file), file), laws)


def _verified(
    table: dict[str, Any], source: Source, laws: Sequence[Check]
) -> tuple[Config, Source]:
    config, faults = verify(table, source, laws)
    if config is None:
        raise ConfigError(faults)
    return config, source


def _folder(path: Path) -> tuple[dict[str, Any], Source]:
    """The tables of a rig folder, and where their keys stand; what cannot be read of both files is
    told at once."""
    read: list[tuple[ConfigFile, dict[str, Any]]] = []
    faults: list[Fault] = []
    for name in (MACHINE, DEVICE):
        try:
            file = _part(path, name)
            read.append((file, toml_table(file)))
        except ConfigError as error:
            faults += error.faults
    if faults:
        raise ConfigError(faults)
    (machine_file, machine), (device_file, device) = read
    if "machine" in device:
        cause = f"unknown key; the machine is described in {MACHINE}"
        raise device_file.error("machine", None, cause)
    if "absent" in machine:
        cause = "found by what the file leaves out, never written; remove it"
        raise machine_file.error("absent", machine["absent"], cause)
    device = _with_own_models(folder=path, device=device)
    whole = with_limits({**device, "machine": completed(without_retired(machine))})
    return whole, two_files(path, machine_file, device_file)


def _with_own_models(folder: Path, device: dict[str, Any]) -> dict[str, Any]:
    """``device`` with the models that lie in the rig folder itself, where it names no others."""
    models, own = device.get("models", {}), own_set(folder)
    if not isinstance(models, dict) or models.get("directory") or own is None:
        return device
    return {**device, "models": {**models, "directory": str(own)}}


def _part(folder: Path, name: str) -> ConfigFile:
    """A file of a rig folder; messages call it by both."""
    return read_file(folder / name, f"{folder.resolve().name}/{name}")


def _upgraded(table: dict[str, Any], file: ConfigFile) -> tuple[dict[str, Any], Source]:
    """``table`` in the present schema, and where its keys stand in ``file``."""
    first = is_first(table)
    upgraded = upgrade(table) if first else table
    upgraded = {**upgraded, "machine": without_retired(upgraded.get("machine"))}
    return upgraded, one_file(file, first=first)


def toml_table(source: ConfigFile) -> dict[str, Any]:
    """The tables of the TOML text ``source``.

    Raises
    ------
    ConfigError
        It is no TOML; the text says where.
    """
    try:
        return tomllib.loads(source.text)
    except RecursionError as error:
        raise source.error(
            "", None, "nested deeper than any configuration; take the shipped rig bench as pattern"
        ) from error
    except ValueError as error:  # TOMLDecodeError, or a number of thousands of digits
        cause, _, place = str(error).partition(" (at ")
        found = re.search(r"line (\d+)", place)
        line = int(found.group(1)) if found else len(source.text.splitlines()) if place else 0
        text = source.text.splitlines()[line - 1] if line else ""
        step = _next_step(text)
        raise ConfigError(
            [source.fault("", None, f"not valid TOML: {cause}; {step}", line)]
        ) from error


_DECIMAL_COMMA: Final = re.compile(r"=\s*([+-]?\d+),(\d+)\s*(?:#.*)?$")
_BARE_WORD: Final = re.compile(r"=\s*([A-Za-z_][\w .-]*?)\s*(?:#.*)?$")


def _next_step(line: str) -> str:
    """What to do about a line that is no TOML: the two that people write most have their own."""
    if comma := _DECIMAL_COMMA.search(line):
        return f"decimals stand behind a point: write {comma[1]}.{comma[2]}"
    if word := _BARE_WORD.search(line):
        return f'text stands in quotes: write "{word[1]}"'
    return "correct the line"
