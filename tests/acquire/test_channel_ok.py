import math

import numpy as np
import pytest

from firmware_py.acquire.channel_ok import HOLD_OFF_S, STUCK_S, ChannelOk, counts_range
from firmware_py.acquire.rails import CHAIN_UNKNOWN_S
from firmware_py.config import SHIPPED, load
from firmware_py.records import ChannelCause, cause_of

CHANNELS = load(SHIPPED / "bench")[0].machine.channel
RATE_HZ = 5000
N = 30
ALL_OK = 0xFF


def lively(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(-5, 6, (N, 8)).astype(np.int16)


def test_ranges_in_counts_lie_inside_the_rails() -> None:
    assert counts_range(CHANNELS[0]) == (-24500, 24500)
    assert all(-32768 < low < high < 32767 for low, high in map(counts_range, CHANNELS))


def test_a_lively_signal_is_ok() -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    assert all(ok.step(lively(k)) == ALL_OK for k in range(50))


@pytest.mark.parametrize("outside", range(N + 1))
def test_more_than_a_quarter_outside_is_not_ok_a_clipped_peak_is(outside: int) -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    samples = lively()
    samples[:outside, 0] = 24501
    assert bool(ok.step(samples) & 1) == (4 * outside <= N)


@pytest.mark.parametrize(
    ("count", "good"), [(24500, True), (24501, False), (-24500, True), (-24501, False)]
)
def test_the_edge_of_the_range_is_exact(count: int, good: bool) -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    samples = lively()
    samples[:-1, 1] = count
    assert bool(ok.step(samples) & 2) == good


def test_a_stuck_channel_is_found_after_its_time_and_only_that_channel() -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    masks = []
    for k in range(round(STUCK_S * RATE_HZ / N) + 2):
        samples = lively(k)
        samples[:, 3] = 123
        masks.append(ok.step(samples))
    needed = -(-round(STUCK_S * RATE_HZ) // N)
    assert masks[needed - 2] == ALL_OK
    assert masks[needed - 1] == ALL_OK & ~(1 << 3)


def test_a_value_that_steps_between_blocks_is_not_stuck() -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    for k in range(200):
        samples = lively(k)
        samples[:, 6] = k
        assert ok.step(samples) == ALL_OK


def test_returns_only_after_the_hold_off() -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    bad = lively()
    bad[:, 0] = 30000
    assert not ok.step(bad) & 1
    owed = round(HOLD_OFF_S * RATE_HZ)
    masks = [ok.step(lively(k)) & 1 for k in range(owed // N + 2)]
    assert masks.index(1) == -(-owed // N) - 1


def test_a_lone_touch_is_a_bad_contact_once_nothing_follows_it() -> None:
    ok = ChannelOk(CHANNELS, RATE_HZ)
    causes = []
    for k in range(round(CHAIN_UNKNOWN_S * RATE_HZ / N) + 2):
        samples = lively(k)
        if k == 0:
            samples[5, 0] = 24501
        ok.step(samples)
        causes.append(cause_of(ok.state.causes, 0))
    after = N - 6  # samples behind the touch in its own block
    ended = (round(CHAIN_UNKNOWN_S * RATE_HZ) - after) // N + 1
    assert causes[:ended] == [ChannelCause.OK] * ended
    assert causes[ended:] == [ChannelCause.INTERMITTENT] * (len(causes) - ended)


def causes_of(counts: np.ndarray, channel: int = 0, **of: float) -> list[ChannelCause]:
    """Cause of ``channel``, by default the first probe, after each block of its ``counts``."""
    ok = ChannelOk(CHANNELS, RATE_HZ, **of)
    found = []
    for k in range(len(counts) // N):
        samples = lively(k)
        samples[:, channel] = counts[k * N : (k + 1) * N]
        ok.step(samples, speed_rad_s=2 * np.pi * 100.0)
        found.append(cause_of(ok.state.causes, channel))
    return found


def test_a_probe_that_rests_at_its_rail_is_open() -> None:
    noise = np.random.default_rng(1).integers(-9, 10, RATE_HZ // 2)
    found = causes_of(30_000 + noise)
    assert found[-1] == ChannelCause.OPEN
    assert found.index(ChannelCause.OPEN) == math.ceil(0.1 * RATE_HZ / N) - 1


def test_a_probe_that_holds_one_value_is_stuck() -> None:
    assert causes_of(np.full(RATE_HZ // 2, 777))[-1] == ChannelCause.STUCK


def swing(mean: float, amplitude: float, rail: int = 25_000) -> np.ndarray:
    """One second of a vibration at 100 Hz with the given mean, cut off at ``rail``."""
    turn = np.arange(RATE_HZ) * 100.0 / RATE_HZ
    wave = mean + amplitude * np.sin(2 * np.pi * turn)
    return np.clip(np.rint(wave), -rail, rail).astype(int)


def test_a_rail_touched_in_step_is_saturated_only_around_a_gap_that_a_shaft_can_have() -> None:
    scale = CHANNELS[0].scale
    reach = {"reach_m": 10_000 * scale}
    assert causes_of(swing(0, 30_000), **reach)[-1] == ChannelCause.SATURATED
    assert causes_of(swing(20_000, 9_000), **reach)[-1] == ChannelCause.BEYOND


def test_an_accelerometer_has_no_gap_to_be_wrong() -> None:
    found = causes_of(swing(0, 32_700, rail=32_700), channel=2, reach_m=1e-9)
    assert found[-1] == ChannelCause.SATURATED


def test_a_gap_beyond_the_range_that_alternates_is_beyond() -> None:
    assert causes_of(swing(28_000, 3_000, rail=32_000))[-1] == ChannelCause.BEYOND


@pytest.mark.parametrize("side", [1, -1])
def test_a_contact_that_drops_a_probe_to_zero_is_intermittent(side: int) -> None:
    lone, lasting = (side * swing(8_000, 1_000) for _ in range(2))
    lone[2_501] = 0
    lasting[2_501:2_601] = 0
    assert set(causes_of(side * swing(8_000, 1_000))) == {ChannelCause.OK}
    for probe in (lone, lasting):
        found = causes_of(probe)
        assert found[2_500 // N - 1] == ChannelCause.OK
        assert found[-1] == ChannelCause.INTERMITTENT


def test_a_step_that_no_shaft_can_make_is_a_contact_a_fast_swing_is_none() -> None:
    fastest = {"fastest_m_s": 800 * CHANNELS[0].scale * RATE_HZ}
    probe = swing(0, 5_000)
    assert causes_of(probe, **fastest)[-1] == ChannelCause.OK
    probe[2_501] += 3_000
    assert causes_of(probe, **fastest)[-1] == ChannelCause.INTERMITTENT
