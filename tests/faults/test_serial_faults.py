"""What a bad serial line does to the records: counted losses, never a wrong record, never an
exception."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firmware_py.records import NodeState, Rejected, RigStatus, SampleFrame, WireMessage
from firmware_py.wire import mav_dialect
from firmware_py.wire.mav_codec import MavCodec
from firmware_py.wire.serial_link import RETRY_NS, SerialLink

CODEC = MavCodec()


class Line:
    """A link, and the far end of its line in the hands of the test."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plug()
        self.link = SerialLink(str(path), 3_000_000)

    def plug(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        self.path.unlink()
        os.close(self._slave)
        os.close(self.master)

    def say(self, *parts: bytes, now_ns: int = 0) -> list[WireMessage | Rejected]:
        """What the device makes of ``parts``, written one by one."""
        heard: list[WireMessage | Rejected] = []
        for part in parts:
            for start in range(0, len(part), 2048):
                os.write(self.master, part[start : start + 2048])
                heard += [CODEC.decode(frame) for frame in self.link.receive(now_ns)]
        return heard


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    made = Line(tmp_path / "port")
    yield made
    made.link.close()


def sample(counter: int) -> SampleFrame:
    content = np.random.default_rng(counter).integers(0, 256, 48, dtype=np.uint8).tobytes()
    return SampleFrame(counter, 600 * counter, 0, 0, 0, content)


def packets(first: int, last: int) -> list[bytes]:
    return [CODEC.encode(sample(counter)).data for counter in range(first, last)]


STATUS = RigStatus(1, 5, 12.5, 41.25, 55.0, 1.0)
STATE = NodeState(1, 5, 1, 77, 3, 55.0, 1.0, True, 0, 0, 0, 0)


def test_a_clean_line_loses_nothing(line: Line) -> None:
    assert line.say(*packets(0, 200)) == [sample(n) for n in range(200)]
    assert line.link.counters["bytes_skipped"] == 0


def test_noise_between_packets_costs_no_packet(line: Line) -> None:
    noise = np.random.default_rng(1)
    parts = []
    total = 0
    for packet in packets(0, 300):
        burst = noise.integers(0, 256, int(noise.integers(0, 60)), dtype=np.uint8).tobytes()
        total += len(burst)
        parts += [burst, packet]
    assert line.say(*parts) == [sample(n) for n in range(300)]
    assert line.link.counters["bytes_skipped"] == total


def test_flipped_bits_cost_the_packets_they_hit_only(line: Line) -> None:
    rng = np.random.default_rng(2)
    parts = packets(0, 300)
    hit = set(rng.choice(290, 40, replace=False).tolist())
    for number in hit:
        damaged = bytearray(parts[number])
        damaged[int(rng.integers(0, len(damaged)))] ^= 1 << int(rng.integers(0, 8))
        parts[number] = bytes(damaged)
    assert line.say(*parts) == [sample(n) for n in range(300) if n not in hit]
    assert line.link.counters["bytes_skipped"] == sum(len(parts[n]) for n in hit)


def test_lost_bytes_cost_the_packets_they_hit_only(line: Line) -> None:
    parts = packets(0, 100)
    for number in range(5, 90, 7):
        parts[number] = parts[number][:20] + parts[number][21 + number % 30 :]
    survivors = [sample(n) for n in range(100) if n not in range(5, 90, 7)]
    assert line.say(b"".join(parts)) == survivors


def test_a_stream_joined_in_the_middle_of_a_packet_is_found(line: Line) -> None:
    stream = b"".join(packets(0, 10))
    assert line.say(stream[33:]) == [sample(n) for n in range(1, 10)]


def test_duplicates_come_through_as_such(line: Line) -> None:
    one = packets(3, 4)[0]
    assert line.say(one, one) == [sample(3), sample(3)]


def test_interleaved_messages_keep_their_own_order(line: Line) -> None:
    status, state = CODEC.encode(STATUS).data, CODEC.encode(STATE).data
    a, b = packets(0, 2)
    assert line.say(a + status + b + state) == [sample(0), STATUS, sample(1), STATE]


def test_two_talkers_cut_into_each_other_lose_the_torn_packet_only(line: Line) -> None:
    a, b, c = packets(0, 3)
    assert line.say(a[:50] + b + a[50:] + c) == [sample(1), sample(2)]


def test_foreign_but_valid_packets_are_refused_by_name(line: Line) -> None:
    station = mav_dialect.MAVLink(None, srcSystem=255)
    beat = bytes(mav_dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station))
    assert line.say(beat, packets(0, 1)[0]) == [Rejected("unknown_id", 0), sample(0)]


def test_a_silent_line_in_the_middle_of_a_packet_waits(line: Line) -> None:
    whole = packets(0, 1)[0]
    assert line.say(whole[:40]) == []
    assert line.say(whole[40:]) == [sample(0)]


def test_an_unplugged_port_is_named_and_comes_back(line: Line) -> None:
    whole = packets(0, 1)[0]
    line.say(whole, whole[:30])
    line.unplug()
    assert line.link.receive(1) == []
    assert not line.link.up
    assert "unplugged" in line.link.fault
    assert line.link.counters["bytes_skipped"] == 30
    assert not line.link.send(CODEC.encode(STATUS))
    line.plug()
    line.link.receive(RETRY_NS + 1)
    assert line.link.up
    assert line.say(whole, now_ns=RETRY_NS + 2) == [sample(0)]
    counters = line.link.counters
    assert (counters["link_lost"], counters["send_failed"], counters["bytes_skipped"]) == (1, 1, 30)


def test_sending_into_an_unplugged_port_never_raises(line: Line) -> None:
    line.unplug()
    frame = CODEC.encode(STATUS)
    assert [line.link.send(frame) for _ in range(3)] == [False, False, False]
    assert line.link.counters["send_failed"] == 3
    assert not line.link.up


def test_a_packet_torn_by_unplugging_is_not_finished_on_the_next_line(line: Line) -> None:
    frame = CODEC.encode(sample(0))
    while line.link.send(frame):
        pass
    line.unplug()
    line.link.receive(1)
    line.plug()
    line.link.receive(RETRY_NS + 1)
    assert line.link.send(frame)
    assert os.read(line.master, 4096) == frame.data


def test_reopening_is_tried_at_most_twice_a_second(line: Line) -> None:
    line.unplug()
    line.link.receive(0)
    line.link.receive(1)  # the first try
    line.plug()
    line.link.receive(RETRY_NS)
    assert not line.link.up
    line.link.receive(RETRY_NS + 1)
    assert line.link.up
