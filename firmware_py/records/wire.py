"""What crosses the wire between node and device, before and after the codec."""

from __future__ import annotations

import enum

from firmware_py.records.base import Record


class RawFrame(Record, frozen=True, tag=True):
    """One frame as it came off a link: CAN FD payload, or one whole MAVLink packet."""

    arrival_ns: int
    frame_id: int
    data: bytes


class SampleFrame(Record, frozen=True, tag=True):
    """Sampling instants of all channels (``int16``, little endian, instant-major).

    Wire schema 1: three of the eight standard channels; schema 2: as many as the rig's layout has.
    """

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


class ReadingQuality(enum.IntEnum):
    """What the node says of one slow reading."""

    OK = 0
    CLIPPED = 1
    FAULT = 2
    ABSENT = 3


class ReadingsFrame(Record, frozen=True, tag=True):
    """One page of the rig's slow readings (wire schema 2), in the order of its declaration.

    ``values`` are in the unit of each reading's kind, ``ages_ms`` before ``tick_us`` (2550: that or
    older), ``qualities`` are :class:`ReadingQuality`.
    """

    counter: int
    tick_us: int
    page: int
    values: tuple[float, ...]
    ages_ms: tuple[int, ...]
    qualities: tuple[int, ...]


class NodeMode(enum.IntEnum):
    """What the actuator node is doing with its target."""

    SAFE = 0
    FOLLOWING = 1


class NodeState(Record, frozen=True, tag=True):
    """The actuator node's own account: whom it follows, where it goes, what it refused (every 50
    ms)."""

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
    layout_hash: int = 0
    """Of the frames that the node sends (wire schema 2); 0 under schema 1."""


class NodeFigures(Record, frozen=True, tag=True):
    """What the node was built with, beside :class:`NodeInfo` (wire schema 2, every second).

    The lags are time constants of the actuators behind their targets.  The drive's figures are 0
    where the device cannot command it.
    """

    counter: int
    tick_us: int
    heartbeat_limit_ms: int
    coasts_on_silence: bool
    drive_commandable: bool
    clearance_min_um: float
    clearance_max_um: float
    pressure_min_bar: float
    pressure_max_bar: float
    clearance_lag_ms: int
    pressure_lag_ms: int
    drive_time_to_live_ms: int
    speed_min_rpm: float
    speed_max_rpm: float
    load_min_N: float
    load_max_N: float


class Command(Record, frozen=True, tag=True):
    """Target for the actuator node.

    Refused when ``echo_tick_us`` is older than the time to live in the node's clock; executed, it
    expires one time to live later.
    """

    counter: int
    session: int
    echo_tick_us: int
    clearance_um: float
    pressure_bar: float


class DriveCommand(Record, frozen=True, tag=True):
    """Setpoints for the rig's drive (wire schema 2); refused and expired like :class:`Command`."""

    counter: int
    session: int
    echo_tick_us: int
    speed_rpm: float
    load_N: float
    speed_ramp_rpm_s: int
    load_ramp_N_s: int


class DriveMode(enum.IntEnum):
    """Whose setpoints the drive follows."""

    LOCAL = 0
    FOLLOWING = 1
    COASTING = 2


class DriveState(Record, frozen=True, tag=True):
    """The drive's own account: whom it follows, setpoints, readings, refusals (wire schema 2)."""

    counter: int
    tick_us: int
    session: int
    command_counter: int
    mode: int
    speed_setpoint_rpm: float
    load_setpoint_N: float
    speed_rpm: float
    load_N: float
    refused_stale: int
    refused_check: int
    refused_session: int
    refused_range: int


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
    """What the rig's drive follows (every 50 ms): it coasts down on a trip request or on
    silence."""

    counter: int
    session: int
    mode: int
    arm_state: int
    run_permit: bool
    trip_request: bool


WireMessage = (
    SampleFrame
    | RigStatus
    | NodeState
    | NodeInfo
    | Command
    | DeviceHeartbeat
    | ReadingsFrame
    | NodeFigures
    | DriveCommand
    | DriveState
)


class Rejected(Record, frozen=True, tag=True):
    """A frame that the codec refused; ``reason`` is one of the documented reject names."""

    reason: str
    frame_id: int
