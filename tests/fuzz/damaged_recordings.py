"""Fuzz target: recordings with random damage. Reading and replay end, believe nothing that is not
whole, and go on."""

from __future__ import annotations

import functools
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from firmware_py.errors import OrbitdError
from firmware_py.gate.recorder import Recorder
from firmware_py.recording import NOTES_MAX, Recording
from firmware_py.records import Cycle, CycleRecord, RawFrame

from .outcome import Outcome

SECONDS_MAX = 2.0
"""No damaged file of this size may take longer, in processor time."""
RECORDS = 400

Damage = Callable[[random.Random, bytes], bytes]


def _place(rng: random.Random, data: bytes, size: int = 1) -> int:
    return rng.randrange(max(1, len(data) - size))


def _over(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


def _flip(rng: random.Random, data: bytes) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 3, 50))):
        out[_place(rng, data)] ^= 1 << rng.randrange(8)
    return bytes(out)


def _zeros(rng: random.Random, data: bytes) -> bytes:
    size = rng.choice((1, 8, 512, 4096, 20_000))
    return _over(data, _place(rng, data, size), bytes(size))


def _junk(rng: random.Random, data: bytes) -> bytes:
    size = rng.choice((1, 9, 512, 4096))
    return _over(data, _place(rng, data, size), rng.randbytes(size))


def _cut(rng: random.Random, data: bytes) -> bytes:
    return data[: _place(rng, data)]


def _cut_zeros(rng: random.Random, data: bytes) -> bytes:
    return _cut(rng, data) + bytes(rng.choice((1, 4096, 65_536)))


def _hole(rng: random.Random, data: bytes) -> bytes:
    at = _place(rng, data)
    return data[:at] + data[at + rng.randrange(1, 9000) :]


def _insert(rng: random.Random, data: bytes) -> bytes:
    at = _place(rng, data)
    return data[:at] + rng.randbytes(rng.randrange(1, 2000)) + data[at:]


def _repeat(rng: random.Random, data: bytes) -> bytes:
    at = _place(rng, data)
    return data[:at] + data[max(0, at - rng.randrange(1, 20_000)) :]


def _length(rng: random.Random, data: bytes) -> bytes:
    value = rng.choice((0, 1, len(data), 2**24, 2**31, 2**63, 2**64 - 1)) + rng.randrange(2)
    return _over(data, _place(rng, data, 8), (value % 2**64).to_bytes(8, "little"))


def _append(rng: random.Random, data: bytes) -> bytes:
    return data + rng.choice((bytes(5000), rng.randbytes(5000), data, data[: len(data) // 2]))


DAMAGES: tuple[Damage, ...] = (
    _flip,
    _zeros,
    _junk,
    _cut,
    _cut_zeros,
    _hole,
    _insert,
    _repeat,
    _length,
    _append,
)


@functools.cache
def _whole() -> tuple[bytes, dict[int, CycleRecord]]:
    """A recording of cycles, and what it holds."""
    rng = random.Random(0)
    every = {seq: _cycle(seq, rng) for seq in range(RECORDS)}
    with tempfile.TemporaryDirectory() as folder:
        made = Recorder(Path(folder), "fuzz", {"config": "{}", "orbitd": "x"}, 10**8, lambda: 0)
        for seq, record in every.items():
            made.write(record, seq * 1_000_000)
        made.close()
        return next(Path(folder).glob("*.mcap")).read_bytes(), every


def _cycle(seq: int, rng: random.Random) -> CycleRecord:
    frame = RawFrame(arrival_ns=seq * 1_000_000, frame_id=0xC0, data=rng.randbytes(64))
    cycle = Cycle(
        seq=seq,
        now_ns=seq * 1_000_000,
        frames=[frame],
        advice=None,
        commands=[],
        brain_connected=True,
        gate_connected=True,
        link_up=True,
    )
    return CycleRecord(cycle=cycle, frames_out=[], events=[])


def run(seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Damage a recording in ``n`` ways, from number ``first`` on; good is what could still be
    read."""
    outcome = Outcome()
    whole, every = _whole()
    path = folder / "x.mcap"
    for number in range(first, first + n):
        rng = random.Random(f"{seed} {number}")
        data, names = whole, []
        for damage in rng.choices(DAMAGES, k=rng.choice((1, 1, 2, 5))):
            data = damage(rng, data or b"\0")
            names.append(damage.__name__.strip("_"))
        path.write_bytes(data)
        good, wrong = _read(path, every)
        outcome.add(
            f"seed {seed}, number {number}, {'+'.join(names)}", good, [wrong] if wrong else []
        )
    return outcome


def _read(path: Path, every: dict[int, CycleRecord]) -> tuple[bool, str]:
    """Whether the file was taken for a recording, and what went wrong."""
    began = time.process_time()
    good = False
    try:
        recording = Recording(path)
        good = True
        for message in recording.messages():
            if message.topic == "guard/cycle":
                record = msgspec.msgpack.decode(message.data, type=CycleRecord)
                if record != every.get(record.cycle.seq):
                    return good, f"cycle {record.cycle.seq} is not what was recorded"
        if len(recording.damage.notes) > NOTES_MAX + 2:
            return good, "more notes than a person reads"
    except OrbitdError as error:
        if error.exit_code != 2:
            return good, f"exit code {error.exit_code}"
    except Exception as error:  # noqa: BLE001 - whatever comes out is a finding
        return good, f"{type(error).__name__}: {error}"
    took_s = time.process_time() - began
    return good, f"took {took_s:.1f} s" if took_s > SECONDS_MAX else ""
