"""Packets in a stream of bytes: whatever else is in it, the intact ones come out, and the rest is
counted."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.records import DeviceHeartbeat, SampleFrame
from firmware_py.wire import mav_dialect
from firmware_py.wire.mav_codec import MavCodec
from firmware_py.wire.mav_packet import CRC_EXTRA, Framer, build

CODEC = MavCodec()
# No start byte inside, so that each packet is the only one that its bytes can be read as.
PACKETS = [CODEC.encode(SampleFrame(n, n, n, n, 1, bytes(range(1, 49)))).data for n in range(1, 60)]
PACKETS = [packet for packet in PACKETS if packet.count(0xFD) == 1]


def out(framer: Framer, data: bytes, limit: int = 1000) -> list[bytes]:
    return [packet for _, packet in framer.feed(data, limit)]


@given(cuts=st.lists(st.integers(0, 74 * 10), max_size=30))
def test_any_cutting_gives_the_same_packets(cuts: list[int]) -> None:
    stream = b"".join(PACKETS[:10])
    borders = [0, *sorted(cuts), len(stream)]
    framer = Framer()
    found = [p for a, b in pairwise(borders) for p in out(framer, stream[a:b])]
    assert found == PACKETS[:10]
    assert framer.skipped_bytes == 0


@given(parts=st.lists(st.one_of(st.sampled_from(PACKETS), st.binary(max_size=40)), max_size=20))
@settings(deadline=None)
def test_every_intact_packet_survives_garbage_and_every_other_byte_is_counted(
    parts: list[bytes],
) -> None:
    framer = Framer()
    # The tail releases whatever an invented header at the end of the garbage waits for.
    found = [p for part in [*parts, *PACKETS[-8:]] for p in out(framer, part)]
    expected = [part for part in parts if part in PACKETS] + PACKETS[-8:]
    assert found == expected
    garbage = sum(len(part) for part in parts if part not in PACKETS)
    assert framer.skipped_bytes + framer.waiting_bytes == garbage


def test_a_damaged_packet_costs_only_itself() -> None:
    framer = Framer()
    damaged = PACKETS[1][:30] + bytes([PACKETS[1][30] ^ 4]) + PACKETS[1][31:]
    assert out(framer, PACKETS[0] + damaged + PACKETS[2]) == [PACKETS[0], PACKETS[2]]
    assert framer.crc_failed == 1
    assert framer.skipped_bytes == len(damaged)


def test_a_damaged_length_cannot_swallow_the_packets_behind_it() -> None:
    framer = Framer()
    damaged = PACKETS[0][:1] + b"\xff" + PACKETS[0][2:]
    assert out(framer, damaged + b"".join(PACKETS[1:5])) == PACKETS[1:5]


def test_a_truncated_packet_costs_only_itself() -> None:
    framer = Framer()
    assert out(framer, PACKETS[0][:40] + PACKETS[1] + PACKETS[2]) == [PACKETS[1], PACKETS[2]]
    assert framer.skipped_bytes == 40


def test_standard_messages_of_others_pass() -> None:
    sender = mav_dialect.MAVLink(None, srcSystem=255)
    text = mav_dialect.MAVLink_statustext_message(6, b"hello").pack(sender)
    assert Framer().feed(bytes(text), 10) == [(253, bytes(text))]


def test_signed_and_unknown_packets_are_skipped_whole() -> None:
    head = b"\x3e\x01" + PACKETS[0][3:-2]  # the signing flag set, the CRC right
    crc: int = mav_dialect.x25crc(head + bytes([CRC_EXTRA[52005]])).crc
    signed = b"\xfd" + head + crc.to_bytes(2, "little") + bytes(13)
    unknown = bytearray(PACKETS[0])
    unknown[7:10] = b"\x01\x02\x03"
    framer = Framer()
    assert out(framer, signed + bytes(unknown) + PACKETS[1]) == [PACKETS[1]]
    assert framer.skipped_bytes == 2 * 74 + 13


def test_limit_keeps_the_rest_for_the_next_call() -> None:
    framer = Framer()
    assert out(framer, b"".join(PACKETS[:10]), limit=4) == PACKETS[:4]
    assert framer.waiting_bytes == 6 * 74
    assert out(framer, b"", limit=100) == PACKETS[4:10]


def test_reset_counts_what_it_forgets() -> None:
    framer = Framer()
    out(framer, PACKETS[0][:50])
    framer.reset()
    assert framer.skipped_bytes == 50
    assert out(framer, PACKETS[1]) == [PACKETS[1]]


def test_shortest_packet_passes() -> None:
    shortest = build(52001, b"\0", 0, 1, 1)
    assert len(shortest) == 13
    assert out(Framer(), shortest) == [shortest]


def test_heartbeat_of_the_device_is_framed() -> None:
    packet = CODEC.encode(DeviceHeartbeat(1, 2, 0, 2, True, False)).data
    assert out(Framer(), packet) == [packet]
