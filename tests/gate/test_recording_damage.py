"""Damaged recordings: everything that is whole is read, nothing that is not is believed, what is
missing is told."""

from __future__ import annotations

import os
import random
import time
import tracemalloc
from collections.abc import Callable

import msgspec
import pytest
from mcap.writer import Writer

from firmware_py import mcap_scan
from firmware_py.recording import METADATA_NAME, Recording, RecordingError
from firmware_py.records import CycleRecord

from .test_gate_recorder import cycle, recorder, stored_cycles

N = 2000


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    folder = tmp_path_factory.mktemp("whole")
    noise = random.Random(1)
    made = recorder(folder)
    for seq in range(N):
        record = cycle(seq)
        frames = [msgspec.structs.replace(record.frames_out[0], data=noise.randbytes(64))]
        made.write(msgspec.structs.replace(record, frames_out=frames), seq * 1_000_000)
    made.close()
    return next(folder.glob("*.mcap")).read_bytes()


def chunk_starts(data: bytes) -> list[int]:
    places, at = [], data.find(b"\x04\0\0\0zstd")
    while at >= 0:
        if data[at - 37] == 6:  # the index at the end names the compression too
            places.append(at - 37)
        at = data.find(b"\x04\0\0\0zstd", at + 1)
    return places


def put(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


def third(data: bytes) -> int:
    """Start of a chunk in the middle."""
    starts = chunk_starts(data)
    return starts[len(starts) // 2]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda d: d[: len(d) * 2 // 3],
    "cut, zeros at the end": lambda d: d[: len(d) * 2 // 3] + bytes(65536),
    "zeros in the middle": lambda d: put(d, len(d) // 2, bytes(4096)),
    "zeros at the start": lambda d: put(d, 0, bytes(4096)),
    "junk in the middle": lambda d: put(d, len(d) // 2, random.Random(2).randbytes(4096)),
    "bytes missing": lambda d: d[: len(d) // 2] + d[len(d) // 2 + 1234 :],
    "bytes inserted": lambda d: d[: len(d) // 2] + b"x" * 777 + d[len(d) // 2 :],
    "a bit in a chunk": lambda d: put(d, third(d) + 500, bytes([d[third(d) + 500] ^ 1])),
    "a huge length": lambda d: put(d, third(d) + 1, (2**63).to_bytes(8, "little")),
    "a length past the end": lambda d: put(d, third(d) + 1, (len(d) + 5).to_bytes(8, "little")),
    "a length that swallows two chunks": lambda d: put(
        d, third(d) + 1, (50_000).to_bytes(8, "little")
    ),
    "a length of zero": lambda d: put(d, third(d) + 1, bytes(8)),
    "a huge unpacked size": lambda d: put(d, third(d) + 25, (2**50).to_bytes(8, "little")),
    "junk appended": lambda d: d + random.Random(3).randbytes(10_000),
    "zeros appended": lambda d: d + bytes(10_000),
    "summary zeroed": lambda d: put(d, len(d) - 3000, bytes(3000)),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_what_is_whole_is_read_and_the_rest_is_told(whole, tmp_path, name):
    path = tmp_path / "x.mcap"
    path.write_bytes(whole)
    good = {c.cycle.seq: c for c in stored_cycles(path)}
    assert len(good) == N
    path.write_bytes(DAMAGES[name](whole))
    recording = Recording(path)
    messages = list(recording.messages())
    found = [
        msgspec.msgpack.decode(m.data, type=CycleRecord)
        for m in messages
        if m.topic == "guard/cycle"
    ]
    assert all(c == good[c.cycle.seq] for c in found), "something that is not whole was believed"
    assert len(found) >= (0.62 if name.startswith("cut") else 0.85) * N
    if len(found) < N:
        assert recording.interrupted or recording.damage.skipped_bytes
    assert recording.damage.places > 0 or name == "cut"
    if name == "zeros in the middle":
        assert "zeros" in recording.damage.notes[0] or "damaged record" in recording.damage.notes[0]
        assert " s to " in recording.damage.notes[0]


def test_a_flipped_bit_anywhere_costs_at_most_its_chunk(whole, tmp_path):
    path = tmp_path / "x.mcap"
    path.write_bytes(whole)
    good = {c.cycle.seq: c for c in stored_cycles(path)}
    for place in range(0, len(whole), len(whole) // 120):
        path.write_bytes(put(whole, place, bytes([whole[place] ^ 0x40])))
        found = stored_cycles(path)
        assert all(c == good[c.cycle.seq] for c in found)
        assert len(found) > N - 150


def test_a_head_that_is_lost_is_taken_from_its_copy(whole, tmp_path):
    path = tmp_path / "x.mcap"
    path.write_bytes(whole)
    head = Recording(path).metadata
    place = whole.index(b'"guard/cycle') - 40
    path.write_bytes(put(whole, place, b"\0" * 8))
    recording = Recording(path)
    assert recording.metadata == head
    assert sum(m.topic == "guard/cycle" for m in recording.messages()) == N
    everywhere = whole.replace(METADATA_NAME.encode(), b"Orbitd")
    path.write_bytes(everywhere)
    with pytest.raises(RecordingError, match="no whole 'orbitd' metadata"):
        Recording(path)


def test_a_recording_of_before_the_digest_is_read_with_its_own_channel_numbers(tmp_path):
    path = tmp_path / "old.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=4096)
        writer.start()
        writer.add_metadata(METADATA_NAME, {"format": "1", "orbitd": "0.1"})
        writer.register_channel("event", "json", 0)
        number = writer.register_channel("guard/cycle", "msgpack", 0)
        for seq in range(300):
            writer.add_message(number, seq, msgspec.msgpack.encode(cycle(seq)), seq)
        writer.finish()
    assert [c.cycle.seq for c in stored_cycles(path)] == list(range(300))
    path.write_bytes(path.read_bytes()[:-2000])
    assert len(stored_cycles(path)) > 200


def test_a_recording_appended_to_another_is_left_out_and_told(whole, tmp_path):
    made = recorder(tmp_path / "other")
    made.write(cycle(5), 5)
    made.close()
    other = next((tmp_path / "other").glob("*.mcap")).read_bytes()
    path = tmp_path / "x.mcap"
    path.write_bytes(whole + other)
    recording = Recording(path)
    assert sum(m.topic == "guard/cycle" for m in recording.messages()) == N
    assert "after the end" in recording.damage.notes[0]


@pytest.mark.timing
def test_bytes_made_to_mislead_cost_time_and_memory_in_proportion(whole, tmp_path):
    """Starts of chunks all over the file, each of which claims megabytes."""
    false = bytes([6]) + (8 << 20).to_bytes(8, "little") + bytes(28) + b"\x04\0\0\0zstd" + bytes(11)
    path = tmp_path / "x.mcap"
    path.write_bytes(whole[: len(whole) // 2] + false * ((8 << 20) // len(false)))
    tracemalloc.start()
    began = time.process_time()
    assert sum(1 for _ in Recording(path).messages()) > N // 3
    assert time.process_time() - began < 7
    assert tracemalloc.get_traced_memory()[1] < 120 << 20
    tracemalloc.stop()


def test_a_bomb_is_not_unpacked(whole, tmp_path):
    import zstandard

    packed = zstandard.ZstdCompressor().compress(bytes(300 << 20))
    body = (
        bytes(16)
        + (1000).to_bytes(8, "little")
        + bytes(4)
        + b"\x04\0\0\0zstd"
        + len(packed).to_bytes(8, "little")
    )
    bomb = bytes([6]) + (len(body) + len(packed)).to_bytes(8, "little") + body + packed
    at = third(whole)
    path = tmp_path / "x.mcap"
    path.write_bytes(whole[:at] + bomb + whole[at:])
    tracemalloc.start()
    recording = Recording(path)
    assert sum(m.topic == "guard/cycle" for m in recording.messages()) == N
    assert tracemalloc.get_traced_memory()[1] < 100 << 20
    tracemalloc.stop()
    assert recording.damage.skipped_bytes == len(bomb)


def test_every_damage_is_counted_and_the_first_ones_are_named(whole, tmp_path):
    data = bytearray(whole)
    for start in chunk_starts(whole)[4::2]:
        data[start + 200] ^= 1
    path = tmp_path / "x.mcap"
    path.write_bytes(bytes(data))
    recording = Recording(path)
    list(recording.messages())
    assert recording.damage.places == len(chunk_starts(whole)[4::2])
    assert len(recording.damage.notes) <= 21


def test_a_file_that_ends_while_it_is_read_ends_the_reading(whole, tmp_path):
    path = tmp_path / "x.mcap"
    path.write_bytes(whole)
    scan = mcap_scan.scan(path, METADATA_NAME)
    next(scan)
    os.truncate(path, len(whole) // 3)
    assert list(scan)[-1] == mcap_scan.End(False)
