"""Decimated features against signals whose figures are known."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from firmware_py.gate.features import ORBIT_POINTS, Decimator

N = 50
"""Rows of one block: 10 ms at 5 kHz."""


def feed(decimator, make_block, counts):
    """Features that come out of ``counts``, cut into blocks."""
    out = []
    for i in range(0, len(counts), N):
        block = make_block(i // N, counts[i : i + N].astype("<i2").tobytes(), i * 200_000)
        if (features := decimator.step(block)) is not None:
            out.append(features)
    return out


def circle(radius_um: float, turns: int, rows: int) -> np.ndarray:
    """Counts of a forward circle about (10, -20) um, seen by probes at 45 and 135 degrees."""
    angle = 2 * np.pi * turns * np.arange(rows) / rows
    x, y = 10 + radius_um * np.cos(angle), -20 + radius_um * np.sin(angle)
    counts = np.zeros((rows, 8))
    counts[:, 0], counts[:, 1] = (x + y) / np.sqrt(2) * 100, (y - x) / np.sqrt(2) * 100
    counts[:, 2] = 100 * np.sin(angle)
    return np.round(counts)


def test_figures_are_si_and_come_ten_times_a_second(bench, make_block):
    features = feed(Decimator(bench), make_block, circle(30.0, 50, 5000))
    assert len(features) == 10
    last = features[-1].channel
    assert last["disp_x"].peak_to_peak == pytest.approx(60e-6, rel=0.01)
    assert last["disp_x"].mean == pytest.approx(-10 / np.sqrt(2) * 1e-6, abs=1e-8)
    assert last["disp_y"].mean == pytest.approx(-30 / np.sqrt(2) * 1e-6, abs=1e-8)
    assert last["acc_bearing_vertical"].rms == pytest.approx(1 / np.sqrt(2), rel=0.01)
    assert [f.seq for f in features] == list(range(1, 11))


def test_the_orbit_is_turned_to_x_right_and_y_up(bench, make_block):
    decimator = Decimator(bench)
    feed(decimator, make_block, circle(30.0, 50, 5000))
    orbit = decimator.orbit()
    x, y = np.array(orbit.x_um) - 10, np.array(orbit.y_um) + 20
    assert len(x) == ORBIT_POINTS
    assert np.hypot(x, y) == pytest.approx(30.0, abs=0.05)
    assert (x[:-1] * y[1:] - y[:-1] * x[1:] > 0).all(), "forward: from x to y"


def test_a_bad_channel_is_bad_for_the_whole_tenth(bench, make_block):
    decimator, out = Decimator(bench), None
    for i in range(10):
        block = make_block(i, bytes(16 * N), i * N * 200_000)
        out = (
            decimator.step(msgspec.structs.replace(block, channel_ok=0xFB if i == 3 else 0xFF))
            or out
        )
    assert out is not None
    assert [channel.ok for channel in out.channel.values()] == [i != 2 for i in range(8)]


def test_full_scale_does_not_overflow(bench, make_block):
    counts = np.tile(np.array([[-32768] * 8, [32767] * 8]), (250, 1))
    assert feed(Decimator(bench), make_block, counts)[0].channel[
        "disp_x"
    ].peak_to_peak == pytest.approx(655.35e-6)


def test_a_clock_that_jumps_back_does_not_hold_blocks_for_ever(bench, make_block):
    decimator = Decimator(bench)
    decimator.step(make_block(1, bytes(16 * N), 10**12))
    assert decimator.step(make_block(2, bytes(16 * N), 0)) is not None
