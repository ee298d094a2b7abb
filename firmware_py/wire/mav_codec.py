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
    NodeInfo,
    NodeState,
    RawFrame,
    Rejected,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire import mav_packet
from firmware_py.wire.fields import CONVERSIONS, Fields

DEVICE: Final = (1, 191)
RIG: Final = (2, 158)
"""System and component id of each side: an onboard computer, a peripheral."""

_SIZES: Final = {"I": 4, "i": 4, "H": 2, "h": 2, "B": 1, "48s": 2}
"""Bytes per element; the samples are an array of 16-bit elements."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """One message: ids, payload layout, the order of the payload, and the way to and from its
    record."""

    message_id: int
    sender: tuple[int, int]
    payload: Struct
    to_payload: Callable[[Fields], Fields]
    from_payload: Callable[[Fields], Fields]
    read: Callable[[Fields], WireMessage | None]
    write: Callable[..., Fields]


def _layout(record: type, message_id: int, sender: tuple[int, int]) -> _Layout:
    conversion = CONVERSIONS[record]
    formats = re.findall(r"\d*[a-zA-Z]", conversion.layout)
    order = sorted(range(len(formats)), key=lambda i: -_SIZES[formats[i]])
    back = sorted(range(len(order)), key=lambda i: order[i])
    payload = Struct("<" + "".join(formats[i] for i in order))
    return _Layout(
        message_id,
        sender,
        payload,
        itemgetter(*order),
        itemgetter(*back),
        conversion.read,
        conversion.write,
    )


_BY_TYPE: Final[dict[type, _Layout]] = {
    DeviceHeartbeat: _layout(DeviceHeartbeat, 52001, DEVICE),
    Command: _layout(Command, 52002, DEVICE),
    NodeState: _layout(NodeState, 52003, RIG),
    RigStatus: _layout(RigStatus, 52004, RIG),
    SampleFrame: _layout(SampleFrame, 52005, RIG),
    NodeInfo: _layout(NodeInfo, 52006, RIG),
}
_BY_ID: Final = {layout.message_id: layout for layout in _BY_TYPE.values()}


class MavCodec:
    """The codec of ``orbitd.xml``; it holds no state."""

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``, or :class:`Rejected`: unknown_id, malformed, length, crc or
        range."""
        layout = _BY_ID.get(frame.frame_id)
        if layout is None:
            return Rejected("unknown_id", frame.frame_id)
        refusal = _refusal(frame, layout)
        if refusal:
            return Rejected(refusal, frame.frame_id)
        payload = frame.data[mav_packet.HEADER_BYTES : -mav_packet.CRC_BYTES].ljust(
            layout.payload.size, b"\0"
        )
        record = layout.read(layout.from_payload(layout.payload.unpack(payload)))
        return Rejected("range", frame.frame_id) if record is None else record

    def encode(self, message: WireMessage, now_ns: int = 0) -> RawFrame:
        """The packet that carries ``message``, stamped ``now_ns``.

        The header's sequence number is the low byte of the message's own counter, by which losses
        are counted: the codec holds no state.

        Raises
        ------
        ValueError
            A value is not finite or does not fit its field.
        """
        layout = _BY_TYPE[type(message)]
        try:
            payload = layout.payload.pack(*layout.to_payload(layout.write(message)))
        except StructError as error:
            raise ValueError(f"{message!r}: {error}") from error
        packet = mav_packet.build(layout.message_id, payload, message.counter, *layout.sender)
        return RawFrame(now_ns, layout.message_id, packet)


def _refusal(frame: RawFrame, layout: _Layout) -> str:
    """Why ``frame`` is not an intact packet of its message; empty when it is."""
    data = frame.data
    if len(data) <= mav_packet.OVERHEAD_BYTES or data[0] != mav_packet.MAGIC or data[2]:
        return "malformed"
    if mav_packet.message_id_of(data) != frame.frame_id:
        return "malformed"
    length = len(data) - mav_packet.OVERHEAD_BYTES
    if length != data[1] or length > layout.payload.size:
        return "length"
    return "" if mav_packet.is_intact(data, frame.frame_id) else "crc"
