"""Every kind of signal, once: a row per kind, with unit, range, wire scale and words for people.

A *kind* says what is measured; an *instance* (``[[channel]]``, ``[[reading]]`` of the rig) says
where.  Configuration checks, wire codecs, DBC, acquisition, recorder, metrics and page take what
they need from these rows; a new instance therefore costs no code.  ``docs/signals.md``
and ``docs/how_to_add.md`` tell how to add one.

The tables hold no laws and no thresholds of stages: those stand where they are used.
"""

from __future__ import annotations

from math import inf
from typing import Final, Literal, NamedTuple

INT16_MAX: Final = 32767


class FastKind(NamedTuple):
    """A kind of fast channel: SI = counts x scale + offset, 16 bit on the wire.

    ``wire_unit`` is the unit of the DBC, of which one SI unit has ``wire_per_si``.  ``wire_scale``
    is the least step on the wire in SI, unless the instance says otherwise; the range follows from
    it.  ``shakes``: a touch of the rail out of step with the shaft is a bad contact.  ``rests``:
    the signal may rest at one end (a contact circuit at its supply).  ``mains_si`` and ``mean_si``
    are the least line of the mains and the greatest mean that make a window implausible.
    """

    name: str
    unit: str
    wire_unit: str
    wire_per_si: float
    wire_scale: float
    words: str
    not_ok: str
    shakes: bool = False
    rests: bool = False
    mains_si: float = inf
    mean_si: float = inf

    @property
    def greatest(self) -> float:
        """Greatest value that the wire carries, SI."""
        return INT16_MAX * self.wire_scale


class SlowKind(NamedTuple):
    """A kind of slow reading: ``resolution`` is the step on the wire, 32 bit signed.

    ``suffix`` is the unit as it stands in names (of fields and metrics).
    """

    name: str
    unit: str
    suffix: str
    resolution: float
    least: float
    greatest: float
    words: str


class Standard(NamedTuple):
    """An instance with a name that stages go by, and its kind."""

    name: str
    kind: str
    words: str


class Stream(NamedTuple):
    """A record that leaves the device: its topic in the recording, which is also its key
    expression."""

    record: str
    topic: str
    encoding: Literal["msgpack", "json"]
    published: bool
    when: str


_VOTES: Final = "leaves the vote while open or stuck; alarm; costs authority"
_NAMED: Final = "alarm; the diagnosis names it and gives no verdict that needs it"
_SHOWN: Final = "alarm"

FAST: Final = {
    kind.name: kind
    for kind in (
        FastKind(
            "displacement", "m", "um", 1e6, 1e-8, "shaft displacement", _VOTES,
            shakes=True, mains_si=1e-6,
        ),
        FastKind(
            "acceleration", "m/s2", "m/s2", 1.0, 1e-2, "acceleration of a housing", _VOTES,
            shakes=True, mains_si=0.7, mean_si=2.0,
        ),
        FastKind(
            "velocity", "m/s", "mm/s", 1e3, 1e-5, "velocity of a housing", _SHOWN,
            shakes=True, mains_si=1e-3, mean_si=5e-3,
        ),
        FastKind(
            "sound_pressure", "Pa", "Pa", 1.0, 1e-3, "sound pressure", _NAMED,
            mains_si=0.07, mean_si=0.3,
        ),
        FastKind("pressure", "bar", "bar", 1.0, 1e-3, "pressure, gauge", _NAMED, mains_si=0.03),
        FastKind("voltage", "V", "V", 1.0, 1e-4, "voltage", _NAMED, rests=True, mains_si=0.006),
        FastKind("current", "A", "A", 1.0, 1e-3, "current", _SHOWN),
        FastKind("force", "N", "N", 1.0, 0.1, "force", _SHOWN),
        FastKind("torque", "Nm", "Nm", 1.0, 1e-3, "torque", _SHOWN),
        FastKind("temperature", "degC", "degC", 1.0, 1e-2, "temperature", _SHOWN),
    )
}  # fmt: skip
"""Kinds of fast channels by name."""

SLOW: Final = {
    kind.name: kind
    for kind in (
        SlowKind("temperature", "degC", "C", 0.01, -273.15, 2000.0, "temperature"),
        SlowKind("pressure", "bar", "bar", 0.001, -1.0, 1000.0, "pressure, gauge"),
        SlowKind("flow", "L/min", "L_min", 0.001, -1e5, 1e5, "flow"),
        SlowKind("power", "W", "W", 0.01, -2e7, 2e7, "power"),
        SlowKind("clearance", "um", "um", 0.01, 0.0, 10_000.0, "radial clearance"),
        SlowKind("load", "N", "N", 0.1, -2e8, 2e8, "load"),
        SlowKind("torque", "Nm", "Nm", 0.001, -2e6, 2e6, "torque"),
        SlowKind("speed", "rpm", "rpm", 0.1, -2e5, 2e5, "speed"),
        SlowKind("current", "A", "A", 0.001, -2e6, 2e6, "current"),
        SlowKind("voltage", "V", "V", 0.001, -2e6, 2e6, "voltage"),
        SlowKind("vibration_velocity", "mm/s", "mm_s", 0.001, 0.0, 1e4, "vibration velocity, rms"),
        SlowKind("level", "%", "percent", 0.01, 0.0, 100.0, "level"),
    )
}
"""Kinds of slow readings by name."""

CHANNELS: Final = (
    Standard(
        "disp_x",
        "displacement",
        "Shaft displacement, probe at 45 deg from x (x right, y up); positive towards increasing "
        "x cos a + y sin a",
    ),
    Standard(
        "disp_y", "displacement", "Shaft displacement, probe at 135 deg from x; same sign rule"
    ),
    Standard("acc_bearing_vertical", "acceleration", "Bearing housing, vertical, positive up"),
    Standard(
        "acc_bearing_horizontal", "acceleration", "Bearing housing, horizontal, positive right"
    ),
    Standard("acc_motor", "acceleration", "Motor housing, vertical, positive up"),
    Standard("microphone", "sound_pressure", "Sound pressure"),
    Standard("supply_pressure", "pressure", "Oil supply pressure, gauge"),
    Standard("contact_resistance", "voltage", "Voltage over the film's contact resistance"),
)
"""Fast channels that protection and diagnosis know by name; under wire schema 1 the whole frame,
in this order."""

READINGS: Final = (
    Standard("shaft_power", "power", "Mechanical power into the shaft, error 5 W"),
    Standard("oil_outlet", "temperature", "Oil temperature at the bearing's outlet"),
    Standard("clearance_actual", "clearance", "Measured RADIAL bearing clearance"),
    Standard("pressure_actual", "pressure", "Measured supply pressure, gauge"),
)
"""Slow readings that the guard knows by name; under wire schema 1 the whole RIG_STATUS."""

STREAMS: Final = (
    Stream("CycleRecord", "guard/cycle", "msgpack", False, "each cycle"),
    Stream("Snapshot", "guard/snapshot", "msgpack", False, "each second"),
    Stream("Block", "da/block", "msgpack", True, "each block"),
    Stream("RigReading", "da/reading", "json", True, "20 Hz"),
    Stream("GuardState", "sd/state", "json", True, "10 Hz"),
    Stream("Event", "event", "json", False, "once"),
    Stream("CommandRequest", "cmd/request", "json", False, "once"),
    Stream("CommandReply", "cmd/reply", "json", False, "once"),
    Stream("Diagnosis", "ha/diagnosis", "json", True, "each decision"),
    Stream("ShadowDiagnosis", "ha/shadow", "json", True, "each window"),
    Stream("WindowRecord", "ha/window", "json", False, "each decision"),
    Stream("Forecast", "pa/forecast", "json", True, "each forecast"),
    Stream("Advice", "ag/advice", "json", True, "10 Hz"),
    Stream("BrainState", "ha/state", "json", True, "1 Hz"),
    Stream("CommissionState", "ha/commission", "json", True, "1 Hz"),
    Stream("ModelsInUse", "ha/models", "json", True, "1 Hz"),
    Stream("Normal", "ha/normal", "msgpack", False, "once"),
    Stream("WallClock", "clock", "json", False, "1 Hz"),
    Stream("BrainStep", "brain/step", "msgpack", False, "each step of the brain"),
    Stream("BrainSnapshot", "brain/snapshot", "msgpack", False, "each five seconds"),
)
"""What is recorded, and what of it is published under the same name (blocks after ISO 13374)."""

STANDARD_CHANNEL: Final = {row.name: row for row in CHANNELS}
STANDARD_READING: Final = {row.name: row for row in READINGS}


def fast_kind(name: str, kind: str = "") -> FastKind | None:
    """Kind of the channel ``name``: as said, else that of the standard channel; None when
    unknown."""
    standard = STANDARD_CHANNEL.get(name)
    return FAST.get(kind or (standard.kind if standard else ""))


def slow_kind(name: str, kind: str = "") -> SlowKind | None:
    """Kind of the reading ``name``; None when unknown."""
    standard = STANDARD_READING.get(name)
    return SLOW.get(kind or (standard.kind if standard else ""))


# ---------------------------------------------------------------- geometry of a sample frame

INSTANTS_PER_FRAME_1: Final = 3
"""Sampling instants in a frame of wire schema 1, which has the eight standard channels."""
VALUES_MAX: Final = 24
"""Samples that fit beside the 16 bytes of head into a CAN FD frame of 64."""
CHANNELS_RANGE: Final = (2, VALUES_MAX)
"""Channels that wire schema 2 carries: one instant of the most of them fills a frame."""
SPAN_MAX_US: Final = 5000
"""Time from one sample frame to the next: what is lost with one, and what its first sample
waits."""
VALUES_PER_S_MAX: Final = 120_000
"""Channels times rate: 5000 full frames a second."""


def instants_per_frame(schema: int, channels: int, period_us: int) -> int:
    """Sampling instants in a sample frame: as many as fit, within :data:`SPAN_MAX_US`, at least
    one."""
    if schema == 1:
        return INSTANTS_PER_FRAME_1
    return max(1, min(VALUES_MAX // max(channels, 1), SPAN_MAX_US // period_us))
