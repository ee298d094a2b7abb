"""What the tables of a rig folder are made of: names, texts and numbers, each within its limits.

Every number has a least and a greatest value.  They are the ends of what any machine of this kind
has, not what one machine should have: relations between values are in
:mod:`firmware_py.config.checks`.
"""

from __future__ import annotations

from typing import Annotated, Final

import msgspec
from msgspec import Meta

NAME_PATTERN: Final = r"^[a-z0-9][a-z0-9_-]{0,31}\Z"
_WORD: Final = r"^[A-Za-z0-9_/]{1,32}\Z"
_OPTIONAL_WORD: Final = r"^[a-z0-9_]{0,32}\Z"
_LABEL: Final = r"^[\x20-\x21\x23-\x5b\x5d-\x7e]{0,80}\Z"
_PART: Final = r"^[A-Za-z0-9_/]{1,64}\Z"
_FILE: Final = r"^([A-Za-z0-9_][A-Za-z0-9_.-]{0,59}\.dbc)?\Z"
_SIGNAL: Final = r"^[A-Za-z_][A-Za-z0-9_]{0,127}\.[A-Za-z_][A-Za-z0-9_]{0,127}\Z"
WORDS: Final = {
    NAME_PATTERN: "a name of 1 to 32 small letters, digits, - and _, the first no sign",
    _WORD: "one word",
    _OPTIONAL_WORD: "one word of small letters, or empty",
    _LABEL: "at most 80 printable ASCII characters without quote and backslash",
    _PART: "a part, or a part and a bearing",
    _FILE: "the name of a DBC file beside this one, e.g. plant.dbc",
    _SIGNAL: "MESSAGE.SIGNAL of the DBC",
}
"""Each pattern for people."""

PartName = Annotated[str, Meta(pattern=_PART)]
DbcFile = Annotated[str, Meta(pattern=_FILE)]
SignalName = Annotated[str, Meta(pattern=_SIGNAL)]
Name = Annotated[str, Meta(pattern=NAME_PATTERN)]
Word = Annotated[str, Meta(pattern=_WORD)]
OptionalWord = Annotated[str, Meta(pattern=_OPTIONAL_WORD)]
Label = Annotated[str, Meta(pattern=_LABEL)]

ClearanceUm = Annotated[float, Meta(ge=5.0, le=600.0)]
"""Below 5 um roughness and runout are as large as the film; the wire carries up to 655.35 um."""
PressureBar = Annotated[float, Meta(ge=0.0, le=60.0)]
"""The wire carries up to 65.535 bar."""
TemperatureC = Annotated[float, Meta(ge=-40.0, le=200.0)]
"""The range of the viscosity table; beyond it oil is solid or burns."""
SpeedRpm = Annotated[float, Meta(ge=60.0, le=60_000.0)]
"""Below 60 rpm one turn takes over a second: no protection by turns.  Film bearings end below 60
000 rpm."""
BearingMassKg = Annotated[float, Meta(ge=0.001, le=1e5)]
LoadN = Annotated[float, Meta(ge=0.1, le=1e6)]
Share = Annotated[float, Meta(ge=0.0, le=0.9)]
"""An uncertainty; at 1 nothing would be known."""
AnySI = Annotated[float, Meta(ge=-1e5, le=1e5)]
"""A value of any fast channel in SI."""
ReadingValue = Annotated[float, Meta(ge=-1e9, le=1e9)]
"""A value of any slow reading in the unit of its kind."""
AngleDeg = Annotated[float, Meta(ge=-360.0, le=360.0)]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every table of a rig folder."""


class MachineTable(Section, frozen=True, kw_only=True):
    """A table of figures, each of the drawing unless it is named here."""

    assumed: tuple[Word, ...] = ()
    """Keys of this table that nobody drew or measured."""
    measured: tuple[Word, ...] = ()
    """Keys that hold what was measured on this very machine."""
