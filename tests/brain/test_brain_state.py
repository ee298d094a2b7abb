"""The brain's state: written, read back in another brain, and gone on with, everything stays the
same to the bit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from firmware_py.brain import tree
from firmware_py.brain.commissioning import Learned
from firmware_py.brain.core import BrainCore, BrainTree
from firmware_py.brain.journal import BYTES_PER_S, PART_BYTES, SNAPSHOT_PERIOD_NS, numbers, runs
from firmware_py.brain.store import Models
from firmware_py.records import (
    Advice,
    Block,
    BrainSnapshot,
    BrainStep,
    CommandRequest,
    Diagnosis,
    Mode,
    PeerRecord,
    decode,
    encode,
)

from .machine import CONFIG, Machine, models
from .test_brain_core import guard_state, of

STEPS_ON = 40
"""Steps that a restored brain goes on for: two hops and ten advices."""


@dataclass
class Step:
    """One step of the original brain: its state before, what it took in, what it gave."""

    snapshot: list[bytes]
    blocks: list[bytes]
    records: list[PeerRecord]
    now_ns: int
    out: list[bytes]


@cache
def brain_models() -> Models:
    return models(fleet=True)


def brain() -> BrainCore:
    return BrainCore(CONFIG, brain_models(), "cpu")


def script() -> list[PeerRecord]:
    """Commissioning that is begun, another speed, a gap, a bad channel, a growing unbalance, oil
    that warms."""
    machine = Machine()
    out: list[PeerRecord] = [
        CommandRequest(1, "commission", action="start"),
        guard_state(mode=Mode.MONITOR),
        *machine.run(4.0),
    ]
    machine.speed_rpm, machine.clearance_m = 7500.0, 70e-6
    out += machine.run(1.5)
    machine.tick_us += 90_000
    out += machine.run(1.0)
    out += [
        msgspec.structs.replace(r, channel_ok=0xFD) if isinstance(r, Block) else r
        for r in machine.run(0.6)
    ]
    out.append(guard_state())
    for _ in range(6):
        machine.unbalance_kg_m *= 1.3
        machine.oil_C += 1.0
        out += machine.run(0.4)
    return [*out, CommandRequest(2, "commission", action="stop"), *machine.run(1.0)]


@cache
def flown() -> list[Step]:
    core, steps, batch = brain(), list[Step](), list[PeerRecord]()
    for record in script():
        batch.append(record)
        if not isinstance(record, Block) or len(batch) < 4:
            continue
        now_ns = record.t_acq_ns + 6_000_000
        snapshot = [encode(part) for part in core.snapshot(len(steps), now_ns)]
        blocks = [encode(block) for block in core.recent]
        out = [encode(said) for said in core.step(batch, now_ns)]
        steps.append(Step(snapshot, blocks, batch, now_ns, out))
        batch = []
    return steps


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000))
def test_a_brain_restored_at_any_step_goes_on_bit_for_bit(number: int) -> None:
    steps = flown()
    at = number % (len(steps) - 1)
    core = brain()
    core.restore(
        [decode(part) for part in steps[at].snapshot], [decode(b) for b in steps[at].blocks]
    )  # type: ignore[misc]
    for step in steps[at : at + STEPS_ON]:
        ours = [encode(part) for part in core.snapshot(step_number(step), step.now_ns)]
        assert ours == step.snapshot
        assert without_snapshots(core.step(step.records, step.now_ns)) == without_snapshots(
            [decode(said) for said in step.out]
        )


def without_snapshots(said: list[PeerRecord]) -> list[bytes]:
    return [encode(record) for record in said if not isinstance(record, BrainSnapshot)]


def step_number(step: Step) -> int:
    first = decode(step.snapshot[0])
    assert isinstance(first, BrainSnapshot)
    return first.seq


def test_the_flight_went_through_all_that_the_brain_remembers() -> None:
    said = [decode(data) for step in flown() for data in step.out]
    assert any(d.verdict.startswith("sensor_fault") for d in of(Diagnosis, said))
    assert any(a.clearance_um is not None for a in of(Advice, said))
    reply = next(r for r in said if type(r).__name__ == "CommandReply" and r.seq == 2)
    assert not reply.accepted, "too few points: nothing is learned, what was gathered counts"
    last = flown()[-1]
    parts = [decode(part) for part in last.snapshot]
    state = tree.decode(b"".join(part.state for part in of(BrainSnapshot, parts)), BrainTree)
    assert state.policy.predictor
    assert state.policy.predictor.imbalance.t_ns
    assert state.diagnoser.windows
    assert state.commissioner.phase == "gathering"
    assert state.commissioner.kept


def test_every_step_says_what_it_took_and_snapshots_come_every_few_seconds() -> None:
    steps = flown()
    told = [decode(data) for step in steps for data in step.out]
    journal = of(BrainStep, told)
    assert [step.seq for step in journal] == list(range(len(steps)))
    assert [step.now_ns for step in journal] == [step.now_ns for step in steps]
    for step, record in zip(steps, journal, strict=True):
        assert numbers(record.blocks) == [r.seq for r in step.records if isinstance(r, Block)]
    firsts = [part for part in of(BrainSnapshot, told) if part.part == 0]
    assert len(firsts) >= 2
    for earlier, later in pairwise(firsts):
        size = sum(len(p.state) for p in of(BrainSnapshot, told) if p.seq == earlier.seq)
        assert later.now_ns - earlier.now_ns >= SNAPSHOT_PERIOD_NS
        assert size / (later.now_ns - earlier.now_ns) * 1e9 <= BYTES_PER_S


def test_a_snapshot_is_asked_for_when_somebody_begins_to_record() -> None:
    core = brain()
    assert of(BrainSnapshot, core.step([], 0))
    assert not of(BrainSnapshot, core.step([], 1))
    core.record_from_here()
    assert of(BrainSnapshot, core.step([], 2))[0].seq == 2


def test_a_large_state_crosses_in_parts_and_one_that_misses_is_refused() -> None:
    core = brain()
    core._sets.active.commissioner.state.kept += [learned_decision()] * 60
    parts = core.snapshot(0, 0)
    assert len(parts) > 2
    assert all(len(part.state) <= PART_BYTES for part in parts)
    other = brain()
    with pytest.raises(ValueError, match="part"):
        other.restore(parts[:-1], [])
    other.restore(parts, [])
    assert other.snapshot(0, 0) == parts


def learned_decision() -> Learned:
    rng = np.random.default_rng(1)
    return Learned(rng.normal(size=400), rng.normal(size=4), rng.normal(size=4), 1j)


def test_samples_that_a_snapshot_needs_must_all_be_there() -> None:
    step = flown()[-1]
    blocks = [decode(block) for block in step.blocks]
    parts = [decode(part) for part in step.snapshot]
    with pytest.raises(ValueError, match="not all there"):
        brain().restore(parts, blocks[5:])  # type: ignore[misc,arg-type]


@given(st.lists(st.integers(0, 60), unique=True).map(sorted))
def test_runs_hold_the_same_numbers(found: list[int]) -> None:
    assert numbers(runs(found)) == found
    assert len(runs(found)) % 2 == 0


class Held(msgspec.Struct):
    array: NDArray[np.float64]
    other: NDArray[np.complex128]


@given(
    st.lists(st.floats(width=64), max_size=12),
    st.booleans(),
)
def test_arrays_come_back_with_every_bit_and_their_order(values: list[float], turned: bool) -> None:
    array = np.array([values, values[::-1]])
    array = array.T if turned else array
    held = tree.decode(tree.encode(Held(array, array.astype(complex))), Held)
    assert held.array.tobytes("A") == array.tobytes("A")
    for way in ("c_contiguous", "f_contiguous"):
        assert getattr(held.array.flags, way) == getattr(array.flags, way)
    assert held.array.flags.writeable


def test_a_state_of_another_version_is_refused() -> None:
    for data in (b"\x80", msgspec.msgpack.encode({"array": [1], "other": 3})):
        with pytest.raises(msgspec.DecodeError):
            tree.decode(data, Held)
