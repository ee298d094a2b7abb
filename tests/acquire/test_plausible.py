"""Plausibility: each sick sensor is found and named, a healthy machine's channels are left
alone."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.acquire.channel_map import WIRE_SCALES
from firmware_py.acquire.plausible import plausible

RATE, N = 5000.0, 4000
ALL = 0xFF


def counts(speed_hz: float = 70.0) -> np.ndarray:
    """A turning machine: orbit, accelerations, microphone with noise, pressure, contact near its
    supply."""
    rng = np.random.default_rng(0)
    time = np.arange(N) / RATE
    wave = np.sin(2 * np.pi * speed_hz * time)
    si = np.column_stack(
        [
            2e-5 + 8e-6 * wave,
            -3e-5 + 6e-6 * wave,
            *(0.4 * wave,) * 3,
            0.05 * wave,
            np.full(N, 1.0),
            np.full(N, 1.99),
        ]
    )
    noise = np.array([1e-7, 1e-7, 0.05, 0.05, 0.05, 0.05, 0.01, 0.005])
    si += noise * rng.normal(size=si.shape)
    si[:, 7] = np.minimum(si[:, 7], 2.0)
    return np.rint(si / WIRE_SCALES).astype(np.int16)


def ok(values: np.ndarray, speed_hz: float = 70.0) -> int:
    marks = np.arange(0.0, N, RATE / speed_hz)
    return plausible(values, np.array(WIRE_SCALES), np.zeros(8), RATE, marks)


@pytest.mark.parametrize("speed_hz", [25.0, 33.0, 50.0, 70.0, 100.0, 180.0])
def test_a_machine_is_plausible_at_every_speed(speed_hz: float) -> None:
    assert ok(counts(speed_hz), speed_hz) == ALL


@pytest.mark.parametrize("channel", range(8))
def test_dropping_out(channel: int) -> None:
    values = counts()
    values[np.random.default_rng(1).random(N) < 0.05, channel] = 0
    assert ok(values) == ALL & ~(1 << channel)


@pytest.mark.parametrize("channel", range(6))
def test_clipping(channel: int) -> None:
    values = counts()
    middle = int(values[:, channel].mean())
    values[:, channel] = np.minimum(
        values[:, channel], middle + np.ptp(values[:, channel].astype(int)) // 5
    )
    assert ok(values) == ALL & ~(1 << channel)


@pytest.mark.parametrize(("channel", "si"), [(2, 8.0), (3, -4.0), (4, 40.0), (5, 1.0)])
def test_a_mean_where_there_can_be_none(channel: int, si: float) -> None:
    values = counts()
    values[:, channel] += np.int16(si / WIRE_SCALES[channel])
    assert ok(values) == ALL & ~(1 << channel)


@pytest.mark.parametrize(("channel", "si"), [(0, 5e-6), (2, 4.0), (5, 0.4), (6, 0.2), (7, 0.04)])
def test_hum_of_the_mains(channel: int, si: float) -> None:
    hum = si / WIRE_SCALES[channel] * np.sin(2 * np.pi * 50.0 * np.arange(N) / RATE)
    values = counts()
    values[:, channel] += np.rint(hum).astype(np.int16)
    assert ok(values) == ALL & ~(1 << channel)


def test_a_shaft_at_the_mains_frequency_is_not_called_hum() -> None:
    values = counts(50.0)
    values[:, 0] += np.rint(500 * np.sin(2 * np.pi * 50.0 * np.arange(N) / RATE)).astype(np.int16)
    assert ok(values, 50.0) == ALL


def test_without_two_marks_no_line_is_blamed_on_the_mains() -> None:
    hum = 2000 * np.sin(2 * np.pi * 50.0 * np.arange(N) / RATE)
    values = counts()
    values[:, 0] += np.rint(hum).astype(np.int16)
    scale, offset = np.array(WIRE_SCALES), np.zeros(8)
    assert ok(values) == ALL & ~1
    for marks in ([], [100.0]):
        assert plausible(values, scale, offset, RATE, np.array(marks)) == ALL


def test_metal_on_metal_at_a_standstill_is_no_loose_plug() -> None:
    values = counts(0.0)
    rng = np.random.default_rng(1)
    volt = np.clip(rng.normal(0.0, 0.005, N), 0.0, None)  # an amplifier that ends at zero
    values[:, 7] = np.rint(volt / WIRE_SCALES[7])
    scale, marks = np.array(WIRE_SCALES), np.arange(0.0, N, RATE / 70.0)
    assert plausible(values, scale, np.zeros(8), RATE, np.zeros(0)) == ALL
    assert plausible(values, scale, np.zeros(8), RATE, marks) == ALL & ~(1 << 7)
