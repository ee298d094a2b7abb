"""From the tables of a file to typed sections, with every fault on the way, and a view of what is
left of them."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, cast

import msgspec
from msgspec import inspect

from firmware_py.config.schema import WORDS, Config
from firmware_py.machine.texts import unit_of
from firmware_py.machine.values import Section

Found = tuple[str, object, str]
"""A fault: key, value, and the cause with its limit; after the last semicolon the next step."""

ROWS_MAX: Final = 64
UNKNOWN_MAX: Final = 20
"""Tables in a list, and unknown keys of one table that are named one by one."""


class FaultedError(Exception):
    """A check asked for a value that has a fault of its own; the check is left out."""


def convert(
    table: dict[str, Any], cls: type[Section] = Config
) -> tuple[dict[str, Any], list[Found]]:
    """Every key of ``table`` as ``cls`` wants it, and every fault of one alone.

    Returns
    -------
    Values by section and key, without those that are missing or wrong, and what is wrong with
    these.
    """
    faults: list[Found] = []
    return _section(cls, table, "", faults), faults


# ---------------------------------------------------------------------- one value after the other


@dataclass(frozen=True)
class _Key:
    """A key of the schema."""

    kind: inspect.Type
    field: inspect.Field

    @property
    def required(self) -> bool:
        """Whether it has no default."""
        return self.field.required

    def default(self) -> Any:
        """Its default; of a section its table of no keys."""
        factory: Any = self.field.default_factory
        made = factory() if self.field.default is msgspec.NODEFAULT else self.field.default
        return {} if isinstance(made, Section) else made


_HOLE: Final = object()
"""In the place of a value that is wrong."""


@cache
def _keys(cls: type[Section]) -> Mapping[str, _Key]:
    described = cast(inspect.StructType, inspect.type_info(cls))
    return {each.name: _Key(not_none(each.type), each) for each in described.fields}


def not_none(kind: inspect.Type) -> inspect.Type:
    """What may be written in TOML, which has no None."""
    if isinstance(kind, inspect.UnionType):
        return next(each for each in kind.types if not isinstance(each, inspect.NoneType))
    return kind


def _section(
    cls: type[Section], table: dict[str, Any], prefix: str, faults: list[Found]
) -> dict[str, Any]:
    """The values of one table that are good."""
    known = _keys(cls)
    unknown = [name for name in table if name not in known]
    meant: list[str] = []
    for name in unknown[:UNKNOWN_MAX]:
        near = difflib.get_close_matches(name[:64], sorted(known.keys() - table.keys()), 1)
        meant += near
        step = f"write {near[0]}" if near else f"remove it, known are {', '.join(known)}"
        faults.append((prefix + name, table[name], f"unknown key; {step}"))
    if len(unknown) > UNKNOWN_MAX:
        faults.append((prefix.rstrip("."), None, f"{len(unknown)} unknown keys; remove them"))
    values: dict[str, Any] = {}
    for name, key in known.items():
        if name in table and not (table[name] is None and key.field.default is None):
            value = _value(key.kind, table[name], prefix + name, faults)
            if value is not _HOLE:
                values[name] = value
        elif key.required and name not in meant:
            from firmware_py.config.meaning import missing  # texts: only where there is a fault

            faults.append((prefix + name, None, missing(cls, key.field, prefix + name)))
    return values


def _value(kind: inspect.Type, value: Any, key: str, faults: list[Found]) -> Any:
    """``value`` as ``kind``, or a hole and its faults; of a table that what is good in it."""
    if isinstance(kind, inspect.StructType):
        if isinstance(value, dict):
            return _section(cast(type[Section], kind.cls), value, f"{key}.", faults)
        cause = f"{_said(value)}, not a table; write [{key}] and its keys below"
    elif isinstance(kind, inspect.ListType | inspect.VarTupleType):
        if isinstance(value, list | tuple) and not (cause := _wrong_length(kind, len(value))):
            rows = [
                _value(kind.item_type, each, f"{key}[{i}]", faults) for i, each in enumerate(value)
            ]
            made = tuple(rows) if isinstance(kind, inspect.VarTupleType) else rows
            return _HOLE if _HOLE in rows else made
        if not isinstance(value, list | tuple):
            cause = f"{_said(value)}, not a list; write it in brackets"
    elif isinstance(kind, inspect.IntType | inspect.FloatType):
        cause = _wrong_number(kind, value)
        if cause and (meant := _in_other_unit(key, kind, value)):
            cause = f"{cause.rpartition('; ')[0]}; {meant}"
    else:
        cause = _wrong_other(kind, value)
    if cause:
        faults.append((key, value, cause))
        return _HOLE
    return float(value) if isinstance(kind, inspect.FloatType) else value


def _wrong_length(kind: inspect.ListType | inspect.VarTupleType, entries: int) -> str:
    least, most = kind.min_length or 0, kind.max_length or ROWS_MAX
    if entries > most:
        return f"{entries} entries, at most {most}; shorten it"
    return f"{entries} entries, at least {least}; add the others" if entries < least else ""


def _wrong_number(kind: inspect.IntType | inspect.FloatType, value: object) -> str:
    least, greatest = _ends(kind)
    allowed = f"{least:g} .. {greatest:g}"
    if isinstance(kind, inspect.IntType) and (
        isinstance(value, bool) or not isinstance(value, int)
    ):
        return f"{_said(value)}, not a whole number; write one of {allowed}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"{_said(value)}, not a number; write one of {allowed}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"not finite, allowed are {allowed}; give a number"
    if value < least:
        return f"below the least, {least:g} (allowed {allowed}); raise it"
    if value > greatest:
        return f"above the greatest, {greatest:g} (allowed {allowed}); lower it"
    return ""


_OTHER_UNITS: Final = {
    "_m": (("millimetres", 1e-3), ("micrometres", 1e-6)),
    "_um": (("metres", 1e6), ("millimetres", 1e3)),
    "_Pa_s": (("mPa s (centipoise)", 1e-3),),
    "_rpm": (("turns a second", 60.0),),
    "_bar": (("pascals", 1e-5), ("kilopascals", 1e-2)),
    "_mm2": (("square metres", 1e6),),
}
"""By the end of a key's name: a unit that people take for its own, and how many of its own
it is."""

HINTED_MAX: Final = 1e12
"""No figure of a machine is larger in any unit; a whole number of TOML may be."""

_NO_UNIT_OF_ITS_OWN: Final = ("_N_m", "_kg_m", "_N_s_m", "_ohm_per_m")
"""Ends of names whose last part is a divisor, or one factor of several."""


def _in_other_unit(key: str, kind: inspect.IntType | inspect.FloatType, value: object) -> str:
    """What to write if a value outside its ends is inside them in a unit often taken for its own;
    else empty."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    if not abs(value) <= HINTED_MAX or key.endswith(_NO_UNIT_OF_ITS_OWN):
        return ""
    least, greatest = _ends(kind)
    for end, units in _OTHER_UNITS.items():
        for unit, each in units if key.endswith(end) else ():
            meant = float(f"{value * each:.12g}")
            if value and least <= meant <= greatest:
                return f"if these are {unit}, write {meant:g}: the key's unit is {unit_of(key)}"
    return ""


def _wrong_other(kind: inspect.Type, value: object) -> str:
    if isinstance(kind, inspect.LiteralType):
        return (
            ""
            if any(type(value) is type(each) and value == each for each in kind.values)
            else f"unknown; write one of {', '.join(map(str, kind.values))}"
        )
    if isinstance(kind, inspect.BoolType):
        return (
            ""
            if isinstance(value, bool)
            else f"{_said(value)}, not true or false; write one, without quotes"
        )
    if not isinstance(value, str):
        return f"{_said(value)}, not text; write it in quotes"
    pattern = cast(inspect.StrType, kind).pattern or ""
    return "" if re.search(pattern, value) else f"not {WORDS[pattern]}; correct it"


def _ends(kind: inspect.IntType | inspect.FloatType) -> tuple[float, float]:
    """Least and greatest value; a test holds that every number of the schema has both, and no
    ``gt`` or ``lt``."""
    return cast(tuple[float, float], (kind.ge, kind.le))


def _said(value: object) -> str:
    """What a TOML value is, in a word."""
    for kinds, word in _WORDS:
        if isinstance(value, kinds):
            return word
    return f"a {type(value).__name__}"  # a date or a time


_WORDS: Final[tuple[tuple[type, str], ...]] = (
    (bool, "true or false"),
    (int, "a whole number"),
    (float, "a number"),
    (str, "text"),
    (list, "a list"),
    (dict, "a table"),
)


def ends_of(key: str) -> tuple[float | None, float | None]:
    """The least and greatest value that the schema gives ``key``; None where it is no number."""
    kind: inspect.Type = inspect.StructType(Config, ())
    for part in re.split(r"\[\d+\]\.?|\.", key):
        if isinstance(kind, inspect.ListType):
            kind = kind.item_type
        if part and isinstance(kind, inspect.StructType):
            kind = (
                _keys(cast(type[Section], kind.cls))[part].kind
                if part in _keys(kind.cls)
                else inspect.AnyType()
            )
    return _ends(kind) if isinstance(kind, inspect.IntType | inspect.FloatType) else (None, None)


# ---------------------------------------------------------------------- a configuration with holes


class _View:
    """A section of which some values are missing or wrong; reads like the real one."""

    def __init__(
        self, cls: type[Section], values: Mapping[str, Any], prefix: str, holes: frozenset[str]
    ) -> None:
        self.__dict__["_parts"] = (cls, values, prefix, holes)

    def __getattr__(self, name: str) -> Any:
        cls, values, prefix, holes = self.__dict__["_parts"]
        key = _keys(cls).get(name)
        if key is None:
            return cast(Any, getattr(cls, name)).fget(self)  # a property
        dotted = prefix + name
        missing = name not in values and (
            key.required or any(hole.startswith(f"{dotted}[") for hole in holes)
        )
        if missing or dotted in holes or prefix[:-1] in holes:
            raise FaultedError(dotted)
        return _seen(key.kind, values[name] if name in values else key.default(), dotted, holes)


def _seen(kind: inspect.Type, value: Any, dotted: str, holes: frozenset[str]) -> Any:
    if isinstance(value, dict):
        return _View(
            cast(type[Section], cast(inspect.StructType, kind).cls), value, f"{dotted}.", holes
        )
    if isinstance(value, list):
        inner = cast(inspect.ListType, kind).item_type
        return [_seen(inner, each, f"{dotted}[{i}]", holes) for i, each in enumerate(value)]
    return value


def view(values: Mapping[str, Any], holes: frozenset[str]) -> Config:
    """``values`` to be read like a configuration; reading one of ``holes`` raises
    :class:`FaultedError`."""
    return cast(Config, _View(Config, values, "", holes))
