"""Windows are the same however the samples arrive, hold whole turns, and never cross a gap."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.acquire.channel_map import WIRE_SCALES, ChannelMap
from firmware_py.acquire.recorded_windows import iter_windows
from firmware_py.acquire.windows import MAX_SECONDS, TURNS, Window, Windower, nearest_tick
from firmware_py.records import Block, Quality, RigReading, RigStatus

from .synthetic_recording import readings, recording

RATE = 5000


def blocks(counts, marks, *, first_tick=0, samples=30, drop=(), channel_ok=0xFF):
    """The recording as the blocks of a device: 30 samples each, with host time = tick + 1 s."""
    period = 1_000_000 // RATE
    out = []
    for seq, start in enumerate(range(0, len(counts), samples)):
        if seq in drop:
            continue
        part = counts[start : start + samples]
        tick = first_tick + start * period
        inside = [
            int(m) + first_tick for m in marks if start * period <= m < (start + len(part)) * period
        ]
        quality = Quality.GAP_BEFORE if seq - 1 in drop else 0
        out.append(
            Block(
                seq,
                1_000_000_000 + tick * 1000,
                period * 1000,
                tick,
                period,
                quality,
                channel_ok,
                314.0,
                0,
                inside,
                part.tobytes(),
            )
        )
    return out


def run(some_blocks) -> tuple[list[Window], Windower]:
    windower = Windower(ChannelMap.wire(), RATE)
    return [window for block in some_blocks for window in windower.step(block)], windower


@pytest.mark.parametrize("samples", [3, 30, 750, 12000])
def test_windows_do_not_depend_on_block_size(samples: int) -> None:
    counts, marks = recording(RATE)
    offline = list(iter_windows(counts, 0, marks, RATE))
    online, _ = run(blocks(counts, marks, samples=samples))
    assert len(offline) == len(online) == 13
    for a, b in zip(offline, online, strict=True):
        assert a.end_tick_us == b.end_tick_us
        assert np.array_equal(a.samples, b.samples)
        assert np.array_equal(a.marks, b.marks)


def test_ticks_and_host_time_of_the_end() -> None:
    counts, marks = recording(RATE)
    windows, _ = run(blocks(counts, marks, samples=700))
    assert [w.end_tick_us for w in windows[:2]] == [800_000, 1_050_000]
    assert [w.end_ns for w in windows[:2]] == [1_800_000_000, 2_050_000_000]


@pytest.mark.parametrize(("speed_hz", "turns"), [(25.0, TURNS), (50.0, 39), (200.0, 159)])
def test_whole_turns(speed_hz: float, turns: int) -> None:
    counts, marks = recording(RATE, start_hz=speed_hz)
    last = list(iter_windows(counts, 0, marks, RATE))[-1]
    assert turns <= last.turns <= turns + 1
    assert last.quality == 0
    assert len(last.samples) <= MAX_SECONDS * RATE


def test_slow_shaft_and_lost_mark_are_flagged() -> None:
    counts, marks = recording(RATE, start_hz=3.0)
    assert all(w.quality & Quality.NO_MARK for w in iter_windows(counts, 0, marks, RATE))
    counts, marks = recording(RATE)
    torn = np.delete(marks, 30)
    assert next(iter_windows(counts, 0, torn, RATE)).quality & Quality.NO_MARK
    assert not next(iter_windows(counts, 0, marks, RATE)).quality


def test_no_window_crosses_a_gap() -> None:
    counts, marks = recording(RATE)
    windows, windower = run(blocks(counts, marks, drop={300}))
    assert windower.counters == {"windows": len(windows), "windows_cut_by_gap": 1}
    gap_us = 301 * 30 * 200
    assert not any(w.end_tick_us - len(w.samples) * 200 < gap_us < w.end_tick_us for w in windows)
    assert any(w.end_tick_us >= gap_us + 800_000 for w in windows)


def test_a_silent_jump_of_the_tick_is_a_gap() -> None:
    counts, marks = recording(RATE, seconds=2.0)
    first, later = blocks(counts, marks), blocks(counts, marks, first_tick=2_000_200)
    _, windower = run(first + later)
    assert windower.counters["windows_cut_by_gap"] == 1
    _, windower = run(first + blocks(counts, marks, first_tick=2_000_000))
    assert windower.counters["windows_cut_by_gap"] == 0


def test_bad_channel_stays_in_the_windows_that_saw_it_only() -> None:
    counts, marks = recording(RATE)
    every = blocks(counts, marks)
    every[100] = Block(
        **{f: getattr(every[100], f) for f in Block.__struct_fields__} | {"channel_ok": 0xEF}
    )
    windows, _ = run(every)
    saw = [
        w.end_tick_us - len(w.samples) * 200 < 101 * 6000 and w.end_tick_us > 100 * 6000
        for w in windows
    ]
    assert [w.channel_ok == 0xEF for w in windows] == saw
    assert any(saw)
    assert not all(saw)


def test_flags_of_a_block_reach_its_windows() -> None:
    counts, marks = recording(RATE, seconds=1.0)
    every = blocks(counts, marks)
    values = {f: getattr(every[50], f) for f in Block.__struct_fields__}
    every[50] = Block(**values | {"quality": int(Quality.CLOCK_UNSETTLED)})
    windows, _ = run(every)
    assert windows[0].quality == Quality.CLOCK_UNSETTLED


def test_readings_are_averaged_inside_the_window() -> None:
    counts, marks = recording(RATE)
    windower = Windower(ChannelMap.wire(), RATE)
    base = 0xFFFF_0000
    out = []
    for block in blocks(counts, marks, first_tick=base):
        status = RigStatus(0, (block.tick_us + 100) % 2**32, 50.0, 41.0, 60.0, 1.0)
        windower.note(RigReading(0, 0, 0, status, None))
        out += windower.step(block)
    assert out[-1].clearance_m == pytest.approx(60e-6, rel=1e-12)
    assert (out[-1].shaft_power_W, out[-1].oil_outlet_C) == (50.0, 41.0)
    assert np.isnan(next(iter_windows(counts, 0, marks, RATE)).clearance_m)
    assert next(iter_windows(counts, 0, marks, RATE, readings=readings())).oil_outlet_C == 45.0


def test_memory_is_bounded() -> None:
    counts, marks = recording(RATE, seconds=8.0)
    windower = Windower(ChannelMap.wire(), RATE)
    before = windower._ring.nbytes
    for block in blocks(counts, marks):
        windower.step(block)
    assert windower._ring.nbytes == before == 2 * MAX_SECONDS * RATE * 16


def test_probes_become_machine_axes() -> None:
    counts = np.zeros((4, 8), np.int16)
    counts[:, 0], counts[:, 1] = 1000, 500
    x, y = ChannelMap.wire().to_si(counts)[0, :2]
    half = np.sqrt(0.5)
    assert x == pytest.approx(half * (1000 - 500) * WIRE_SCALES[0])
    assert y == pytest.approx(half * (1000 + 500) * WIRE_SCALES[0])


@pytest.mark.parametrize(
    ("tick", "near", "unwrapped"),
    [
        (5, 0xFFFF_FFF0, 0x1_0000_0005),
        (0xFFFF_FFF0, 0x1_0000_0005, 0xFFFF_FFF0),
        (7, 9, 7),
        (3, -1, 3),
    ],
)
def test_nearest_tick(tick: int, near: int, unwrapped: int) -> None:
    assert nearest_tick(tick, near) == unwrapped
