"""The channel map: what a person says of files that do not tell everything themselves.

A small TOML file, ``channels.toml`` beside the recordings or named by ``--channels``; every table
and key may be left out::

    [file]
    rate_hz = 25600          # where the files do not tell it
    resample_hz = 5000       # all channels of all recordings are brought to this rate
    separator = ";"          # text files: found by itself where this is left out
    decimal = ","

    [time]
    column = "Zeit"          # stamps that tell the rate; a name, or a number counted from 1
    unit = "ms"

    [speed]                  # one of the two, or [mark]; orders need it
    column = "Drehzahl"
    unit = "rpm"
    rpm = 2990               # the same speed all the time

    [mark]
    column = "tacho"         # pulses of a mark on the shaft
    edge = "rising"
    per_turn = 1
    level = 2.5              # middle of the pulse where this is left out

    [[channel]]              # without any: all columns but those above, as they are named
    column = "AI0"
    name = "acc_bearing_vertical"
    unit = "g"               # unit of column * scale + offset
    scale = 10.0             # e.g. 1 / (0.1 V/g)
    offset = 0.0
    polarity = 1             # -1 where the sensor points the other way
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from models.readers.signal_file import Channel, SignalFileError

FILE_NAME: Final = "channels.toml"

Rate = Annotated[float, Meta(gt=0.0)]
Column = str | int


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of the tables: unknown keys are refused."""


class FileRules(Table, frozen=True):
    """How files are read."""

    rate_hz: Rate | None = None
    resample_hz: Rate | None = None
    separator: Literal["", ";", ",", "\t", "|", " "] = ""
    decimal: Literal["", ".", ","] = ""


class TimeColumn(Table, frozen=True):
    """Which column holds time stamps."""

    column: Column = ""
    unit: str = ""


class Speed(Table, frozen=True):
    """Where the shaft's speed stands."""

    column: Column = ""
    unit: str = ""
    rpm: Rate | None = None


class Mark(Table, frozen=True):
    """Which column holds the pulses of a mark on the shaft."""

    column: Column = ""
    edge: Literal["rising", "falling"] = "rising"
    per_turn: Annotated[int, Meta(ge=1, le=10_000)] = 1
    level: float | None = None


class ChannelRow(Table, frozen=True):
    """One channel: ``(column * scale + offset) * polarity`` in ``unit``."""

    column: Column
    name: str = ""
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    polarity: Literal[1, -1] = 1


class FileMap(Table, frozen=True):
    """The whole map; ``source`` is where it was read, for messages."""

    file: FileRules = FileRules()
    time: TimeColumn = TimeColumn()
    speed: Speed = Speed()
    mark: Mark = Mark()
    channel: tuple[ChannelRow, ...] = ()
    source: str = FILE_NAME


def read_map(path: Path) -> FileMap:
    """The map at ``path``.

    Raises
    ------
    SignalFileError
        It cannot be read, or something in it is wrong: with line or key, and what is known.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise SignalFileError(f"{path}: cannot be read ({error}); give a TOML file") from error
    except tomllib.TOMLDecodeError as error:
        raise SignalFileError(f"{path}: {error}; correct it there") from error
    try:
        found = msgspec.convert({**tables, "source": path.name}, FileMap)
    except msgspec.ValidationError as error:
        known = ", ".join(
            f"{name}: {', '.join(kind.__struct_fields__)}"
            for name, kind in (
                ("file", FileRules), ("time", TimeColumn), ("speed", Speed), ("mark", Mark),
                ("channel", ChannelRow),
            )
        )  # fmt: skip
        raise SignalFileError(f"{path}: {error}; known keys are {known}") from error
    names = [row.name or str(row.column) for row in found.channel]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise SignalFileError(
            f"{path}: two channels are named {twice[0]!r}; give each its own name"
        )
    return found


def find(channels: Sequence[Channel], column: Column, place: str) -> int:
    """Index of ``column`` among ``channels``: by name, by name whatever its case, or by number.

    Raises
    ------
    SignalFileError
        There is none, or several; with the names that there are.
    """
    names = [channel.name for channel in channels]
    if isinstance(column, int):
        if 1 <= column <= len(names):
            return column - 1
        raise SignalFileError(f"{place}: column {column} of {len(names)} ({_list(names)})")
    if names.count(column) == 1:
        return names.index(column)
    plain = [name.casefold().strip() for name in names]
    wanted = column.casefold().strip()
    if plain.count(wanted) == 1:
        return plain.index(wanted)
    if wanted in plain:
        raise SignalFileError(
            f"{place}: {plain.count(wanted)} columns are named {column!r}; give the number of one"
        )
    near = difflib.get_close_matches(wanted, plain, 1)
    hint = f"; did you mean {names[plain.index(near[0])]!r}?" if near else ""
    raise SignalFileError(f"{place}: no column {column!r}, there are {_list(names)}{hint}")


def _list(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:12])
    return f"{shown} and {len(names) - 12} more" if len(names) > 12 else shown
