"""CAN FD payloads <-> records, exactly as ``orbitd.dbc`` lays them out (a test holds the two together).

Every payload is little endian and starts with CRC and counter (:mod:`firmware_py.wire.protection`).
Decoding is total: any bytes give a record or :class:`Rejected`.  Encoding a value that does not fit its
field is a programming error and raises ``ValueError``.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from struct import error as StructError
from typing import Final, cast

from firmware_py.records import (
    ArmState,
    Command,
    DeviceHeartbeat,
    Mode,
    NodeInfo,
    NodeMode,
    NodeState,
    RawFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire import protection

SCHEMA: Final = 1
"""Version of the interface that ``orbitd.dbc`` describes (``NodeInfo.schema``)."""


class FrameId(enum.IntEnum):
    """CAN identifiers (11 bits); the lower wins the bus."""

    DEVICE_HEARTBEAT = 0x050
    COMMAND = 0x060
    NODE_STATE = 0x0A0
    RIG_STATUS = 0x0B0
    SAMPLES = 0x0C0
    NODE_INFO = 0x0F0


class SampleFlag(enum.IntFlag):
    """Bits of ``SampleFrame.flags``."""

    BEHIND = 1
    MARK_VALID = 2
    COASTING = 4


SAMPLE_FLAGS: Final = 0x7
RUN_PERMIT: Final = 1
TRIP_REQUEST: Final = 2

# Resolution of each scaled field (unit per count).
CLEARANCE_UM: Final = 0.01
PRESSURE_BAR: Final = 0.001
POWER_W: Final = 0.01
TEMPERATURE_C: Final = 0.01
RATE_UM_S: Final = 0.1


def _counts(value: float, resolution: float, low: int = 0, high: int = 0xFFFF) -> int:
    """``value`` in counts of ``resolution``; ValueError when it is not finite or does not fit."""
    if not (math.isfinite(value) and low <= (counts := round(value / resolution)) <= high):
        raise ValueError(f"{value} does not fit a field of {low * resolution:g} .. {high * resolution:g}")
    return counts


# Fields as the struct module gives and takes them: without the CRC, counter first.
Fields = tuple[int | bytes, ...]


def _read_samples(f: Fields) -> SampleFrame:
    counter, tick, mark, turns, flags, samples = cast(tuple[int, int, int, int, int, bytes], f)
    return SampleFrame(counter, tick, mark, turns, flags & SAMPLE_FLAGS, samples)


def _write_samples(m: SampleFrame) -> Fields:
    if len(m.samples) != 48:
        raise ValueError(f"samples hold {len(m.samples)} bytes, not 3 x 8 x 2 = 48")
    if m.flags & ~SAMPLE_FLAGS:
        raise ValueError(f"flags {m.flags:#x} hold bits beyond {SAMPLE_FLAGS:#x}")
    return m.counter, m.tick_us, m.mark_tick_us, m.turn_count, m.flags, m.samples


def _read_status(f: Fields) -> RigStatus:
    counter, tick, power, oil, clearance, pressure = cast(tuple[int, ...], f)
    return RigStatus(counter, tick, power * POWER_W, oil * TEMPERATURE_C, clearance * CLEARANCE_UM,
                     pressure * PRESSURE_BAR)


def _write_status(m: RigStatus) -> Fields:
    return (m.counter, m.tick_us, _counts(m.shaft_power_W, POWER_W, -(2**31), 2**31 - 1),
            _counts(m.oil_outlet_C, TEMPERATURE_C, -(2**15), 2**15 - 1),
            _counts(m.clearance_actual_um, CLEARANCE_UM), _counts(m.pressure_actual_bar, PRESSURE_BAR))


def _read_state(f: Fields) -> NodeState | None:
    counter, tick, session, command, mode, arrived, clearance, pressure, *refused = cast(tuple[int, ...], f)
    if mode > max(NodeMode) or arrived > 1:
        return None
    return NodeState(counter, tick, mode, session, command, clearance * CLEARANCE_UM, pressure * PRESSURE_BAR,
                     bool(arrived), *refused)


def _write_state(m: NodeState) -> Fields:
    return (m.counter, m.tick_us, m.session, m.command_counter, NodeMode(m.mode), bool(m.at_target),
            _counts(m.target_clearance_um, CLEARANCE_UM), _counts(m.target_pressure_bar, PRESSURE_BAR),
            m.refused_stale, m.refused_check, m.refused_session, m.refused_range)


def _read_info(f: Fields) -> NodeInfo | None:
    counter, tick, schema, period, clearance, pressure, time_to_live, rate = cast(tuple[int, ...], f)
    if not (period and time_to_live):
        return None
    return NodeInfo(counter, tick, schema, period, clearance * CLEARANCE_UM, pressure * PRESSURE_BAR,
                    time_to_live, rate * RATE_UM_S)


def _write_info(m: NodeInfo) -> Fields:
    if not (m.sample_period_us and m.time_to_live_ms):
        raise ValueError("sample_period_us and time_to_live_ms are at least 1")
    return (m.counter, m.tick_us, m.schema, m.sample_period_us, _counts(m.boot_clearance_um, CLEARANCE_UM),
            _counts(m.boot_pressure_bar, PRESSURE_BAR), m.time_to_live_ms, _counts(m.rate_um_s, RATE_UM_S))


def _read_command(f: Fields) -> Command:
    counter, session, echo, clearance, pressure = cast(tuple[int, ...], f)
    return Command(counter, session, echo, clearance * CLEARANCE_UM, pressure * PRESSURE_BAR)


def _write_command(m: Command) -> Fields:
    return (m.counter, m.session, m.echo_tick_us, _counts(m.clearance_um, CLEARANCE_UM),
            _counts(m.pressure_bar, PRESSURE_BAR))


def _read_heartbeat(f: Fields) -> DeviceHeartbeat | None:
    counter, session, mode, arm_state, flags = cast(tuple[int, ...], f)
    if mode > max(Mode) or arm_state > max(ArmState):
        return None
    return DeviceHeartbeat(counter, session, mode, arm_state, bool(flags & RUN_PERMIT),
                           bool(flags & TRIP_REQUEST))


def _write_heartbeat(m: DeviceHeartbeat) -> Fields:
    flags = RUN_PERMIT * bool(m.run_permit) | TRIP_REQUEST * bool(m.trip_request)
    return m.counter, m.session, Mode(m.mode), ArmState(m.arm_state), flags


@dataclass(frozen=True, slots=True)
class _Layout:
    """One message: identifier, CRC seed, field layout, and the way to and from its record."""

    frame_id: int
    seed: int
    body: Struct
    size: int
    read: Callable[[Fields], WireMessage | None]
    write: Callable[..., Fields]


def _layout(
    frame_id: FrameId, data_id: int, fields: str, size: int,
    read: Callable[[Fields], WireMessage | None], write: Callable[..., Fields],
) -> _Layout:
    used = Struct("<" + fields).size + protection.CRC_BYTES
    body = Struct(f"<{fields}{size - used}x")
    return _Layout(int(frame_id), protection.seed(data_id), body, size, read, write)


_BY_TYPE: Final[dict[type, _Layout]] = {
    DeviceHeartbeat: _layout(FrameId.DEVICE_HEARTBEAT, 0x4F01, "HIBBB", 16, _read_heartbeat,
                             _write_heartbeat),
    Command: _layout(FrameId.COMMAND, 0x4F02, "HIIHH", 24, _read_command, _write_command),
    NodeState: _layout(FrameId.NODE_STATE, 0x4F03, "HIIHBBHHHHHH", 32, _read_state, _write_state),
    RigStatus: _layout(FrameId.RIG_STATUS, 0x4F04, "HIihHH", 24, _read_status, _write_status),
    SampleFrame: _layout(FrameId.SAMPLES, 0x4F05, "HIIHH48s", 64, _read_samples, _write_samples),
    NodeInfo: _layout(FrameId.NODE_INFO, 0x4F06, "HIHHHHHH", 24, _read_info, _write_info),
}
_BY_ID: Final = {layout.frame_id: layout for layout in _BY_TYPE.values()}


class CanCodec:
    """The codec of ``orbitd.dbc``; it holds no state."""

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``, or :class:`Rejected` with reason unknown_id, length, crc or range."""
        layout = _BY_ID.get(frame.frame_id)
        if layout is None:
            return Rejected("unknown_id", frame.frame_id)
        data = frame.data
        if len(data) != layout.size:
            return Rejected("length", frame.frame_id)
        if not protection.is_intact(data, layout.seed):
            return Rejected("crc", frame.frame_id)
        record = layout.read(layout.body.unpack_from(data, protection.CRC_BYTES))
        return Rejected("range", frame.frame_id) if record is None else record

    def encode(self, message: WireMessage, now_ns: int = 0) -> RawFrame:
        """The frame that carries ``message``, stamped ``now_ns``.

        Raises
        ------
        ValueError
            A value is not finite or does not fit its field.
        """
        layout = _BY_TYPE[type(message)]
        try:
            body = layout.body.pack(*layout.write(message))
        except StructError as error:
            raise ValueError(f"{message!r}: {error}") from error
        return RawFrame(now_ns, layout.frame_id, protection.protect(body, layout.seed))
