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


class Command(Record, frozen=True, tag=True):
    """Target for the actuator node.

    Refused when ``echo_tick_us`` is older than the time to live in the node's clock; obeyed, it
    expires one time to live later.
    """

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
