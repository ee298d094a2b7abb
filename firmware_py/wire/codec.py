"""CAN FD payloads <-> records, exactly as the rig's DBC lays them out (a test holds the two
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
from typing import Final, NamedTuple

from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    DriveCommand,
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    RawFrame,
    ReadingsFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire import protection
from firmware_py.wire.counts import Fields
from firmware_py.wire.fields import Conversion, conversions
from firmware_py.wire.layout import SCHEMA_1, WireLayout
from firmware_py.wire.layout_fields import SampleFlag as SampleFlag


class FrameId(enum.IntEnum):
    """CAN identifiers (11 bits); the lower wins the bus.

    A message that both schemas have in common keeps its identifier; one that differs has another,
    so that neither side ever takes a frame of the other schema for its own.
    """

    DEVICE_HEARTBEAT = 0x050
    COMMAND = 0x060
    DRIVE_COMMAND = 0x068
    NODE_STATE = 0x0A0
    DRIVE_STATE = 0x0A8
    RIG_STATUS = 0x0B0
    READINGS = 0x0B8
    SAMPLES = 0x0C0
    SAMPLES_2 = 0x0C8
    NODE_INFO = 0x0F0
    NODE_FIGURES = 0x0F8


class Frame(NamedTuple):
    """Where one message lies on the bus."""

    frame_id: FrameId
    data_id: int
    size: int


FRAMES_1: Final[dict[type, Frame]] = {
    DeviceHeartbeat: Frame(FrameId.DEVICE_HEARTBEAT, 0x4F01, 16),
    Command: Frame(FrameId.COMMAND, 0x4F02, 24),
    NodeState: Frame(FrameId.NODE_STATE, 0x4F03, 32),
    RigStatus: Frame(FrameId.RIG_STATUS, 0x4F04, 24),
    SampleFrame: Frame(FrameId.SAMPLES, 0x4F05, 64),
    NodeInfo: Frame(FrameId.NODE_INFO, 0x4F06, 24),
}
"""Messages of wire schema 1."""


def frames(layout: WireLayout) -> dict[type, Frame]:
    """Every message of ``layout``'s schema, by record."""
    if layout.schema == 1:
        return FRAMES_1
    same = {kind: FRAMES_1[kind] for kind in (DeviceHeartbeat, Command, NodeState, NodeInfo)}
    return same | {
        DriveCommand: Frame(FrameId.DRIVE_COMMAND, 0x4F07, 24),
        DriveState: Frame(FrameId.DRIVE_STATE, 0x4F08, 48),
        ReadingsFrame: Frame(FrameId.READINGS, 0x4F09, layout.readings_payload),
        SampleFrame: Frame(FrameId.SAMPLES_2, 0x4F0A, layout.samples_payload),
        NodeFigures: Frame(FrameId.NODE_FIGURES, 0x4F0B, 48),
    }


@dataclass(frozen=True, slots=True)
class _CanMessage:
    """One message: identifier, CRC seed, field layout, and the way to and from its record."""

    frame_id: int
    seed: int
    body: Struct
    size: int
    read: Callable[[Fields], WireMessage | str]
    write: Callable[..., Fields]


def _message(frame: Frame, conversion: Conversion) -> _CanMessage:
    used = Struct("<" + conversion.layout).size + protection.CRC_BYTES
    body = Struct(f"<{conversion.layout}{frame.size - used}x")
    return _CanMessage(
        int(frame.frame_id),
        protection.seed(frame.data_id),
        body,
        frame.size,
        conversion.read,
        conversion.write,
    )


class CanCodec:
    """The codec of one rig's DBC; it holds no state.

    Parameters
    ----------
    layout
        Of the rig; that of ``orbitd.dbc`` unless told.
    """

    def __init__(self, layout: WireLayout = SCHEMA_1) -> None:
        self.layout = layout
        known = conversions(layout)
        self._by_type = {
            kind: _message(frame, known[kind]) for kind, frame in frames(layout).items()
        }
        self._by_id = {message.frame_id: message for message in self._by_type.values()}

    def __deepcopy__(self, memo: object) -> CanCodec:
        """Itself: there is nothing in it that changes."""
        return self

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``, or :class:`Rejected` with reason unknown_id, length, crc, range
        or layout."""
        message = self._by_id.get(frame.frame_id)
        if message is None:
            return Rejected("unknown_id", frame.frame_id)
        data = frame.data
        if len(data) != message.size:
            return Rejected("length", frame.frame_id)
        if not protection.is_intact(data, message.seed):
            return Rejected("crc", frame.frame_id)
        record = message.read(message.body.unpack_from(data, protection.CRC_BYTES))
        return Rejected(record, frame.frame_id) if isinstance(record, str) else record

    def encode(self, message: WireMessage, now_ns: int = 0) -> RawFrame:
        """The frame that carries ``message``, stamped ``now_ns``.

        Raises
        ------
        ValueError
            A value is not finite or does not fit its field, or the schema has no such message.
        """
        form = self._by_type.get(type(message))
        if form is None:
            raise ValueError(f"wire schema {self.layout.schema} has no {type(message).__name__}")
        try:
            body = form.body.pack(*form.write(message))
        except StructError as error:
            raise ValueError(f"{message!r}: {error}") from error
        return RawFrame(now_ns, form.frame_id, protection.protect(body, form.seed))
