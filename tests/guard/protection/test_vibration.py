from math import pi, sqrt

import msgspec
import numpy as np
import pytest

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import QUIET_NS, AlarmState
from firmware_py.guard.measurement.motion import MotionMeter
from firmware_py.guard.protection.vibration import Protection, zone
from firmware_py.records import Block, Quality, Severity

from ..scripted_node import bench

PERIOD_US = 200
N = 30


class Source:
    """Blocks with an exact orbit, one after the other."""

    def __init__(self, rpm: float = 6000.0) -> None:
        self.rpm = rpm
        self.amplitude_um = 5.0
        self.rms = 1.0
        self.ok = 0xFF
        self.seq = 0

    def block(self, quality: int = 0) -> Block:
        n = np.arange(self.seq * N, self.seq * N + N)
        phase = self.rpm * pi / 30 * n * PERIOD_US * 1e-6
        rows = np.zeros((N, 8), np.int16)
        rows[:, 0] = np.round(self.amplitude_um * 100 * np.cos(phase))
        rows[:, 1] = np.round(self.amplitude_um * 100 * np.sin(phase))
        rows[:, 2:5] = np.round(self.rms * sqrt(2) * 100 * np.cos(phase))[:, None] + 300
        block = Block(
            self.seq,
            self.seq * N * PERIOD_US * 1000,
            PERIOD_US * 1000,
            self.seq * N * PERIOD_US,
            PERIOD_US,
            quality,
            self.ok,
            self.rpm * pi / 30,
            0,
            [],
            rows.tobytes(),
        )
        self.seq += 1
        return block


def with_delays(seconds: float) -> Config:
    config = bench()
    return config.replaced(
        limits=msgspec.structs.replace(
            config.limits, alert_delay_s=seconds, danger_delay_s=seconds
        ),
    )


def run(
    protection: Protection, source: Source, seconds: float, clearance_um: float = 140.0
) -> list[str]:
    names: list[str] = []
    for _ in range(round(seconds / (N * PERIOD_US * 1e-6))):
        names += [notice.name for notice in protection.step([source.block()], clearance_um)]
    return names


# ------------------------------------------------------------------ statistics


@pytest.mark.parametrize("rpm", [400.0, 1500.0, 6000.0, 12000.0])
def test_peak_to_peak_spans_a_full_turn_and_says_when_it_does_not(rpm: float) -> None:
    meter, source = MotionMeter(bench()), Source(rpm)
    motions = [meter.step(source.block()) for _ in range(60)]
    whole = [m for m in motions if m.complete]
    assert whole
    assert not motions[0].complete
    assert all(m.peak_to_peak_um == pytest.approx((10.0, 10.0), rel=0.02) for m in whole)
    covered_s = (len(motions) - len(whole) + 1) * N * PERIOD_US * 1e-6
    assert covered_s >= max(60.0 / rpm, 0.1)


def test_rms_is_that_of_the_alternating_part() -> None:
    meter, source = MotionMeter(bench()), Source()
    source.rms = 12.0
    motion = [meter.step(source.block()) for _ in range(40)][-1]
    assert motion.rms_m_s2 == pytest.approx((12.0, 12.0, 12.0), rel=0.02)


def test_the_window_is_exactly_what_a_direct_calculation_gives() -> None:
    meter, source = MotionMeter(bench()), Source(3000.0)
    blocks = [source.block() for _ in range(40)]
    motion = [meter.step(block) for block in blocks][-1]
    rows = np.concatenate(
        [np.frombuffer(b.samples, "<i2").reshape(-1, 8) for b in blocks[-len(meter.window) :]]
    )
    assert motion.peak_to_peak_um[0] == pytest.approx(
        np.ptp(rows[:, 0].astype(int)) * 0.01, rel=1e-12
    )
    assert motion.rms_m_s2[1] == pytest.approx(np.std(rows[:, 3].astype(float)) * 0.01, rel=1e-9)


def test_probe_angles_give_the_position_in_x_and_y() -> None:
    meter, source = MotionMeter(bench()), Source()
    x_um, y_um = 12.0, -30.0
    block = source.block()
    rows = np.frombuffer(block.samples, "<i2").reshape(-1, 8).copy()
    rows[:, 0], rows[:, 1] = (
        round((x_um + y_um) / sqrt(2) * 100),
        round((y_um - x_um) / sqrt(2) * 100),
    )
    motion = meter.step(msgspec.structs.replace(block, samples=rows.tobytes()))
    assert (motion.mean_x_m * 1e6, motion.mean_y_m * 1e6) == pytest.approx((x_um, y_um), abs=0.02)


def test_after_a_gap_the_window_is_whole_only_after_another_turn_but_forgets_nothing() -> None:
    meter, source = MotionMeter(bench()), Source()
    source.rms = 12.0
    for _ in range(30):
        meter.step(source.block())
    motions = [meter.step(source.block(Quality.GAP_BEFORE * (k == 0))) for k in range(17)]
    assert [m.complete for m in motions] == [False] * 16 + [True]
    assert all(m.rms_m_s2[0] == pytest.approx(12.0, rel=0.05) for m in motions)


def test_a_block_that_is_not_to_be_judged_leaves_its_channel_out_alone() -> None:
    meter, source = MotionMeter(bench()), Source()
    for _ in range(30):
        meter.step(source.block())
    source.amplitude_um, source.rms = 50.0, 50.0
    motion = meter.step(msgspec.structs.replace(source.block(), unusable=0b01001))
    assert motion.peak_to_peak_um[0] == pytest.approx(10.0, rel=0.1)
    assert motion.peak_to_peak_um[1] > 50.0
    assert motion.rms_m_s2[1] == pytest.approx(1.0, rel=0.1)
    assert motion.rms_m_s2[0] > 5.0
    assert motion.whole == (False, True, True, False, True)
    assert not motion.complete


def test_what_lies_too_far_back_is_forgotten() -> None:
    meter, source = MotionMeter(bench()), Source()
    source.amplitude_um = 50.0
    for _ in range(30):
        meter.step(source.block())
    source.amplitude_um, source.seq = 5.0, source.seq + 60
    assert meter.step(source.block(Quality.GAP_BEFORE)).peak_to_peak_um[0] < 11.0


def test_nothing_to_judge_is_no_vibration() -> None:
    meter, source = MotionMeter(bench()), Source()
    motion = meter.step(msgspec.structs.replace(source.block(), unusable=0xFF))
    assert motion.peak_to_peak_um == (0.0, 0.0)
    assert motion.rms_m_s2 == (0.0, 0.0, 0.0)
    assert not any(motion.whole)


# ------------------------------------------------------------------ one alarm


DELAY_NS = 1000


def judge(alarm: AlarmState, value: float, t_ns: int, complete: bool = True) -> bool:
    return alarm.judge(value, 100.0, t_ns, delay_ns=DELAY_NS, hysteresis=0.05, complete=complete)


@pytest.mark.parametrize(
    "value",
    [*np.arange(94.0, 106.0, 0.25), float(np.nextafter(100, 0)), float(np.nextafter(100, 200))],
)
def test_the_limit_is_exact(value: float) -> None:
    alarm = AlarmState("x", int(Severity.DANGER), True)
    judge(alarm, value, 0)
    judge(alarm, value, DELAY_NS)
    assert alarm.standing == (value > 100.0)


@pytest.mark.parametrize("t_ns", [0, 1, DELAY_NS - 1, DELAY_NS, DELAY_NS + 1])
def test_the_delay_is_exact(t_ns: int) -> None:
    alarm = AlarmState("x", int(Severity.DANGER), True)
    judge(alarm, 101.0, 0)
    assert judge(alarm, 101.0, t_ns) == (t_ns >= DELAY_NS)


@pytest.mark.parametrize("value", [94.0, 94.99, 95.0, 95.01, 99.0])
def test_only_a_return_below_the_hysteresis_starts_the_delay_anew(value: float) -> None:
    alarm = AlarmState("x", int(Severity.ALERT), False)
    judge(alarm, 101.0, 0)
    judge(alarm, value, DELAY_NS - 1)
    judge(alarm, 101.0, DELAY_NS)
    assert alarm.standing == (value > 95.0)


def test_alert_leaves_and_danger_stays_until_reset() -> None:
    for latching in (False, True):
        alarm = AlarmState("x", int(Severity.DANGER), latching)
        judge(alarm, 101.0, 0)
        judge(alarm, 101.0, DELAY_NS)
        assert not alarm.reset()
        judge(alarm, 10.0, DELAY_NS + 1)
        assert alarm.standing == latching
        assert alarm.reset()
        assert not alarm.standing


def test_part_of_a_turn_may_raise_an_alarm_but_not_clear_it() -> None:
    alarm = AlarmState("x", int(Severity.ALERT), False)
    judge(alarm, 101.0, 0, complete=False)
    judge(alarm, 1.0, 400, complete=False)
    judge(alarm, 101.0, 1000, complete=False)
    assert not alarm.standing
    assert judge(alarm, 101.0, 1400, complete=False)


@pytest.mark.parametrize("held_ns", [1, DELAY_NS, 100 * DELAY_NS, -DELAY_NS])
@pytest.mark.parametrize("before_ns", [0, 1, DELAY_NS - 1])
def test_the_timer_holds_during_bad_quality(before_ns: int, held_ns: int) -> None:
    """Neither nearer nor further away, however long it lasts, and if the clock steps back."""
    alarm = AlarmState("x", int(Severity.DANGER), True)
    judge(alarm, 101.0, 0)
    judge(alarm, 101.0, before_ns)
    t_ns = before_ns + held_ns
    alarm.hold(t_ns)
    assert not judge(alarm, 101.0, t_ns + DELAY_NS - before_ns - 1)
    assert judge(alarm, 101.0, t_ns + DELAY_NS - before_ns)


def test_a_hold_leaves_what_stands_and_what_is_quiet_as_they_are() -> None:
    for latching in (False, True):
        alarm = AlarmState("x", int(Severity.DANGER), latching)
        alarm.hold(5)
        assert alarm.over_ns == QUIET_NS
        judge(alarm, 101.0, 10)
        judge(alarm, 101.0, 10 + DELAY_NS)
        alarm.hold(20 + DELAY_NS)
        assert alarm.standing
        assert not alarm.reset()


# ------------------------------------------------------------------ the whole stage


@pytest.mark.parametrize("clearance_um", [42.0, 50.0, 80.0, 139.0, 140.0, 141.0, 160.0])
def test_set_points_are_capped_by_the_share_of_the_clearance(clearance_um: float) -> None:
    alert, danger = Protection(bench(), []).set_points_um(clearance_um)
    assert danger == pytest.approx(min(70.0, 0.5 * clearance_um))
    assert alert == pytest.approx(45.0 / 70.0 * danger)


@pytest.mark.parametrize("peak_to_peak_um", [20.0, 24.8, 25.2, 30.0])
def test_danger_at_the_capped_set_point_after_the_delay(peak_to_peak_um: float) -> None:
    protection, source = Protection(bench(), []), Source()
    source.amplitude_um = peak_to_peak_um / 2
    names = run(protection, source, 0.9, clearance_um=50.0)
    assert not names
    run(protection, source, 0.3, clearance_um=50.0)
    assert bool(protection.tripped) == (peak_to_peak_um > 25.0)


@pytest.mark.parametrize(
    ("rms", "alert", "danger"), [(39.0, False, False), (41.0, True, False), (81.0, True, True)]
)
def test_acceleration_limits(rms: float, alert: bool, danger: bool) -> None:
    protection, source = Protection(with_delays(0.0), []), Source()
    source.rms = rms
    names = run(protection, source, 0.5)
    assert ("acc_motor_alert" in names) == alert
    assert ("acc_motor_danger" in names) == danger


def test_a_channel_that_is_not_ok_alarms_and_defeats_its_own_trip_only() -> None:
    protection, source = Protection(with_delays(0.1), []), Source()
    source.amplitude_um, source.ok = 60.0, 0xFE
    names = run(protection, source, 1.0)
    assert "disp_x_not_ok" in names
    assert protection.tripped == ["disp_y_danger"]
    assert not protection.displacement_ok
    source.ok = 0xFF
    assert "disp_x_ok" in run(protection, source, 0.05)


def test_trips_of_an_earlier_run_stand_until_reset() -> None:
    protection = Protection(bench(), ["disp_x_danger"])
    assert protection.tripped == ["disp_x_danger"]
    assert protection.reset() == []
    assert protection.tripped == []


def test_reset_is_refused_while_the_cause_is_there() -> None:
    protection, source = Protection(with_delays(0.0), []), Source()
    source.amplitude_um = 60.0
    run(protection, source, 0.3)
    reasons = protection.reset()
    assert len(reasons) == 2
    assert "disp_x_danger still exceeded" in reasons[0]
    source.amplitude_um = 5.0
    run(protection, source, 0.3)
    assert protection.reset() == []


@pytest.mark.parametrize(
    ("p2p", "letter"),
    [(61.9, "A"), (62.0, "B"), (116.1, "B"), (116.2, "C"), (170.4, "C"), (170.5, "D")],
)
def test_zones_at_6000_rpm(p2p: float, letter: str) -> None:
    assert zone(p2p, 6000.0) == letter


def test_no_zone_at_standstill() -> None:
    assert zone(10.0, 0.0) == ""
