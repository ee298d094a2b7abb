import numpy as np
import pytest

from firmware_py.acquire.clock_map import DRIFT_MAX_PPM, SETTLE_US, ClockMap, unwrap

FRAME_US = 600


@pytest.mark.parametrize("near", [0, 5, 2**31, 2**32 - 1, 2**32, 7 * 2**32 + 123])
@pytest.mark.parametrize("offset", [-(2**31), -5, -1, 0, 1, 5, 2**31 - 1])
def test_unwrap_finds_the_nearest_tick(near: int, offset: int) -> None:
    assert unwrap((near + offset) & 0xFFFFFFFF, near) == near + offset


@pytest.mark.parametrize("drift_ppm", [-150, -50, 0, 50, 150])
def test_maps_within_a_hundred_microseconds_under_drift_and_jitter(drift_ppm: int) -> None:
    rng = np.random.default_rng(1)
    clock = ClockMap()
    worst = 0
    for k in range(1, 20_000):
        tick = 10**9 + k * FRAME_US
        true_ns = 5 * 10**15 + k * FRAME_US * (1000 - drift_ppm * 1e-3)
        clock.observe(tick, int(true_ns) + 50_000 + int(rng.exponential(300_000)))
        if k > 2000:
            worst = max(worst, abs(clock.host_ns(tick) - int(true_ns) - 50_000))
    assert worst < 100_000


def test_a_link_that_turns_late_is_seen_as_late_not_as_a_slow_clock() -> None:
    clock = ClockMap()
    for k in range(5000):
        clock.observe(k * FRAME_US, k * FRAME_US * 1000)
    for k in range(5000, 5000 + 1667 * 10):
        clock.observe(k * FRAME_US, k * FRAME_US * 1000 + 200_000_000)
    age_ns = k * FRAME_US * 1000 + 200_000_000 - clock.host_ns(k * FRAME_US)
    assert age_ns >= 200_000_000 - 10 * 1_000_000_000 * DRIFT_MAX_PPM // 1_000_000 - 1_000_000


def test_a_quicker_frame_lowers_the_envelope_at_once() -> None:
    clock = ClockMap()
    clock.observe(0, 5_000_000)
    clock.observe(FRAME_US, FRAME_US * 1000 + 1_000)
    assert clock.host_ns(FRAME_US) == FRAME_US * 1000 + 1_000


def test_settles_after_its_time_on_both_clocks_and_anew_after_a_reset() -> None:
    clock = ClockMap()
    clock.observe(0, 0)
    clock.observe(SETTLE_US - 1, SETTLE_US * 1000)
    assert not clock.settled
    clock.observe(SETTLE_US, SETTLE_US * 1000)
    assert clock.settled
    clock.reset()
    assert not clock.settled


def test_a_burst_of_old_frames_does_not_settle_the_map() -> None:
    clock = ClockMap()
    for k in range(3 * SETTLE_US // FRAME_US):
        clock.observe(k * FRAME_US, k * 1000)
    assert not clock.settled
    assert clock.ahead_ns == 0


@pytest.mark.parametrize("frames", [1, 10, 1000])
def test_a_node_clock_that_ran_on_while_the_host_stood_is_ahead(frames: int) -> None:
    """At once (its frames lost), or in a burst of the frames that waited."""
    clock = ClockMap()
    for k in range(5000):
        clock.observe(k * FRAME_US, k * FRAME_US * 1000)
    for k in range(1, frames + 1):
        clock.observe(5000 * FRAME_US + 2_000_000 * k // frames, 5000 * FRAME_US * 1000)
    assert clock.ahead_ns == pytest.approx(2e9, rel=1e-3)


@pytest.mark.parametrize("drift_ppm", [-190, 190])
def test_drift_and_lateness_are_never_ahead(drift_ppm: int) -> None:
    clock = ClockMap()
    for k in range(100_000):
        late_ns = 50_000_000 if 20_000 < k < 30_000 else k % 7 * 100_000
        clock.observe(
            k * FRAME_US, k * FRAME_US * 1000 + k * FRAME_US * drift_ppm // 1000 + late_ns
        )
    assert clock.ahead_ns < 5_000_000, "the envelope creeps up while frames are late"
