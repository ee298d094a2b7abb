"""Values of the added measures against signals whose values are known: within 0.5 %."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import pi, sqrt

import msgspec
import numpy as np
import pytest

from firmware_py.guard.measurement.channel_meters import (
    ChannelMeter,
    MeterState,
    OrbitMeter,
    OrderMeter,
    SumsMeter,
    VelocityMeter,
)
from firmware_py.records import Block, Quality

from ..scripted_node import bench

CONFIG = bench()
CHANNELS = CONFIG.machine.channel
PERIOD_US, N = 200, 30
WITHIN = 0.005

Shape = Callable[[np.ndarray], tuple[np.ndarray, ...]]
"""Counts of the first three channels over time, s."""


def blocks(shape: Shape, seconds: float, rpm: float = 6000.0, first: int = 0) -> Iterator[Block]:
    for k in range(round(seconds / (N * PERIOD_US * 1e-6))):
        start = (first + k) * N
        rows = np.zeros((N, 8))
        for i, column in enumerate(shape((start + np.arange(N)) * PERIOD_US * 1e-6)):
            rows[:, i] = column
        yield Block(
            first + k, start * PERIOD_US * 1000, PERIOD_US * 1000, start * PERIOD_US, PERIOD_US, 0,
            0xFF, rpm * pi / 30, 0, [], np.round(rows).astype("<i2").tobytes(),
        )  # fmt: skip


def last(meter: ChannelMeter, shape: Shape, seconds: float, rpm: float = 6000.0) -> float:
    found = [meter.step(block) for block in blocks(shape, seconds, rpm)][-1]
    assert found is not None
    assert found.whole
    return found.value


def orbit(rpm: float, x_um: float, y_um: float, *, half_um: float = 0.0) -> Shape:
    """1X with amplitudes along the probes and a whirl at half of the speed, off the middle."""
    w = rpm * pi / 30

    def shape(t: np.ndarray) -> tuple[np.ndarray, ...]:
        a = x_um * np.cos(w * t) + half_um * np.cos(0.5 * w * t)
        b = y_um * np.sin(w * t) + half_um * np.sin(0.5 * w * t)
        return 100 * a - 1000.0, 100 * b + 500.0

    return shape


@pytest.mark.parametrize("rpm", [1500.0, 6000.0, 11_970.0])
def test_1x_and_what_is_left_without_it(rpm: float) -> None:
    pure = orbit(rpm, 20.0, 12.0)
    assert last(OrderMeter(CONFIG, 1, CHANNELS[1], True), pure, 1.0, rpm) == pytest.approx(
        24.0, rel=WITHIN
    )
    assert last(OrderMeter(CONFIG, 0, CHANNELS[0], False), pure, 1.0, rpm) < 0.05
    both = orbit(rpm, 20.0, 12.0, half_um=10.0)
    first = last(OrderMeter(CONFIG, 0, CHANNELS[0], True), both, 1.0, rpm)
    rest = last(OrderMeter(CONFIG, 0, CHANNELS[0], False), both, 1.0, rpm)
    assert first == pytest.approx(40.0, rel=0.03), "the whirl leaks by less than 3 % of it"
    assert rest == pytest.approx(20.0, rel=0.03)


def test_smax_is_the_greatest_distance_from_the_mean() -> None:
    meter = OrbitMeter(CONFIG, (0, 1))
    assert last(meter, orbit(6000.0, 20.0, 12.0), 0.5) == pytest.approx(20.0, rel=WITHIN)
    assert last(OrbitMeter(CONFIG, (0, 1)), orbit(6000.0, 20.0, 20.0), 0.5) == pytest.approx(
        20.0, rel=WITHIN
    )


@pytest.mark.parametrize("hertz", [10.0, 25.0, 100.0, 400.0, 590.0])
def test_velocity_is_the_integral_of_the_acceleration(hertz: float) -> None:
    rms = 40.0 if hertz > 20 else 4.0

    def shape(t: np.ndarray) -> tuple[np.ndarray, ...]:
        return 0 * t, 0 * t, 100 * rms * sqrt(2) * np.sin(2 * pi * hertz * t + 1.0) + 300

    value = last(VelocityMeter(CONFIG, 2, CHANNELS[2], 10.0), shape, 3.0)
    wanted = 1e3 * rms / (2 * pi * hertz)
    assert value == pytest.approx(wanted, rel=0.01 if hertz == 10.0 else WITHIN)


def test_eighty_metres_a_second_squared_at_25_hertz_are_509_millimetres_a_second() -> None:
    def shape(t: np.ndarray) -> tuple[np.ndarray, ...]:
        return 0 * t, 0 * t, 100 * 80 * sqrt(2) * np.sin(2 * pi * 25 * t)

    value = last(VelocityMeter(CONFIG, 2, CHANNELS[2], 10.0), shape, 3.0)
    assert value == pytest.approx(509.3, rel=WITHIN)


@pytest.mark.parametrize(("kind", "value"), [("peak_to_peak", 40.0), ("mean", -10.0)])
def test_peak_to_peak_and_mean_of_a_probe(kind: str, value: float) -> None:
    meter = SumsMeter(CONFIG, 0, CHANNELS[0], kind, 1e6)
    assert last(meter, orbit(6000.0, 20.0, 12.0), 0.6) == pytest.approx(value, rel=WITHIN)


def test_rms_of_an_acceleration() -> None:
    def shape(t: np.ndarray) -> tuple[np.ndarray, ...]:
        return 0 * t, 0 * t, 100 * 30 * sqrt(2) * np.sin(2 * pi * 100 * t) + 500

    value = last(SumsMeter(CONFIG, 2, CHANNELS[2], "rms", 1.0), shape, 0.6)
    assert value == pytest.approx(30.0, rel=WITHIN)


def acceleration(t: np.ndarray) -> tuple[np.ndarray, ...]:
    return 0 * t, 0 * t, 100 * 20 * sqrt(2) * np.sin(2 * pi * 50 * t)


def test_short_losses_are_bridged_and_a_long_one_begins_anew() -> None:
    meter = VelocityMeter(CONFIG, 2, CHANNELS[2], 10.0)
    wanted = 1e3 * 20 / (2 * pi * 50)
    found = []
    for k, block in enumerate(blocks(acceleration, 4.0)):
        if k % 40 == 7:
            continue
        quality = int(Quality.GAP_BEFORE) if k % 40 == 8 else 0
        found.append(meter.step(msgspec.structs.replace(block, quality=quality)))
    assert found[-1] is not None
    assert found[-1].value == pytest.approx(wanted, rel=0.25)
    assert not found[-1].whole
    late = [meter.step(block) for block in blocks(acceleration, 1.6, first=10_000)]
    assert late[0] is None
    assert late[100] is None, "it settles for a second"
    assert late[-1] is not None
    assert late[-1].whole


def test_unusable_blocks_are_left_out_and_the_rest_counts() -> None:
    meter = SumsMeter(CONFIG, 0, CHANNELS[0], "peak_to_peak", 1e6)
    found = None
    for k, block in enumerate(blocks(orbit(6000.0, 20.0, 12.0), 0.5)):
        bad = k % 5 == 0
        samples = np.full(N * 8, 32_000, "<i2").tobytes() if bad else block.samples
        found = meter.step(msgspec.structs.replace(block, samples=samples, unusable=int(bad)))
    assert found is not None
    assert found.value == pytest.approx(40.0, rel=WITHIN)
    assert not found.whole
    fresh = SumsMeter(CONFIG, 0, CHANNELS[0], "peak_to_peak", 1e6)
    assert fresh.step(msgspec.structs.replace(block, unusable=1)) is None


def test_an_unknown_speed_has_no_orders() -> None:
    meter = OrderMeter(CONFIG, 0, CHANNELS[0], True)
    *_, block = blocks(orbit(6000.0, 20.0, 12.0), 0.5)
    assert meter.step(msgspec.structs.replace(block, speed_rad_s=0.0)) is None
    assert meter.step(msgspec.structs.replace(block, quality=int(Quality.NO_MARK))) is None
    still = next(blocks(lambda t: (0 * t, 0 * t), 0.01, 0.001))
    found = meter.step(still)
    assert found is not None
    assert found.value == 0.0


def test_a_meter_goes_on_from_its_state() -> None:
    meter, again = (VelocityMeter(CONFIG, 2, CHANNELS[2], 10.0) for _ in range(2))
    stream = list(blocks(acceleration, 2.0))
    for block in stream[:250]:
        meter.step(block)
    again.state = msgspec.msgpack.decode(msgspec.msgpack.encode(meter.state), type=MeterState)
    for block in stream[250:]:
        assert meter.step(block) == again.step(block)
