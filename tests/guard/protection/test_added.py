"""Added measures in the guard: set points, delays, windows, speeds, not-OK channels."""

from __future__ import annotations

from math import pi

import msgspec
import pytest

from firmware_py.config.measure_schema import MeasureConfig
from firmware_py.guard.protection.added import AddedFacts, AddedMeasures
from firmware_py.guard.state import CoreState
from firmware_py.machine import SlowChannel
from firmware_py.records import (
    ArmState,
    GuardState,
    ReadingQuality,
    RigReading,
    RigStatus,
    SlowValue,
)  # fmt: skip

from ..scripted_node import MS, Bench, bench
from .test_voting import at_work, told

DELAY_WITHIN_S = 0.02


def first(b: Bench, name: str) -> float:
    """When an event was told first, s."""
    return next(event.t_ns for event in b.events if event.name == name) * 1e-9


def run_until(b: Bench, name: str, seconds: float) -> None:
    for _ in range(round(seconds * 1000)):
        b.cycle()
        if name in b.names():
            return
    raise AssertionError(f"{name} did not come: {sorted(set(b.names()))}")


def alarms(state: GuardState) -> set[str]:
    return {alarm.name for alarm in state.alarms}


SPEED_LOW = """
[[measure]]
name = "speed_low"
quantity = "speed"
unit = "rpm"
sense = "falling"
judged = "armed"
alert = 5000.0
danger = 4000.0
alert_delay_s = 0.5
danger_delay_s = 0.8
danger_effect = "retreat"
latching = false
"""


def test_speed_low_while_armed() -> None:
    b = at_work(SPEED_LOW)
    b.ramp_to(4500.0)
    b.run(0.7)
    assert "speed_low_alert" in b.names()
    assert "speed_low_danger" not in b.names()
    b.ramp_to(3000.0)
    b.run(1.2)
    state = told(b)
    assert {"speed_low_alert", "speed_low_danger", "protection_retreat"} <= alarms(state)
    assert state.arm_state == ArmState.RECOVERY
    assert b.ask("disarm")[0]
    b.run(0.2)
    assert "speed_low_danger" not in alarms(told(b))
    assert "speed_low_danger_ended" in b.names()


@pytest.mark.parametrize("delay_s", [0.3, 1.0, 3.0])
def test_delay_and_set_point_by_a_ramp_of_the_speed(delay_s: float) -> None:
    text = SPEED_LOW.replace("danger_delay_s = 0.8", f"danger_delay_s = {delay_s}")
    b = at_work(text)
    passed_s = 0.0
    while b.node.speed_rpm > 3000.0:
        b.node.speed_rpm -= 1.0
        b.cycle()
        if not passed_s and b.core.stages.acquire.speed.speed_rad_s * 30 / pi < 4000.0:
            passed_s = b.now_ns * 1e-9
            assert b.node.speed_rpm == pytest.approx(4000.0, abs=0.005 * 12_000.0)
    run_until(b, "speed_low_danger", delay_s + 0.5)
    assert first(b, "speed_low_danger") - passed_s == pytest.approx(delay_s, abs=DELAY_WITHIN_S)


POWER = """
[[measure]]
name = "power"
quantity = "reading"
source = "shaft_power"
unit = "W"
sense = "window"
alert_low = 20.0
alert = 80.0
danger_low = 10.0
danger = 90.0
danger_delay_s = 0.5
danger_effect = "trip"
"""


@pytest.mark.parametrize(("watt", "trips"), [(95.0, True), (5.0, True), (85.0, False)])
def test_a_window_is_left_on_both_sides_and_trips_latched(watt: float, trips: bool) -> None:
    b = at_work(POWER)
    b.node.power_W = watt
    b.run(1.5)
    state = told(b)
    assert "power_alert" in alarms(state)
    assert ("power_danger" in alarms(state)) is trips
    assert (state.arm_state == ArmState.TRIPPED) is trips
    if trips:
        assert not b.ask("reset")[0]
        b.node.power_W = 50.0
        b.run(0.5)
        assert "power_danger" in alarms(told(b)), "latched"
        assert b.ask("reset")[0]
        b.run(0.2)
        assert not {"power_danger", "power_alert"} & alarms(told(b))


def test_a_reading_that_is_away_holds_and_says_nothing() -> None:
    b = at_work(POWER)
    b.node.power_W = 95.0
    b.run(0.15)
    b.tamper = lambda frames: [f for f in frames if f.frame_id == 0x0C0]
    b.run(1.5)
    assert "power_danger" not in b.names()
    assert b.core.stages.added.state.not_ok == ["power"]


ORBIT = """
[[measure]]
name = "smax_de"
quantity = "smax"
unit = "um"
alert = 15.0
danger = 18.0
danger_delay_s = 0.5
alert_delay_s = 0.5
[[measure]]
name = "x_1x"
quantity = "amplitude_1x"
source = "disp_x"
unit = "um"
alert = 20.0
alert_delay_s = 0.2
[[measure]]
name = "slow_roll"
quantity = "peak_to_peak"
source = "disp_y"
unit = "um"
alert = 15.0
alert_delay_s = 0.2
to_rpm = 1500.0
[[measure]]
name = "place"
quantity = "position"
unit = "share"
alert = 0.6
alert_delay_s = 0.2
alert_effect = "authority"
"""


def test_smax_is_capped_by_the_clearance_and_1x_is_seen() -> None:
    b = at_work(ORBIT)
    b.node.amplitude_um = 12.0
    b.run(1.0)
    assert {"x_1x_alert"} <= alarms(told(b))
    assert not {"smax_de_danger", "slow_roll_alert", "place_alert"} & alarms(told(b))
    b.node.amplitude_um = 18.0
    b.run(1.0)
    state = told(b)
    alarm = next(a for a in state.alarms if a.name == "smax_de_danger")
    clearance_um = state.clearance_actual_um
    assert alarm.limit == pytest.approx(
        0.5 * b.config.limits.clearance_share * clearance_um, rel=0.1
    )
    assert alarm.value == pytest.approx(18.0, rel=0.01)


def test_slow_roll_is_judged_below_its_speed_alone() -> None:
    b = at_work(ORBIT)
    b.node.amplitude_um = 9.0
    b.run(1.0)
    assert "slow_roll_alert" not in b.names()
    b.ramp_to(1400.0)
    b.run(0.6)
    assert "slow_roll_alert" in alarms(told(b))
    b.ramp_to(2000.0)
    b.run(0.2)
    assert "slow_roll_alert" not in alarms(told(b))


def test_the_gap_is_held_against_the_clearance_of_this_instant() -> None:
    b = at_work(ORBIT)
    b.node.mean_um = (0.0, -35.0)
    b.run(0.6)
    state = told(b)
    assert ("place_alert" in alarms(state)) == (35.0 / state.clearance_actual_um > 0.6)
    b.node.mean_um = (0.0, -45.0)
    b.run(0.6)
    state = told(b)
    assert "place_alert" in alarms(state)
    assert not state.authority
    alarm = next(a for a in state.alarms if a.name == "place_alert")
    assert alarm.value == pytest.approx(45.0 / state.clearance_actual_um, rel=0.05)


def test_a_channel_that_is_stuck_holds_its_measures() -> None:
    b = at_work(ORBIT)
    b.node.frozen_channel = 0
    b.run(0.6)
    assert {"smax_de", "x_1x", "place"} <= set(b.core.stages.added.state.not_ok)
    b.node.amplitude_um = 18.0
    b.run(0.6)
    assert not {"smax_de_alert", "x_1x_alert"} & set(b.names())


VELOCITY = """
[[measure]]
name = "velocity_de"
quantity = "velocity_rms"
source = "acc_bearing_vertical"
unit = "mm/s"
alert = 4.0
danger = 7.1
danger_delay_s = 0.3
[[measure]]
name = "velocity_nde"
quantity = "velocity_rms"
source = "acc_bearing_horizontal"
unit = "mm/s"
alert = 4.0
danger = 7.1
danger_delay_s = 0.3
[[group]]
name = "casing"
measures = ["velocity_de", "velocity_nde"]
vote = "2oo2"
"""


def test_casing_velocity_votes() -> None:
    b = at_work(VELOCITY)
    b.node.acceleration_m_s2 = 6.0  # 9.5 mm/s at 100 Hz
    b.run(1.5)
    assert b.core.tripped == ["velocity_de_danger", "velocity_nde_danger", "casing_trip"]
    event = next(e for e in b.events if e.name == "velocity_de_danger")
    assert event.value > 7.1
    b.run(0.6)
    alarm = next(a for a in told(b).alarms if a.name == "velocity_de_danger")
    assert alarm.value == pytest.approx(1e3 * 6.0 / (2 * pi * 100.0), rel=0.01)


def test_a_reading_of_the_rig_itself_is_judged_while_it_is_ok() -> None:
    row = MeasureConfig(
        "metal_hot", quantity="reading", source="metal", unit="degC", danger=90.0,
        danger_delay_s=0.5,
    )  # fmt: skip
    metal = SlowChannel("metal", kind="temperature", ok_low=0.0, ok_high=150.0)
    stage = AddedMeasures(bench().replaced(reading=[metal], measure=[row]), [])
    facts = AddedFacts(6000.0, True, False, {}, lambda name: None)

    def told(celsius: float, seconds: float, now_ns: int, quality: int = 0) -> list[str]:
        status, found = RigStatus(0, 0, 0.0, 0.0, 0.0, 0.0), list[str]()
        for k in range(round(seconds * 20)):
            t_ns = now_ns + k * 50 * MS
            values = {"metal": SlowValue(celsius, 0, quality)}
            reading = RigReading(k, t_ns, 0, status, None, values)
            found += [notice.name for notice in stage.step([], [reading], facts, t_ns)]
        return found

    assert told(80.0, 1.0, 1000 * MS) == []
    assert told(95.0, 1.0, 2000 * MS, int(ReadingQuality.FAULT)) == []
    assert not stage.ballot("metal_hot").ok
    assert told(95.0, 1.0, 3000 * MS) == ["metal_hot_danger"]
    assert stage.ballot("metal_hot")[:2] == (True, True)
    assert stage.reset()[0].startswith("still beyond: metal_hot (reading) 95 degC, danger above 90")
    assert stage.set_points.tripped() == ["metal_hot_danger"]


def test_the_state_goes_on_from_a_snapshot_and_old_ones_are_read() -> None:
    b = at_work(VELOCITY)
    b.node.acceleration_m_s2 = 6.0
    b.run(0.4)
    again = Bench(b.config)
    again.core.restore(b.core.snapshot(b.seq, b.now_ns))
    assert again.core.snapshot(1, 1) == b.core.snapshot(1, 1)
    old = msgspec.msgpack.decode(b.core.snapshot(1, 1).state)
    del old["added"]
    state = msgspec.msgpack.decode(msgspec.msgpack.encode(old), type=CoreState)
    again.core.stages.state = state
    assert set(again.core.stages.added.set_points.states) >= {"velocity_de_danger"}
