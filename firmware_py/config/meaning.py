"""What a key of the schema means, for people who are to write it."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from msgspec import inspect

from firmware_py.config.convert import not_none
from firmware_py.config.written import toml_value
from firmware_py.machine.texts import head_of, texts_of, unit_of
from firmware_py.machine.values import Section


def meaning(cls: type[Section], field: inspect.Field) -> str:
    """Meaning, source, unit and ends of one key.

    Raises
    ------
    OSError
        The package was installed without its sources, which hold the texts.
    """
    text = texts_of(cls).get(field.name, "")
    kind = not_none(field.type)
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        allowed = f"{kind.ge:g} .. {kind.le:g}"
        unit = unit_of(field.name)
        return f"{text} ({unit}, {allowed})" if unit else f"{text} ({allowed})"
    if isinstance(kind, inspect.LiteralType):
        return f"{text} ({', '.join(map(toml_value, kind.values))})"
    return f"{text} (true, false)" if isinstance(kind, inspect.BoolType) else text


def missing(cls: type[Section], field: inspect.Field, key: str) -> str:
    """Cause and next step where ``key`` is missing: what it is, and how it is written."""
    kind = not_none(field.type)
    table = kind.item_type if isinstance(kind, inspect.ListType) else kind
    if isinstance(table, inspect.StructType):
        head = f"[[{key}]]" if table is not kind else f"[{key}]"
        needed = [each.name for each in table.fields if each.required]
        keys = f" with {', '.join(needed)}" if needed else ""
        text, step = _told(lambda: head_of(cast(type[Section], table.cls))), f"write {head}{keys}"
    else:
        above, _, own = key.rpartition(".")
        under = f" under [{above}]" if above not in ("", "machine") else ""
        text, step = _told(lambda: meaning(cls, field)), f"write {own} = ..{under}"
    return f"missing{text and f' ({text})'}; {step}"


def _told(text: Callable[[], str]) -> str:
    """The first sentence of ``text``; none where the sources are not there."""
    try:
        said = text()
    except OSError:
        return ""
    first, _, rest = said.partition(". ")
    ends = rest[rest.rfind("(") :] if rest.endswith(")") else ""
    return " ".join([first.rstrip("."), ends]).strip().replace(";", ",")
