"""The records that move through the device, in the order in which a sample meets them.

Every record is a frozen ``msgspec.Struct``.  Those that cross a process border are tagged, so one byte
string tells its own type; :func:`encode` and :func:`decode` are the only two ways across.

Times are monotonic nanoseconds of the host (``*_ns``) or microsecond ticks of the node (``*_tick_us``,
32 bit, wrapping).  Units stand in the names; values inside the stages are SI floats.
"""

from __future__ import annotations

import enum
from typing import Final

import msgspec

CHANNELS: Final = (
    "disp_x",
    "disp_y",
    "acc_bearing_vertical",
    "acc_bearing_horizontal",
    "acc_motor",
    "microphone",
    "supply_pressure",
    "contact_resistance",
)
"""The eight sensor channels in wire order."""

N_CHANNELS: Final = len(CHANNELS)
INSTANTS_PER_FRAME: Final = 3
"""Sampling instants in one sample frame."""


class Record(msgspec.Struct, frozen=True, gc=False, tag_field="type"):
    """Base of every record: frozen, compared by value, tagged with its class name."""


# --------------------------------------------------------------------------- wire: what the node says


class RawFrame(Record, frozen=True, tag=True):
    """One frame as it came off a link: CAN FD payload, or one whole MAVLink packet."""

    arrival_ns: int
    frame_id: int
    data: bytes


class SampleFrame(Record, frozen=True, tag=True):
    """Three sampling instants of eight channels (``int16``, little endian, instant-major)."""

    counter: int
    tick_us: int
    mark_tick_us: int
    turn_count: int
    flags: int
    samples: bytes


class RigStatus(Record, frozen=True, tag=True):
    """Slow measurements of the rig (every 50 ms)."""

    counter: int
    tick_us: int
    shaft_power_W: float
    oil_outlet_C: float
    clearance_actual_um: float
    pressure_actual_bar: float


class NodeMode(enum.IntEnum):
    """What the actuator node is doing with its target."""

    SAFE = 0
    FOLLOWING = 1


class NodeState(Record, frozen=True, tag=True):
    """The actuator node's own account: whom it follows, where it goes, what it refused (every 50 ms)."""

    counter: int
    tick_us: int
    mode: int
    session: int
    command_counter: int
    target_clearance_um: float
    target_pressure_bar: float
    at_target: bool
    refused_stale: int
    refused_check: int
    refused_session: int
    refused_range: int


class NodeInfo(Record, frozen=True, tag=True):
    """What the node is (every second): compared with the configuration before arming."""

    counter: int
    tick_us: int
    schema: int
    sample_period_us: int
    boot_clearance_um: float
    boot_pressure_bar: float
    time_to_live_ms: int
    rate_um_s: float


# --------------------------------------------------------------------------- wire: what the device says


class Command(Record, frozen=True, tag=True):
    """Target for the actuator node; expires there ``time_to_live`` after ``echo_tick_us``."""

    counter: int
    session: int
    echo_tick_us: int
    clearance_um: float
    pressure_bar: float


class Mode(enum.IntEnum):
    """Who chooses the targets."""

    MONITOR = 0
    MANUAL = 1
    AUTO = 2


class ArmState(enum.IntEnum):
    """Life cycle of the right to move the actuator."""

    BOOT = 0
    CHECK = 1
    DISARMED = 2
    ARMED = 3
    RECOVERY = 4
    TRIPPED = 5


class DeviceHeartbeat(Record, frozen=True, tag=True):
    """What the rig's drive obeys (every 50 ms): it coasts down on a trip request or on silence."""

    counter: int
    session: int
    mode: int
    arm_state: int
    run_permit: bool
    trip_request: bool


WireMessage = SampleFrame | RigStatus | NodeState | NodeInfo | Command | DeviceHeartbeat


class Rejected(Record, frozen=True, tag=True):
    """A frame that the codec refused; ``reason`` is one of the documented reject names."""

    reason: str
    frame_id: int


# --------------------------------------------------------------------------- acquire: blocks


class Quality(enum.IntFlag):
    """What is known to be wrong with a record; 0 is good."""

    GOOD = 0
    GAP_BEFORE = 1
    CLOCK_UNSETTLED = 2
    NO_MARK = 4
    STALE = 8


class Block(Record, frozen=True, tag=True):
    """A gap-free run of samples, time-stamped on the host's clock (ISO 13374 DA).

    ``samples`` holds ``n x 8`` little-endian ``int16``, row = instant.  ``t_acq_ns`` is the mapped host
    time of the first row, ``period_ns`` the sample period on the host's clock.  ``mark_ticks_us`` are the
    (unwrapped) node ticks of the once-per-turn marks that fell inside the block; ``tick_us`` is the
    unwrapped node tick of the first row.  Bit ``i`` of ``channel_ok`` is channel ``i``.
    """

    seq: int
    t_acq_ns: int
    period_ns: int
    tick_us: int
    sample_period_us: int
    quality: int
    channel_ok: int
    speed_rad_s: float
    turn_count: int
    mark_ticks_us: list[int]
    samples: bytes


class RigReading(Record, frozen=True, tag=True):
    """A :class:`RigStatus` and the latest :class:`NodeState` with their host time."""

    seq: int
    t_acq_ns: int
    quality: int
    status: RigStatus
    node: NodeState | None


# --------------------------------------------------------------------------- guard: state and events


class Severity(enum.IntEnum):
    """How much an event asks of a person."""

    INFO = 0
    ALERT = 1
    DANGER = 2
    FAULT = 3


class Event(Record, frozen=True, tag=True):
    """Something that happened once: it stays with the guard until the gate acknowledges ``seq``."""

    seq: int
    t_ns: int
    severity: int
    name: str
    text: str
    value: float = 0.0
    limit: float = 0.0


class Alarm(Record, frozen=True, tag=True):
    """An alarm that stands now (published as a full cyclic list)."""

    name: str
    severity: int
    since_ns: int
    value: float
    limit: float
    latched: bool


class GuardState(Record, frozen=True, tag=True):
    """Everything the guard says about itself ten times a second."""

    seq: int
    t_ns: int
    mode: int
    arm_state: int
    authority: bool
    authority_reasons: list[str]
    speed_rad_s: float
    load_estimate_N: float
    clearance_low_um: float
    clearance_high_um: float
    target_clearance_um: float
    target_pressure_bar: float
    clearance_actual_um: float
    peak_to_peak_um: tuple[float, float]
    run_permit: bool
    trip_request: bool
    node_following: bool
    alarms: list[Alarm]
    counters: dict[str, int]
    zone: str = ""


# --------------------------------------------------------------------------- brain: HA, PA, AG


class Diagnosis(Record, frozen=True, tag=True):
    """The classifier's word on one decision (ISO 13374 HA)."""

    seq: int
    t_acq_ns: int
    quality: int
    verdict: str
    probability: float
    heads: dict[str, float]
    classes: dict[str, float]
    doubt: bool
    unknown: bool
    evidence: dict[str, float]
    model: str


class Forecast(Record, frozen=True, tag=True):
    """What the predictor expects ``horizon_s`` ahead for the present and the advised clearance (PA).

    Each quantity is ``(low, expected, high)``; ``conditional_on`` says which future was assumed.
    """

    seq: int
    t_acq_ns: int
    quality: int
    horizon_s: float
    conditional_on: str
    clearance_um: float
    peak_to_peak_um: tuple[float, float, float]
    power_W: tuple[float, float, float]
    min_film_um: tuple[float, float, float]
    whirl_margin: tuple[float, float, float]
    load_N: tuple[float, float, float]
    viscosity_Pa_s: tuple[float, float, float]
    unbalance_kg_m: tuple[float, float, float]
    model: str


class Advice(Record, frozen=True, tag=True):
    """A proposal to the guard, sent at a fixed rate even when there is nothing to propose (AG).

    ``clearance_um`` is None when the brain has no proposal; ``reasons`` then says why.  Expires
    ``lifetime_ns`` after ``t_ns``.  ``t_acq_ns`` is the time of the newest sample it rests on.
    """

    seq: int
    t_ns: int
    t_acq_ns: int
    lifetime_ns: int
    clearance_um: float | None
    pressure_bar: float | None
    qualified: bool
    reasons: list[str]
    forecast: Forecast | None


class BrainState(Record, frozen=True, tag=True):
    """What the brain counts: windows cut and dropped, answers refused, proposals overruled (once a second)."""

    seq: int
    t_ns: int
    counters: dict[str, int]


# --------------------------------------------------------------------------- gate: commands


class CommandRequest(Record, frozen=True, tag=True):
    """A person's or program's wish: ``verb`` is one of :data:`VERBS`."""

    seq: int
    verb: str
    value: float | None = None
    mode: int | None = None
    origin: str = "local"


VERBS: Final = ("mode", "arm", "disarm", "reset", "set_clearance", "set_pressure")


class CommandReply(Record, frozen=True, tag=True):
    """Answer to :class:`CommandRequest` ``seq``: accepted, or *all* reasons why not."""

    seq: int
    accepted: bool
    reasons: list[str]


class EventAck(Record, frozen=True, tag=True):
    """The gate has stored every event up to and including ``seq``."""

    seq: int


class Hello(Record, frozen=True, tag=True):
    """First record of a peer on a room's socket: which room it is (``brain``, ``gate``)."""

    role: str
    pid: int


# --------------------------------------------------------------------------- guard: replay


class Cycle(Record, frozen=True, tag=True):
    """All that one guard cycle read: with the snapshot before it, it determines the decision."""

    seq: int
    now_ns: int
    frames: list[RawFrame]
    advice: Advice | None
    commands: list[CommandRequest]
    brain_connected: bool
    gate_connected: bool
    link_up: bool


class Decision(Record, frozen=True, tag=True):
    """All that one guard cycle put out."""

    seq: int
    frames_out: list[RawFrame]
    blocks: list[Block]
    readings: list[RigReading]
    events: list[Event]
    replies: list[CommandReply]
    state: GuardState | None


class CycleRecord(Record, frozen=True, tag=True):
    """One cycle for the flight recorder: what came in, and the frames and events that went out."""

    cycle: Cycle
    frames_out: list[RawFrame]
    events: list[Event]


class Snapshot(Record, frozen=True, tag=True):
    """The guard's whole state before cycle ``seq``: a replay segment starts here."""

    seq: int
    now_ns: int
    state: bytes


class WindowRecord(Record, frozen=True, tag=True):
    """What the brain decided on: ``last_t_acq_ns`` closes the window, for replay."""

    seq: int
    last_t_acq_ns: int
    last_block_seq: int
    diagnosis_seq: int
    cpu_features: str


RoomRecord = (
    Block
    | RigReading
    | Event
    | GuardState
    | Diagnosis
    | Forecast
    | Advice
    | BrainState
    | CommandRequest
    | CommandReply
    | EventAck
    | Hello
    | CycleRecord
    | Snapshot
    | WindowRecord
)

_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(RoomRecord)


def encode(record: RoomRecord) -> bytes:
    """Byte string (msgpack) of one record."""
    return _encoder.encode(record)


def decode(data: bytes) -> RoomRecord:
    """The record in ``data``.

    Raises
    ------
    msgspec.ValidationError, msgspec.DecodeError
        When ``data`` is not one whole record of a known type.
    """
    record: RoomRecord = _decoder.decode(data)
    return record
