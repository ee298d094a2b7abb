"""CAN FD payloads <-> records, exactly as ``orbitd.dbc`` lays them out (a test holds the two
together).

Every payload is little endian and starts with CRC and counter (:mod:`firmware_py.wire.protection`).
Decoding is total: any bytes give a record or :class:`Rejected`.  Encoding a value that does not fit
its field is a programming error and raises ``ValueError``.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from struct import error as StructError
from typing import Final

from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    NodeInfo,
    NodeState,
    RawFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire import protection
from firmware_py.wire.fields import CONVERSIONS, Fields
from firmware_py.wire.fields import SCHEMA as SCHEMA
from firmware_py.wire.fields import SampleFlag as SampleFlag


class FrameId(enum.IntEnum):
    """CAN identifiers (11 bits); the lower wins the bus."""

    DEVICE_HEARTBEAT = 0x050
    COMMAND = 0x060
    NODE_STATE = 0x0A0
    RIG_STATUS = 0x0B0
    SAMPLES = 0x0C0
    NODE_INFO = 0x0F0


@dataclass(frozen=True, slots=True)
class _Layout:
    """One message: identifier, CRC seed, field layout, and the way to and from its record."""

    frame_id: int
    seed: int
    body: Struct
    size: int
    read: Callable[[Fields], WireMessage | None]
    write: Callable[..., Fields]


def _layout(record: type, frame_id: FrameId, data_id: int, size: int) -> _Layout:
    conversion = CONVERSIONS[record]
    used = Struct("<" + conversion.layout).size + protection.CRC_BYTES
    body = Struct(f"<{conversion.layout}{size - used}x")
    return _Layout(
        int(frame_id), protection.seed(data_id), body, size, conversion.read, conversion.write
    )


_BY_TYPE: Final[dict[type, _Layout]] = {
    DeviceHeartbeat: _layout(DeviceHeartbeat, FrameId.DEVICE_HEARTBEAT, 0x4F01, 16),
    Command: _layout(Command, FrameId.COMMAND, 0x4F02, 24),
    NodeState: _layout(NodeState, FrameId.NODE_STATE, 0x4F03, 32),
    RigStatus: _layout(RigStatus, FrameId.RIG_STATUS, 0x4F04, 24),
    SampleFrame: _layout(SampleFrame, FrameId.SAMPLES, 0x4F05, 64),
    NodeInfo: _layout(NodeInfo, FrameId.NODE_INFO, 0x4F06, 24),
}
_BY_ID: Final = {layout.frame_id: layout for layout in _BY_TYPE.values()}


class CanCodec:
    """The codec of ``orbitd.dbc``; it holds no state."""

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``, or :class:`Rejected` with reason unknown_id, length, crc or
        range."""
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
