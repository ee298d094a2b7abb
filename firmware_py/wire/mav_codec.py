"""MAVLink packets <-> records, exactly as ``orbitd.xml`` lays them out (a test holds the two
together).

MAVLink puts the larger fields of a payload first and keeps the order among equals; otherwise the
fields are those of the CAN messages, count for count.  ``RawFrame.frame_id`` is the message id,
``data`` the whole packet.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from struct import Struct
from struct import error as StructError
from typing import Final

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
from firmware_py.wire import mav_packet
from firmware_py.wire.counts import Fields
from firmware_py.wire.fields import NODE_INFO_1, NODE_INFO_2, Conversion, conversions
from firmware_py.wire.layout import SCHEMA_1, SLOTS_MAX, WireLayout

DEVICE: Final = (1, 191)
RIG: Final = (2, 158)
"""System and component id of each side: an onboard computer, a peripheral."""

SAMPLES_BYTES: Final = 48
"""Of the array of samples, whatever the layout: a MAVLink message has one size for all rigs."""

_SIZES: Final = {"I": 4, "i": 4, "H": 2, "h": 2, "B": 1}
"""Bytes per element."""

IDS_1: Final[dict[type, int]] = {
    DeviceHeartbeat: 52001,
    Command: 52002,
    NodeState: 52003,
    RigStatus: 52004,
    SampleFrame: 52005,
    NodeInfo: 52006,
}
"""Messages of wire schema 1 (csAirLink has taken 52000 and 52001 since)."""

IDS_2: Final[dict[type, int]] = {
    DeviceHeartbeat: 54001,
    Command: 54002,
    NodeState: 54003,
    ReadingsFrame: 54004,
    SampleFrame: 54005,
    NodeInfo: 54006,
    NodeFigures: 54007,
    DriveCommand: 54008,
    DriveState: 54009,
}
"""Messages of wire schema 2, in a range that no published dialect uses (a test looks)."""

FROM_DEVICE: Final = (DeviceHeartbeat, Command, DriveCommand)


@dataclass(frozen=True, slots=True)
class _MavMessage:
    """One message: ids, payload layout, the order of the payload, and the way to and from its
    record."""

    message_id: int
    sender: tuple[int, int]
    payload: Struct
    to_payload: Callable[[Fields], Fields]
    from_payload: Callable[[Fields], Fields]
    read: Callable[[Fields], WireMessage | str]
    write: Callable[..., Fields]


def _message(record: type, message_id: int, conversion: Conversion) -> _MavMessage:
    formats = [f for f in re.findall(r"\d*[a-zA-Z]", conversion.layout) if f[-1] != "x"]
    arrays = iter(conversion.elements)
    sizes = [next(arrays) if form[-1] == "s" else _SIZES[form] for form in formats]
    order = sorted(range(len(formats)), key=lambda i: -sizes[i])
    back = sorted(range(len(order)), key=lambda i: order[i])
    payload = Struct("<" + "".join(formats[i] for i in order))
    return _MavMessage(
        message_id,
        DEVICE if record in FROM_DEVICE else RIG,
        payload,
        itemgetter(*order),
        itemgetter(*back),
        conversion.read,
        conversion.write,
    )


class MavCodec:
    """The codec of ``orbitd.xml`` for one rig; it holds no state.

    Parameters
    ----------
    layout
        Of the rig; that of wire schema 1 unless told.
    """

    def __init__(self, layout: WireLayout = SCHEMA_1) -> None:
        self.layout = layout
        known = conversions(layout, slots=SLOTS_MAX, samples_bytes=SAMPLES_BYTES)
        ids = IDS_1 if layout.schema == 1 else IDS_2
        self._by_type = {
            kind: _message(kind, message_id, known[kind]) for kind, message_id in ids.items()
        }
        # A node of the other schema is told by its NODE_INFO.
        infos = ((IDS_1[NodeInfo], NODE_INFO_1), (IDS_2[NodeInfo], NODE_INFO_2))
        self._by_id = {number: _message(NodeInfo, number, how) for number, how in infos} | {
            message.message_id: message for message in self._by_type.values()
        }

    def __deepcopy__(self, memo: object) -> MavCodec:
        """Itself: there is nothing in it that changes."""
        return self

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``, or :class:`Rejected`: unknown_id, malformed, length, crc, range
        or layout."""
        message = self._by_id.get(frame.frame_id)
        if message is None:
            return Rejected("unknown_id", frame.frame_id)
        refusal = _refusal(frame, message)
        if refusal:
            return Rejected(refusal, frame.frame_id)
        payload = frame.data[mav_packet.HEADER_BYTES : -mav_packet.CRC_BYTES].ljust(
            message.payload.size, b"\0"
        )
        record = message.read(message.from_payload(message.payload.unpack(payload)))
        return Rejected(record, frame.frame_id) if isinstance(record, str) else record

    def encode(self, message: WireMessage, now_ns: int = 0) -> RawFrame:
        """The packet that carries ``message``, stamped ``now_ns``.

        The header's sequence number is the low byte of the message's own counter, by which losses
        are counted: the codec holds no state.

        Raises
        ------
        ValueError
            A value is not finite or does not fit its field, or the schema has no such message.
        """
        form = self._by_type.get(type(message))
        if form is None:
            raise ValueError(f"wire schema {self.layout.schema} has no {type(message).__name__}")
        try:
            payload = form.payload.pack(*form.to_payload(form.write(message)))
        except StructError as error:
            raise ValueError(f"{message!r}: {error}") from error
        packet = mav_packet.build(form.message_id, payload, message.counter, *form.sender)
        return RawFrame(now_ns, form.message_id, packet)


def _refusal(frame: RawFrame, message: _MavMessage) -> str:
    """Why ``frame`` is not an intact packet of its message; empty when it is."""
    data = frame.data
    if len(data) <= mav_packet.OVERHEAD_BYTES or data[0] != mav_packet.MAGIC or data[2]:
        return "malformed"
    if mav_packet.message_id_of(data) != frame.frame_id:
        return "malformed"
    length = len(data) - mav_packet.OVERHEAD_BYTES
    if length != data[1] or length > message.payload.size:
        return "length"
    return "" if mav_packet.is_intact(data, frame.frame_id) else "crc"
