"""The tables ``[[measure]]`` and ``[[group]]`` of ``device.toml``: what protection watches, and
how danger votes."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from firmware_py.machine.values import Section

_MEASURE: Final = r"^[A-Za-z0-9_/]{1,48}\Z"
_GROUP: Final = r"^[a-z0-9_]{1,48}\Z"
_SOURCE: Final = r"^[A-Za-z0-9_/]{0,32}\Z"
_UNIT: Final = r"^[A-Za-z0-9%/]{0,12}\Z"
MEASURE_WORDS: Final = {
    _MEASURE: "one word of at most 48 letters, digits and _",
    _GROUP: "one word of at most 48 small letters, digits and _",
    _SOURCE: "one word, or empty",
    _UNIT: "a unit, such as um or mm/s, or empty",
}
"""Each pattern for people."""

MeasureName = Annotated[str, Meta(pattern=_MEASURE)]
GroupName = Annotated[str, Meta(pattern=_GROUP)]

SetPointValue = Annotated[float, Meta(ge=-1e9, le=1e9)]
DelayS = Annotated[float, Meta(ge=0.0, le=60.0)]
HysteresisShare = Annotated[float, Meta(ge=0.0, le=0.5)]

WindowRpm = Annotated[float, Meta(ge=0.0, le=200_000.0)]
SourceName = Annotated[str, Meta(pattern=_SOURCE)]
UnitText = Annotated[str, Meta(pattern=_UNIT)]

QuantityWord = Literal[
    "peak_to_peak", "amplitude_1x", "amplitude_not_1x", "smax", "position", "rms",
    "velocity_rms", "mean", "reading", "speed",
]  # fmt: skip
AlertEffectWord = Literal["event", "alarm", "authority", "retreat"]
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
    may_bypass: bool = False
    """Whether a person may bypass it, with owner, reason and end."""
    alert_effect: AlertEffectWord | None = None
    """What alert does; it trips nothing."""
    danger_effect: EffectWord | None = None
    """What danger does: event, alarm, authority, retreat or trip; each does what those before it
    do."""
    quantity: QuantityWord | None = None
    """What is measured, of a row that adds a measure: peak_to_peak, amplitude_1x, amplitude_not_1x
    of a displacement channel; smax, position of a bearing; rms, velocity_rms, mean of a channel;
    reading of a slow reading; speed of the mark."""
    source: SourceName = ""
    """Channel, slow reading or bearing; empty: the first bearing, or the mark."""
    unit: UnitText = ""
    """Unit of the set points; it must be that of the measure."""
    sense: Literal["rising", "falling", "window"] = "rising"
    """Which side is bad: above, below, or both sides of a window."""
    alert_low: SetPointValue | None = None
    """Lower alert of a window."""
    danger_low: SetPointValue | None = None
    """Lower danger of a window."""
    judged: Literal["always", "turning", "armed"] = "always"
    """When it is judged: always, while the shaft turns, while the device is armed."""
    from_rpm: WindowRpm | None = None
    """Least speed at which it is judged; an unknown speed counts as inside."""
    to_rpm: WindowRpm | None = None
    """Greatest speed at which it is judged, such as that of slow roll."""
    band_low_hz: Annotated[float, Meta(ge=1.0, le=1000.0)] = 10.0
    """Of velocity_rms: low end of the band, from which the integration holds within 1 %."""


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
    may_bypass: bool = False
    """Whether a person may bypass the whole group, with owner, reason and end."""


class MultiplyConfig(Section, frozen=True):
    """Set-point multiply: higher set points in a window of speed, for a limited time."""

    name: GroupName
    """Name of the window, such as first_critical."""
    measures: list[MeasureName]
    """Measures whose set points are multiplied; the cap by the clearance holds."""
    factor: Annotated[float, Meta(ge=1.0, le=5.0)]
    """By what; 2 or 3 are usual."""
    from_rpm: WindowRpm
    """Least speed of the window."""
    to_rpm: WindowRpm
    """Greatest speed of the window."""
    max_s: Annotated[float, Meta(ge=0.1, le=3600.0)] | None = None
    """For at most so long; must be set."""
    reset_rpm: WindowRpm | None = None
    """The time counts anew once the speed was below this; must be set, below from_rpm."""
