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
