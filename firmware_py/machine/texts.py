"""What each key of a rig folder means, from the one place where it is declared: the text below it
in its class, and the unit in its name.

Python forgets the text below an attribute; it is read from the source, as documentation tools do.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Mapping
from functools import cache
from typing import Final

from firmware_py.machine.values import Section

UNITS: Final[Mapping[str, str]] = {
    "J_kgK": "J/(kg K)", "N_s_m": "N s/m", "kg_m2": "kg m2", "kg_m3": "kg/m3", "rpm_s": "rpm/s",
    "rad_s2": "rad/s2", "m3_s": "m3/s", "m_s2": "m/s2", "ohm_per_m": "ohm/m", "per_K": "1/K",
    "kg_m": "kg m", "W_s3": "W s3", "J_K": "J/K", "W_K": "W/K", "N_m": "N/m", "N_s": "N/s",
    "C_s": "K/s", "Pa_s": "Pa s", "um_s": "um/s", "rad_s": "rad/s", "megabytes": "MB",
    "bitrate": "bit/s", "baud": "bit/s", "share": "share of 1", "mm2": "mm2", "bar": "bar",
    "mm3": "mm3", "deg": "deg", "rpm": "rpm", "ohm": "ohm", "um": "um", "kg": "kg", "ms": "ms",
    "hz": "Hz", "mm": "mm", "seconds": "s", "m": "m", "N": "N", "W": "W", "C": "degC", "V": "V",
    "s": "s", "G": "mm/s",
}  # fmt: skip
"""Unit by the end of a key's name, longest first."""


def unit_of(key: str) -> str:
    """Unit that the name of ``key`` ends with; empty for a number without one."""
    return next((unit for end, unit in UNITS.items() if key == end or key.endswith(f"_{end}")), "")


@cache
def texts_of(cls: type[Section]) -> Mapping[str, str]:
    """The text of each key of ``cls``, one line each; those of its base classes as well.

    Raises
    ------
    OSError
        The package was installed without its sources.
    """
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if issubclass(base, Section):
            found |= _own(base)
    return found


def head_of(cls: type[Section]) -> str:
    """What the table ``cls`` is, for people: its docstring without the marks of code."""
    return _plain(cls.__doc__ or "")


def _own(cls: type[Section]) -> dict[str, str]:
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(body, ast.ClassDef)
    pairs = zip(body.body, body.body[1:], strict=False)
    return {
        key.target.id: _plain(text.value.value)
        for key, text in pairs
        if isinstance(key, ast.AnnAssign)
        and isinstance(key.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def _plain(text: str) -> str:
    """One line without the marks of code and the references of a docstring."""
    text = re.sub(r"\s*\(:\w+:`[^`]*`\)|:\w+:`~?([^`]*)`", r"\1", text)
    return re.sub(r"\s+", " ", text.replace("``", "")).strip()
