"""The DBC of a rig: every message of its layout with signals, words, attributes and one example.

The text for wire schema 1 is ``orbitd.dbc`` itself, byte for byte (a test compares); ``orbitd rig
dbc`` writes that of a configured rig.  Messages are described for people and tools in
:mod:`~firmware_py.wire.dbc_messages`; bytes are made by :mod:`firmware_py.wire.fields`, and a test
holds both against each other with cantools.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from firmware_py.records import ReadingsFrame
from firmware_py.wire.codec import CanCodec, frames
from firmware_py.wire.dbc_layout import described
from firmware_py.wire.dbc_messages import DEVICE, NODE, Described, Signal
from firmware_py.wire.layout import WireLayout

_CRC: Final = (
    "CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected, no final xor; over the "
    "data id (2 bytes, little endian, not transmitted), then payload bytes 2 to the last (reserved "
    "bytes included)"
)
_COUNTER: Final = "Per message id; +1 with every frame sent, 65535 is followed by 0"
_COVERAGE: Final = (
    "data id (2 bytes, little endian, not transmitted), then payload bytes 2 to the last"
)
_ABOUT: Final = (
    "The wire of orbitd: CAN FD, 11-bit identifiers, bit rate switching, 1 Mbit/s arbitration, 5 "
    "Mbit/s data, little endian. Reserved bits and bytes (those of no signal) are sent as 0 and "
    "ignored by receivers, but the CRC covers them. The duties of a node stand in NODE.md. Every "
    "message carries an attribute ExampleBytes: one whole frame, CRC included, whose values its "
    "comment names."
)


@dataclass(frozen=True)
class _DbcMessage:
    """A described message with its place on the bus, and its signals with their first bits."""

    told: Described
    frame_id: int
    data_id: int
    size: int
    placed: tuple[tuple[Signal, int], ...]
    example: bytes


def text(
    layout: WireLayout, nominal_bitrate: int = 1_000_000, data_bitrate: int = 5_000_000
) -> str:
    """The whole DBC of ``layout``."""
    messages = _messages(layout)
    return "\n".join(
        [
            'VERSION "1"' if layout.schema == 1 else 'VERSION "2"',
            "",
            "NS_ :",
            "",
            "BS_:",
            "",
            f"BU_: {DEVICE} {NODE}",
            "",
            *_blocks(messages),
            *_comments(messages),
            "",
            *_attributes(messages, layout, nominal_bitrate, data_bitrate),
            "",
            *_choices(messages),
            "",
        ]
    )


def _messages(layout: WireLayout) -> list[_DbcMessage]:
    codec, told = CanCodec(layout), described(layout)
    found = [
        _DbcMessage(
            told[kind],
            int(frame.frame_id),
            frame.data_id,
            frame.size,
            tuple(_placed(told[kind].signals)),
            codec.encode(told[kind].example).data,
        )
        for kind, frame in frames(layout).items()
        if layout.pages or kind is not ReadingsFrame  # a rig without readings sends none
    ]
    return sorted(found, key=lambda message: message.frame_id)


def _placed(rows: Iterable[Signal]) -> Iterator[tuple[Signal, int]]:
    head = (Signal("crc", 16, _CRC), Signal("counter", 16, _COUNTER))
    bit = 0
    for signal in (*head, *rows):
        bit = bit if signal.at is None else signal.at
        yield signal, bit
        bit += signal.bits


def _blocks(messages: list[_DbcMessage]) -> Iterator[str]:
    for m in messages:
        yield f"BO_ {m.frame_id} {m.told.name}: {m.size} {m.told.sender}"
        receiver = NODE if m.told.sender == DEVICE else DEVICE
        for s, bit in m.placed:
            low, high = (-(2 ** (s.bits - 1)), 2 ** (s.bits - 1) - 1)
            if not s.signed:
                low, high = 0, 2**s.bits - 1
            least = low * s.factor if s.least is None else s.least
            most = high * s.factor if s.most is None else s.most
            mux = f" {s.mux}" if s.mux else ""
            yield (
                f" SG_ {s.name}{mux} : {bit}|{s.bits}@1{'-' if s.signed else '+'} "
                f'({s.factor:.9g},0) [{least:.12g}|{most:.12g}] "{s.unit}" {receiver}'
            )
        yield ""


def _comments(messages: list[_DbcMessage]) -> Iterator[str]:
    yield f'CM_ "{_ABOUT}";'
    yield f'CM_ BU_ {DEVICE} "orbitd: reads samples, sends heartbeat and commands.";'
    yield f'CM_ BU_ {NODE} "Sensor and actuator node of the rig.";'
    for m in messages:
        yield f'CM_ BO_ {m.frame_id} "{m.told.comment} ExampleBytes: {m.told.values}.";'
        for s, _ in m.placed:
            if s.comment:
                yield f'CM_ SG_ {m.frame_id} {s.name} "{s.comment}";'


def _attributes(
    messages: list[_DbcMessage], layout: WireLayout, nominal_bitrate: int, data_bitrate: int
) -> Iterator[str]:
    hashed = layout.schema > 1
    formats = ",".join(
        f'"{name}"'
        for name in (
            "StandardCAN",
            "ExtendedCAN",
            *(f"reserved{i}" for i in range(2, 14)),
            "StandardCAN_FD",
            "ExtendedCAN_FD",
        )
    )
    yield 'BA_DEF_  "BusType" STRING ;'
    yield 'BA_DEF_  "CrcPolynomial" HEX 0 65535;'
    yield 'BA_DEF_  "CrcStart" HEX 0 65535;'
    yield 'BA_DEF_  "CrcCoverage" STRING ;'
    yield 'BA_DEF_  "NominalBitrate" INT 0 1000000;'
    yield 'BA_DEF_  "DataBitrate" INT 0 8000000;'
    if hashed:
        yield 'BA_DEF_  "LayoutHash" STRING ;'
    yield f'BA_DEF_ BO_  "VFrameFormat" ENUM  {formats};'
    yield 'BA_DEF_ BO_  "CANFD_BRS" ENUM  "0","1";'
    yield 'BA_DEF_ BO_  "GenMsgSendType" ENUM  "Cyclic";'
    yield 'BA_DEF_ BO_  "GenMsgCycleTime" INT 0 65535;'
    yield 'BA_DEF_ BO_  "CycleTimeUs" INT 0 10000000;'
    yield 'BA_DEF_ BO_  "DataId" HEX 0 65535;'
    yield 'BA_DEF_ BO_  "ExampleBytes" STRING ;'
    yield 'BA_DEF_DEF_  "BusType" "CAN FD";'
    yield 'BA_DEF_DEF_  "CrcPolynomial" 4129;'
    yield 'BA_DEF_DEF_  "CrcStart" 65535;'
    yield f'BA_DEF_DEF_  "CrcCoverage" "{_COVERAGE}";'
    yield 'BA_DEF_DEF_  "NominalBitrate" 1000000;'
    yield 'BA_DEF_DEF_  "DataBitrate" 5000000;'
    if hashed:
        yield 'BA_DEF_DEF_  "LayoutHash" "";'
    yield 'BA_DEF_DEF_  "VFrameFormat" "StandardCAN_FD";'
    yield 'BA_DEF_DEF_  "CANFD_BRS" "1";'
    yield 'BA_DEF_DEF_  "GenMsgSendType" "Cyclic";'
    yield 'BA_DEF_DEF_  "GenMsgCycleTime" 0;'
    yield 'BA_DEF_DEF_  "CycleTimeUs" 0;'
    yield 'BA_DEF_DEF_  "DataId" 0;'
    yield 'BA_DEF_DEF_  "ExampleBytes" "";'
    yield 'BA_ "BusType" "CAN FD";'
    yield 'BA_ "CrcPolynomial" 4129;'
    yield 'BA_ "CrcStart" 65535;'
    yield f'BA_ "CrcCoverage" "{_COVERAGE}";'
    yield f'BA_ "NominalBitrate" {nominal_bitrate};'
    yield f'BA_ "DataBitrate" {data_bitrate};'
    if hashed:
        yield f'BA_ "LayoutHash" "{layout.hash:#010x}";'
    for m in messages:
        yield f'BA_ "VFrameFormat" BO_ {m.frame_id} 14;'
        yield f'BA_ "CANFD_BRS" BO_ {m.frame_id} 1;'
        yield f'BA_ "GenMsgCycleTime" BO_ {m.frame_id} {max(1, round(m.told.cycle_us / 1000))};'
        yield f'BA_ "CycleTimeUs" BO_ {m.frame_id} {m.told.cycle_us};'
        yield f'BA_ "DataId" BO_ {m.frame_id} {m.data_id};'
        yield f'BA_ "ExampleBytes" BO_ {m.frame_id} "{m.example.hex(" ").upper()}";'


def _choices(messages: list[_DbcMessage]) -> Iterator[str]:
    for m in messages:
        for s, _ in m.placed:
            if s.choices:
                named = " ".join(f'{i} "{name}"' for i, name in enumerate(s.choices))
                yield f"VAL_ {m.frame_id} {s.name} {named} ;"
