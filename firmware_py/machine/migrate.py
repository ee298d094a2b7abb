"""From the first schema, one file for machine and device, to a machine of its own.

A file of that schema, and the configuration of a recording made under it, go through
:func:`upgrade`; faults are told in the file's own keys (:func:`first_key`, :func:`in_first_words`).
"""

from __future__ import annotations

import difflib
import re
from typing import Any, Final

from firmware_py.machine.schema import Machine
from firmware_py.machine.values import NAME_PATTERN

_OLD: Final = {"lubricant": "oil"}
"""Tables that were called otherwise."""

MOVED: Final = {_OLD.get(name, name): name for name in Machine.__struct_fields__ if name != "name"}
"""Tables of the first schema that describe the machine, and what they are called in it."""

_NAMES: Final = (
    *MOVED,
    "device",
    "bus",
    "sampling",
    "limits",
    "limits_at",
    "measure",
    "group",
    "multiply",
    "authority",
    "models",
    "drive",
    "zenoh",
    "recorder",
    "metrics",
)
_UNNAMED: Final = "unnamed"
_GUESSED_MAX: Final = 20
"""Unknown tables of which it is guessed what they mean."""

RETIRED: Final = {"bearing": ("cone_half_angle_deg",)}
"""Keys that were once known and moved nothing: in a folder or a recording that still has them they
are left out."""

_KEY: Final = re.compile(rf"\bmachine\.({'|'.join(MOVED.values())})(?=[.\[,\]]|$)")
_LISTED: Final = re.compile(r"\bmachine, ")


def is_first(table: dict[str, Any]) -> bool:
    """Whether ``table`` is of the first schema: the machine stands beside the device."""
    return "machine" not in table


def upgrade(table: dict[str, Any]) -> dict[str, Any]:
    """``table`` of the first schema as :class:`~firmware_py.config.Config` wants it.

    Nothing is judged here: what is wrong in ``table`` is wrong in the result.  The machine is
    called as the rig is.
    """
    device = table.get("device")
    rig = device.get("rig") if isinstance(device, dict) else None
    named = isinstance(rig, str) and re.search(NAME_PATTERN, rig)
    machine: dict[str, Any] = {"name": rig if named else _UNNAMED}
    rest: dict[str, Any] = {}
    unknown = [name for name in table if name not in _NAMES][:_GUESSED_MAX]
    misspelt = {name for name in unknown if _meant(name) in MOVED}
    for name, value in table.items():
        if name in MOVED or name in misspelt:
            machine[MOVED.get(name, name)] = value
        else:
            rest[name] = value
    return {**rest, "machine": machine}


def without_retired(machine: Any) -> Any:
    """The tables of a machine without keys of :data:`RETIRED`."""
    if not isinstance(machine, dict):
        return machine
    return {
        name: {k: v for k, v in table.items() if k not in RETIRED[name]}
        if name in RETIRED and isinstance(table, dict)
        else table
        for name, table in machine.items()
    }


def first_key(key: str) -> str:
    """What the first schema calls ``key`` of the present one."""
    return "" if key == "machine" else in_first_words(key).removeprefix("machine.")


def in_first_words(text: str) -> str:
    """``text`` that names keys of the present schema, in those of the first."""
    text = _KEY.sub(lambda found: _OLD.get(found[1], found[1]), text)
    return _LISTED.sub("".join(f"{name}, " for name in MOVED), text)


def _meant(name: str) -> str:
    """The table of the first schema that a wrong name most resembles; empty when it resembles
    none."""
    near = difflib.get_close_matches(name[:64], _NAMES, 1)
    return near[0] if near else ""
