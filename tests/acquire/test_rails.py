from math import pi

import numpy as np
import pytest

from firmware_py.acquire.rails import CLEAR, COHERENT_LEAST, Rail, RailState, RailWatch, coherent
from firmware_py.records import ChannelCause, cause_bits, cause_of

RATE_HZ, N = 5000, 30
LOW, HIGH, RAIL = -20000, 20000, 21000
SPEED_RAD_S = 6000.0 * pi / 30


def feed(
    watch: RailWatch, state: RailState, signal: np.ndarray, speed_rad_s: float = SPEED_RAD_S
) -> list[Rail]:
    said = []
    for k in range(0, len(signal), N):
        part = signal[k : k + N].astype(np.int16)
        touched = bool(((part < LOW) | (part > HIGH)).any())
        said.append(
            watch.step(state, part, touched, k * speed_rad_s / (2 * pi * RATE_HZ), speed_rad_s)
        )
    return said


def at_rail(seconds: float, *spans: tuple[float, float]) -> np.ndarray:
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    signal = np.zeros(t.shape)
    for start, end in spans:
        signal[(t >= start) & (t < end)] = RAIL
    return signal


def test_a_quiet_signal_is_clear_and_leaves_no_trace() -> None:
    state = RailState()
    assert set(feed(RailWatch(LOW, HIGH, RATE_HZ), state, np.zeros(300))) == {CLEAR}
    assert state == RailState()


@pytest.mark.parametrize("order", [0.4, 0.45, 0.5, 0.9, 1.0, 2.0, 3.0, 8.0])
@pytest.mark.parametrize("jitter", [0.0, 0.05])
def test_touches_at_an_order_of_the_machine_are_coherent(order: float, jitter: float) -> None:
    rng = np.random.default_rng(1)
    assert coherent(list((np.arange(32) + jitter * rng.normal(size=32)) / order))


def test_touches_at_random_are_not_coherent() -> None:
    rng = np.random.default_rng(2)
    assert sum(coherent(list(np.sort(rng.uniform(0.0, 32.0, 32)))) for _ in range(300)) <= 1


@pytest.mark.parametrize("speed_rad_s", [0.0, SPEED_RAD_S])
def test_a_lone_touch_is_out_of_step_once_no_other_follows(speed_rad_s: float) -> None:
    said = feed(
        RailWatch(LOW, HIGH, RATE_HZ), RailState(), at_rail(0.3, (0.05, 0.052)), speed_rad_s
    )
    assert [r.unsure for r in said].count(True) >= 1
    assert [r.out_of_step for r in said].count(True) == 1
    assert said[-1] == CLEAR


def test_with_the_speed_unknown_nothing_is_in_step() -> None:
    spans = [(0.01 * k, 0.01 * k + 0.002) for k in range(60)]
    said = feed(RailWatch(LOW, HIGH, RATE_HZ), RailState(), at_rail(0.6, *spans), 0.0)
    assert not any(r.saturated for r in said)
    assert said[-1].out_of_step


def test_touches_in_step_are_saturated_from_the_sixteenth_on() -> None:
    spans = [(0.01 * k, 0.01 * k + 0.002) for k in range(60)]
    said = feed(RailWatch(LOW, HIGH, RATE_HZ), RailState(), at_rail(0.6, *spans))
    first = [r.saturated for r in said].index(True) * N / RATE_HZ
    assert 0.01 * (COHERENT_LEAST - 2) <= first <= 0.01 * COHERENT_LEAST
    assert said[-1].saturated
    assert not said[-1].unsure


@pytest.mark.parametrize(("alternating", "opened"), [(0, True), (300, True), (2000, False)])
def test_a_tenth_of_a_second_at_the_rail_is_open_unless_it_alternates(
    alternating: int, opened: bool
) -> None:
    signal = at_rail(0.2, (0.03, 0.2))
    signal[signal > 0] += alternating * (np.arange(int((signal > 0).sum())) % 2)
    state = RailState()
    said = feed(RailWatch(LOW, HIGH, RATE_HZ), state, signal)
    assert not any(r.open or r.beyond for r in said[:20])
    assert said[-1].open == opened
    assert said[-1].beyond == (not opened)
    assert state.count == 0


def test_a_second_touch_after_a_long_wait_within_one_block_ends_the_first_chain() -> None:
    signal = np.zeros(60)
    signal[0], signal[59] = RAIL, RAIL
    said = RailWatch(LOW, HIGH, RATE_HZ).step(
        RailState(), signal.astype(np.int16), True, 0.0, 100.0 * SPEED_RAD_S
    )
    assert said.out_of_step


def test_a_cause_of_a_later_version_counts_as_a_bad_contact() -> None:
    word = cause_bits(2, ChannelCause.STUCK) | 15 << 4
    assert cause_of(word, 2) == ChannelCause.STUCK
    assert cause_of(word, 1) == ChannelCause.INTERMITTENT
    assert cause_of(word, 0) == ChannelCause.OK
