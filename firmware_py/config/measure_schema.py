"""The tables ``[[measure]]`` and ``[[group]]`` of ``device.toml``: what protection watches, and
how danger votes."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from firmware_py.machine.values import Section

_MEASURE: Final = r"^[A-Za-z0-9_/]{1,48}\Z"
_GROUP: Final = r"^[a-z0-9_]{1,48}\Z"
MEASURE_WORDS: Final = {
    _MEASURE: "one word of at most 48 letters, digits and _",
    _GROUP: "one word of at most 48 small letters, digits and _",
}
"""Each pattern for people."""

MeasureName = Annotated[str, Meta(pattern=_MEASURE)]
GroupName = Annotated[str, Meta(pattern=_GROUP)]

SetPointValue = Annotated[float, Meta(ge=-1e9, le=1e9)]
DelayS = Annotated[float, Meta(ge=0.0, le=60.0)]
HysteresisShare = Annotated[float, Meta(ge=0.0, le=0.5)]

EffectWord = Literal["event", "alarm", "authority", "retreat", "trip"]
VoteWord = Literal["1oo1", "1oo2", "2oo2", "2oo3", "2oo2_strict"]


class MeasureConfig(Section, frozen=True):
    """A measure of the table: what is not written stays as the table ``[limits]`` makes it."""

    name: MeasureName
    """Name of the measure, such as disp_x or oil_pressure_low (`orbitd protection matrix`)."""
    alert: SetPointValue | None = None
    """Alert set point, in the unit of the measure."""
    danger: SetPointValue | None = None
    """Danger set point, in the unit of the measure."""
    alert_delay_s: DelayS | None = None
    """How long the alert set point is passed before it is an alarm."""
    danger_delay_s: DelayS | None = None
    """How long the danger set point is passed before it is an alarm, or votes."""
    hysteresis_share: HysteresisShare | None = None
    """An alarm ends this share of the set point within it."""
    latching: bool | None = None
    """Whether the danger alarm stands until `reset`; one that trips alone always does."""
    alert_effect: EffectWord | None = None
    """What alert does: event, alarm, authority, retreat."""
    danger_effect: EffectWord | None = None
    """What danger does: event, alarm, authority, retreat or trip; each does what those before it
    do."""


class GroupConfig(Section, frozen=True):
    """Measures that vote together: their danger trips as the vote says."""

    name: GroupName
    """Name of the group; its trip is the alarm NAME_trip."""
    measures: list[MeasureName]
    """Names of the measures that vote; the danger of each takes authority at once."""
    vote: VoteWord
    """How many of how many must be in danger; one that is not OK leaves the vote (2oo2 becomes
    1oo1), in 2oo2_strict it does not."""
    all_not_ok: Literal["alarm", "authority", "retreat", "trip"] = "authority"
    """What is done while every measure of the group is not OK."""
