from math import pi

import numpy as np
import pytest

from firmware_py.acquire.stage import NEVER_NS, Acquire
from firmware_py.records import Block, Quality, RawFrame
from firmware_py.wire.codec import CanCodec

from ..guard.scripted_node import MS, ScriptedNode, bench


class Stream:
    """A scripted node into the acquisition stage, a millisecond at a time."""

    def __init__(self, drift_ppm: int = 0) -> None:
        self.config = bench()
        self.node = ScriptedNode(self.config, drift_ppm)
        self.stage = Acquire(self.config, CanCodec())
        self.now_ns = 10 * MS
        self.blocks: list[Block] = []
        self.node.step(self.now_ns)

    def feed(self, frames: list[RawFrame]) -> None:
        self.blocks += self.stage.step(frames, self.now_ns).blocks

    def frames(self) -> list[RawFrame]:
        self.now_ns += MS
        return self.node.step(self.now_ns)

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.feed(self.frames())


def samples(block: Block) -> np.ndarray:
    return np.frombuffer(block.samples, "<i2").reshape(-1, 8)


@pytest.mark.parametrize("drift_ppm", [-50, 0, 50])
def test_blocks_follow_each_other_without_a_gap(drift_ppm: int) -> None:
    stream = Stream(drift_ppm)
    stream.run(2000)
    period = stream.config.sampling.period_us
    assert len(stream.blocks) >= 330
    assert [b.seq for b in stream.blocks] == list(range(len(stream.blocks)))
    for a, b in zip(stream.blocks, stream.blocks[1:], strict=False):
        assert b.tick_us - a.tick_us == len(samples(a)) * period
        assert not b.quality & Quality.GAP_BEFORE
    assert stream.blocks[-1].quality == Quality.GOOD
    assert stream.stage.counters["frames_lost"] == 0


def test_times_are_right_across_the_tick_wrap() -> None:
    stream = Stream()
    stream.run(2000)
    start = stream.blocks[0]
    assert start.tick_us < 2**32 < stream.blocks[-1].tick_us
    for block in stream.blocks[100:]:
        true_ns = (block.tick_us - 4_294_000_000) * 1000
        # one millisecond of polling and the wire's delay may add, nothing may be early
        assert 0 <= block.t_acq_ns - true_ns < 1_200_000


@pytest.mark.parametrize("lost", [1, 2, 9, 10, 11, 40])
def test_a_gap_closes_the_block_and_is_counted(lost: int) -> None:
    stream = Stream()
    stream.run(1000)
    before = len(stream.blocks)
    sampled = [f for _ in range(60) for f in stream.frames() if f.frame_id == 0x0C0]
    stream.feed(sampled[:5] + sampled[5 + lost :])
    assert stream.stage.counters["frames_lost"] == lost
    marked = [b for b in stream.blocks[before:] if b.quality & Quality.GAP_BEFORE]
    assert len(marked) == 1
    first_after = marked[0]
    previous = stream.blocks[first_after.seq - 1]
    missing_us = first_after.tick_us - previous.tick_us - len(samples(previous)) * 200
    assert missing_us == lost * 600


def test_repeated_and_reordered_frames_are_dropped_and_counted() -> None:
    stream = Stream()
    stream.run(1000)
    frames = [f for _ in range(30) for f in stream.frames() if f.frame_id == 0x0C0]
    reference = Stream()
    reference.run(1030)
    stream.feed(frames[:10] + frames[5:8] + [frames[9]] + frames[10:])
    assert stream.stage.counters["reject_reordered"] == 3
    assert stream.stage.counters["reject_repeated"] == 1
    assert b"".join(b.samples for b in stream.blocks) == b"".join(
        b.samples for b in reference.blocks
    )


def test_damaged_frames_are_counted_by_reason_and_never_raise() -> None:
    stream = Stream()
    stream.run(500)
    good = next(f for f in iter(lambda: stream.frames()[0], None) if f.frame_id == 0x0C0)
    broken = bytes([good.data[0] ^ 1]) + good.data[1:]
    stream.feed(
        [
            RawFrame(0, 0x0C0, broken),
            RawFrame(0, 0x0C0, good.data[:-1]),
            RawFrame(0, 0x123, b"abc"),
            RawFrame(0, 0x0C0, b""),
        ]
    )
    counters = stream.stage.counters
    assert (counters["reject_crc"], counters["reject_length"], counters["reject_unknown_id"]) == (
        1,
        2,
        1,
    )


def test_a_node_that_starts_again_is_noticed_and_its_clock_mapped_anew() -> None:
    stream = Stream()
    stream.run(1000)
    stream.node.restart()
    stream.run(100)
    assert stream.stage.counters["node_restarts"] == 1
    assert not stream.stage.clock_settled
    stream.run(700)
    assert stream.stage.clock_settled


def test_freshness_is_the_worse_of_arrival_and_mapped_age() -> None:
    stream = Stream()
    assert stream.stage.sample_age_ns(0) == NEVER_NS
    stream.run(1500)
    assert stream.stage.sample_age_ns(stream.now_ns) < 3 * MS
    assert stream.stage.sample_age_ns(stream.now_ns + 30 * MS) >= 30 * MS
    late = [
        RawFrame(f.arrival_ns + 50 * MS, f.frame_id, f.data)
        for _ in range(50)
        for f in stream.frames()
    ]
    stream.feed(late)
    assert stream.stage.sample_age_ns(late[-1].arrival_ns) >= 49 * MS


@pytest.mark.parametrize("rpm", [600.0, 1500.0, 6000.0, 12000.0])
def test_speed_and_marks(rpm: float) -> None:
    stream = Stream()
    stream.node.speed_rpm = rpm
    stream.run(1500)
    assert stream.blocks[-1].speed_rad_s == pytest.approx(rpm * pi / 30, rel=2e-3)
    marks = [m for b in stream.blocks for m in b.mark_ticks_us]
    assert np.diff(marks[2:]) == pytest.approx(60e6 / rpm, abs=3)


def test_a_mark_that_is_called_invalid_is_quality_not_zero_speed() -> None:
    stream = Stream()
    stream.run(1000)
    stream.node.mark_valid = False
    stream.run(50)
    assert stream.blocks[-1].quality & Quality.NO_MARK
    assert stream.blocks[-1].speed_rad_s == pytest.approx(6000 * pi / 30, rel=2e-3)
