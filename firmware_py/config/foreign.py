"""Foreign buses: which signal of a DBC is which channel or reading, in which unit.

cantools reads the DBC: scale, offset, byte order and multiplexing are its matter.  All that does
not fit (no such file, message or signal; a unit that is none of the kind; a channel that nothing
gives) is told at once by :func:`faults`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cantools.database

from firmware_py import signals
from firmware_py.config.convert import Found
from firmware_py.config.instances import slow_signals
from firmware_py.config.schema import Config

EXTENDED_ID: Final = 1 << 31
"""Set in ``RawFrame.frame_id`` of a 29-bit identifier."""

MARK, TURNS, MARK_AGE, COUNTER = "mark", "turns", "mark_age", "counter"
MARKS: Final = (MARK, TURNS)
TIMES_S: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6}

UNITS: Final[dict[str, dict[str, float]]] = {
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "mil": 25.4e-6},
    "m/s2": {"m/s2": 1.0, "m/s^2": 1.0, "m/s²": 1.0, "g": 9.80665},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3},
    "Pa": {"Pa": 1.0},
    "bar": {"bar": 1.0, "mbar": 1e-3, "kPa": 0.01, "MPa": 10.0, "psi": 0.0689476},
    "V": {"V": 1.0, "mV": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "N": {"N": 1.0, "kN": 1e3},
    "Nm": {"Nm": 1.0},
    "degC": {"degC": 1.0, "°C": 1.0, "C": 1.0},
    "L/min": {"L/min": 1.0, "l/min": 1.0},
    "W": {"W": 1.0, "kW": 1e3},
    "um": {"um": 1.0, "µm": 1.0, "mm": 1e3},
    "rpm": {"rpm": 1.0, "1/min": 1.0, "Hz": 60.0},
    "mm/s": {"mm/s": 1.0},
    "%": {"%": 1.0},
}
"""Units that a DBC may give for each unit of a kind, and how many of the kind's one of them is."""


@dataclass(frozen=True)
class Mapped:
    """One signal: what it is, and its value in the unit of its kind over that of the DBC."""

    signal: str
    to: str
    factor: float
    instant: int = 0
    every_us: int = 0


@dataclass(frozen=True)
class MappedMessage:
    """One message of the foreign bus, and what it is decoded by."""

    message: Any
    fast: tuple[Mapped, ...]
    slow: tuple[Mapped, ...]
    marks: tuple[Mapped, ...]

    def decode(self, data: bytes) -> dict[str, float] | None:
        """Physical values by signal; None where the payload is none of this message."""
        try:
            found: dict[str, float] = self.message.decode(data, decode_choices=False)
        except (ValueError, KeyError, cantools.database.DecodeError):
            return None
        return found


@dataclass(frozen=True)
class ForeignMap:
    """Every mapped message by its identifier."""

    messages: dict[int, MappedMessage] = field(default_factory=dict)


def faults(config: Config, folder: Path) -> Iterator[Found]:
    """All that is wrong with the map of a foreign bus, and with its DBC in ``folder``."""
    machine = config.machine
    if machine.foreign is None:
        if machine.map:
            yield "machine.map", None, "there is no [foreign] bus to map; name its DBC there"
        return
    if config.bus.schema != 2:
        cause = "a foreign bus is mapped onto the rig's own channels; set bus.schema = 2"
        yield "bus.schema", config.bus.schema, cause
    if config.bus.link != "can":
        cause = 'a foreign bus is a CAN bus with a DBC; set bus.link = "can"'
        yield "bus.link", config.bus.link, cause
    yield from _targets(config)
    database = _database(folder / machine.foreign.dbc)
    if isinstance(database, str):
        yield "machine.foreign.dbc", machine.foreign.dbc, database
        return
    for i, row in enumerate(machine.map):
        yield from _signal(config, database, i, row.signal, row.to)


def mapped(config: Config, folder: Path) -> ForeignMap:
    """The map of a configuration without :func:`faults`."""
    assert config.machine.foreign is not None
    database = _database(folder / config.machine.foreign.dbc)
    assert not isinstance(database, str), database
    rows: dict[str, list[Mapped]] = {}
    for row in config.machine.map:
        name, _, signal = row.signal.partition(".")
        unit = row.unit or _unit_of(database, row.signal)
        factor = 1.0 if row.to in (MARK, TURNS, COUNTER) else _units(config, row.to)[unit]
        rows.setdefault(name, []).append(
            Mapped(signal, row.to, factor * row.polarity, row.instant, row.every_ms * 1000)
        )
    fast = {channel.name for channel in config.machine.channel}
    slow = {row.name for row in slow_signals(config)}
    found = {}
    for name, own in rows.items():
        message = database.get_message_by_name(name)
        frame_id = message.frame_id | (EXTENDED_ID if message.is_extended_frame else 0)
        found[frame_id] = MappedMessage(
            message,
            tuple(m for m in own if m.to in fast),
            tuple(m for m in own if m.to in slow),
            tuple(m for m in own if m.to not in fast | slow),
        )
    return ForeignMap(found)


def read_dbc(path: Path) -> str:
    """The text of a DBC: UTF-8, else that of Windows, in which most are written.

    Raises
    ------
    OSError
        It cannot be read.
    """
    data = path.read_bytes()
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _database(path: Path) -> Any:
    """The DBC at ``path``, or why it cannot be read."""
    try:
        return cantools.database.load_string(read_dbc(path), "dbc", strict=False)
    except OSError as error:
        return f"{error.strerror} in the rig folder; copy the DBC into it"
    except (ValueError, cantools.database.Error) as error:
        return f"no DBC ({str(error).splitlines()[0][:120]}); export it again"


def _unit_of(database: Any, dotted: str) -> str:
    name, _, signal = dotted.partition(".")
    return str(database.get_message_by_name(name).get_signal_by_name(signal).unit or "")


def _units(config: Config, to: str) -> dict[str, float]:
    """Units that the target ``to`` may have; empty: there is no such target."""
    if to == MARK_AGE:
        return TIMES_S
    for channel in config.machine.channel:
        kind = signals.fast_kind(channel.name, channel.kind)
        if channel.name == to and kind is not None:
            return UNITS[kind.unit]
    return next((UNITS[row.kind.unit] for row in slow_signals(config) if row.name == to), {})


def _targets(config: Config) -> Iterator[Found]:
    """Every channel and reading is given, once; so is the mark."""
    machine, to = config.machine, [(row.to, row.instant) for row in config.machine.map]
    names = [name for name, _ in to]
    fast = [channel.name for channel in machine.channel]
    known = {*fast, *(row.name for row in slow_signals(config)), *MARKS, MARK_AGE, COUNTER}
    for i, row in enumerate(machine.map):
        if row.to not in known:
            cause = f"none of {', '.join(sorted(known))}; correct it"
            yield f"machine.map[{i}].to", row.to, cause
        elif row.to != COUNTER and (row.to, row.instant) in to[:i]:
            yield f"machine.map[{i}].to", row.to, "mapped twice; remove one, or number instant"
    for name in known - {*MARKS, MARK_AGE, COUNTER} - set(names):
        yield "machine.map", None, f"nothing gives {name}; map a signal to it, or leave it out"
    if not set(MARKS) & set(names):
        cause = f"nothing gives the once-per-turn mark; map a signal to {' or '.join(MARKS)}"
        yield "machine.map", None, cause
    counts = {name: sorted(k for n, k in to if n == name) for name in fast if name in names}
    samples = len(next(iter(counts.values()), ()))
    for name, instants in counts.items():
        if instants != list(range(samples)):
            cause = f"instants {instants} of {name}, those of the first channel are 0 to "
            cause += f"{samples - 1}; every channel has the same, correct them"
            yield "machine.map", None, cause


def _signal(config: Config, database: Any, i: int, dotted: str, to: str) -> Iterator[Found]:
    """A signal that the DBC has, in a unit of the target's kind."""
    name, _, signal = dotted.partition(".")
    place, row = f"machine.map[{i}]", config.machine.map[i]
    messages = {message.name: message for message in database.messages}
    if name not in messages:
        cause = f"no message {name} in the DBC, it has {_some(messages)}; correct it"
        yield f"{place}.signal", dotted, cause
        return
    there = {each.name: each for each in messages[name].signals}
    if signal not in there:
        cause = f"no signal {signal} in {name}, it has {_some(there)}; correct it"
        yield f"{place}.signal", dotted, cause
        return
    unit, units = row.unit or str(there[signal].unit or ""), _units(config, to)
    if units and unit not in units:
        said = f"unit {unit!r}" if unit else "no unit in the DBC"
        cause = f"{said}, {to} takes one of {', '.join(units)}; set unit, or map another signal"
        yield f"{place}.unit", row.unit or '""', cause


def _some(names: dict[str, Any]) -> str:
    return ", ".join(sorted(names)[:8]) + (", .." if len(names) > 8 else "")
