"""A rig folder to be edited: every key with what it means, its unit, its ends and its source.

The remarks are the texts of the schema (:mod:`firmware_py.machine.texts`); nothing is said twice.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, Final, cast

import msgspec
from msgspec import inspect

from firmware_py.config.convert import not_none
from firmware_py.config.limits import with_limits
from firmware_py.config.meaning import meaning
from firmware_py.config.schema import Config
from firmware_py.config.written import toml_value
from firmware_py.machine import Machine
from firmware_py.machine.folder import DEVICE, MACHINE, SIMULATION
from firmware_py.machine.parts import stand_ins
from firmware_py.machine.simulation import Simulation
from firmware_py.machine.texts import head_of
from firmware_py.machine.values import MachineTable, Section

COLUMNS: Final = 98
_EDITED: Final = "`orbitd check FOLDER` names what is wrong, `orbitd rig show FOLDER` what follows."
_HEADS: Final[Mapping[str, str]] = {
    MACHINE: "What the machine `{name}` is. The figures are those of `{source}` until you change "
    "them; those behind a # may be left out. In any table `measured = [..]` names the keys that "
    "were measured on this very machine, `assumed = [..]` those that nobody drew or measured. "
    "Behind each text stand unit, least and greatest value. " + _EDITED,
    DEVICE: "How the device runs on the rig `{name}`. A key behind a # has its default. " + _EDITED,
    SIMULATION: "What only a simulator needs of the rig `{name}`; none of it is needed to watch a "
    "machine. A key behind a # has its default.",
}


def commented(config: Config, simulation: Simulation | None, source: str) -> dict[str, str]:
    """The text of each file of the rig folder of ``config`` and ``simulation``.

    Parameters
    ----------
    config, simulation
        The values; they stand in the files as they are, and what the machine lacks behind a #.
        None: a machine that is not simulated.
    source
        For people: the rig from which the figures come.
    """
    name, device = config.machine.name, msgspec.structs.asdict(config)
    del device["machine"]
    machine = msgspec.structs.asdict(config.machine)
    del machine["name"], machine["absent"]
    absent = stand_ins(config.machine)
    tables = {
        MACHINE: ["", f"name = {toml_value(name)}", *_tables(Machine, machine, True, absent)],
        DEVICE: _tables(Config, device, False, _limits_off(config)),
    }
    if simulation is not None:
        tables[SIMULATION] = _tables(Simulation, msgspec.structs.asdict(simulation), False)
    return {
        file: "\n".join([*_remark(_HEADS[file].format(name=name, source=source)), *rows]) + "\n"
        for file, rows in tables.items()
    }


def _limits_off(config: Config) -> frozenset[str]:
    """Limits that are stand-ins of what the machine lacks."""
    machine = msgspec.to_builtins(config.machine)
    limits = with_limits({"limits": {}, "machine": machine})["limits"]
    return frozenset(
        f"limits.{key}" for key, value in limits.items() if getattr(config.limits, key) == value
    )


def _tables(
    cls: type[Section],
    values: Mapping[str, Any],
    whole: bool,
    absent: frozenset[str] = frozenset(),
    above: str = "",
) -> Iterator[str]:
    """Every table of ``cls``; ``whole``: keys that have their default are written as well, and
    ``absent`` are those that are not there."""
    for field in cast(inspect.StructType, inspect.type_info(cls)).fields:
        if field.name not in values:
            continue
        value, kind = values[field.name], not_none(field.type)
        name = f"{above}{field.name}"
        if isinstance(kind, inspect.ListType):
            kind = kind.item_type
            if not isinstance(kind, inspect.StructType):
                continue
            inner = cast(type[Section], kind.cls)
            for number, each in enumerate(value or [None]):
                lacks = _keys_of(absent, f"{name}[{number}]")
                yield from _table(inner, f"[[{name}]]", each, whole, lacks, first=not number)
        elif isinstance(kind, inspect.StructType):
            inner = cast(type[Section], kind.cls)
            there = None if name in absent else value
            yield from _table(inner, f"[{name}]", there, whole, _keys_of(absent, name), first=True)
            if isinstance(value, Section):
                yield from _tables(inner, msgspec.structs.asdict(value), whole, absent, f"{name}.")


def _keys_of(absent: frozenset[str], table: str) -> frozenset[str]:
    """Keys of ``table`` that are absent."""
    return frozenset(key.rpartition(".")[2] for key in absent if key.startswith(f"{table}."))


def _table(
    cls: type[Section],
    head: str,
    values: Section | None,
    whole: bool,
    absent: frozenset[str],
    *,
    first: bool,
) -> Iterator[str]:
    """One table; of a list the first has the remarks, and the others what is not at its default."""
    yield ""
    if first:
        yield from _remark(head_of(cls))
    yield head if values is not None else f"# {head}"
    for field in cast(inspect.StructType, inspect.type_info(cls)).fields:
        there = values is not None and field.name not in absent
        value = getattr(values, field.name) if there else _default(field)
        if _is_table(field.type) or (field.name in MachineTable.__struct_fields__ and not value):
            continue
        usual = value is None or (not field.required and value == _default(field))
        if first:
            yield from _remark(meaning(cls, field))
        elif usual:
            continue
        row = f"{field.name} = {'?' if value is None else toml_value(value)}"
        hidden = values is None or value is None or (usual and not whole)
        yield f"# {row}" if hidden else row


def _default(field: inspect.Field) -> Any:
    if field.default is not msgspec.NODEFAULT:
        return field.default
    made: Any = field.default_factory
    return None if made is msgspec.NODEFAULT else made()


def _is_table(kind: inspect.Type) -> bool:
    kind = not_none(kind)
    return isinstance(kind, inspect.StructType) or (
        isinstance(kind, inspect.ListType) and isinstance(kind.item_type, inspect.StructType)
    )


def _remark(text: str) -> list[str]:
    return [f"# {row}" for row in textwrap.wrap(text, COLUMNS - 2, break_long_words=False)]
