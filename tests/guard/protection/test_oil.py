"""The oil's own protection: alert, danger with delay that trips and latches, permissive, and timers
that hold."""

import msgspec
import pytest

from firmware_py.guard.plausibility.reading_state import OilEvidence
from firmware_py.guard.protection.oil import OilProtection, OilProtectionState
from firmware_py.records import ArmState

from ..scripted_node import MS, Bench, bench, working

DELAY_S = bench().limits.danger_delay_s


class Alone:
    """The stage in steps of 10 ms."""

    def __init__(self, latched: list[str] | None = None) -> None:
        self.stage, self.now_ns = OilProtection(bench(), latched or []), 10**10

    def run(
        self,
        seconds: float,
        bar: float | None = 1.0,
        outlet_C: float | None = 41.0,
        turning: bool = True,
        whole: bool = True,
    ) -> list[str]:
        told = []
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            told += [
                n.name
                for n in self.stage.step(
                    OilEvidence(bar, whole), OilEvidence(outlet_C, whole), turning, self.now_ns
                )
            ]
        return told


@pytest.mark.parametrize(
    ("bad", "name"),
    [
        ({"bar": 0.2}, "oil_pressure_low"),
        ({"bar": 0.0}, "oil_pressure_low"),
        ({"outlet_C": 71.0}, "oil_outlet_high"),
        ({"outlet_C": 149.0}, "oil_outlet_high"),
    ],
)
def test_danger_trips_after_its_delay_and_stays_until_reset(
    bad: dict[str, float], name: str
) -> None:
    alone = Alone()
    assert alone.run(5.0) == []
    assert alone.run(DELAY_S - 0.1, **bad) == []
    assert f"{name}_danger" in alone.stage.beyond
    assert alone.run(0.2, **bad) == [f"{name}_alert", f"{name}_danger"]
    assert alone.stage.tripped == [f"{name}_danger"]
    assert len(alone.stage.reset()) == 1
    assert alone.run(1.0) == [f"{name}_alert_ended"]
    assert alone.stage.tripped
    assert alone.stage.reset() == []
    assert not alone.stage.tripped


@pytest.mark.parametrize(("edge", "name"), [
    ({"bar": 0.39}, "oil_pressure_low_alert"), ({"outlet_C": 60.5}, "oil_outlet_high_alert"),
    ({"outlet_C": 32.9}, "oil_outlet_low_alert"),
])  # fmt: skip
def test_an_alert_does_not_trip(edge: dict[str, float], name: str) -> None:
    alone = Alone()
    assert alone.run(10.0, **edge) == [name]
    assert alone.stage.tripped == []
    assert [a.name for a in alone.stage.standing()] == [name]
    assert alone.run(1.0) == [f"{name}_ended"]


@pytest.mark.parametrize("bad", [{"bar": 0.1}, {"outlet_C": 80.0}])
def test_a_reading_that_is_not_ok_holds_the_timer(bad: dict[str, float]) -> None:
    """It neither trips while nothing is known, nor puts the trip off for ever by a short fault
    every so often."""
    lost = dict.fromkeys(bad)
    alone = Alone()
    alone.run(0.5 * DELAY_S, **bad)
    assert alone.run(60.0, **lost) == []
    alone.run(0.6 * DELAY_S, **bad)
    assert alone.stage.tripped
    again = Alone()
    for _ in range(12):
        again.run(0.1 * DELAY_S, **bad)
        again.run(0.1, **lost)
    assert again.stage.tripped


def test_low_pressure_before_and_after_what_says_nothing_adds_up() -> None:
    alone = Alone()
    alone.run(1.0)
    alone.run(0.6 * DELAY_S, bar=0.1)
    assert alone.run(30.0, bar=None) == []
    assert alone.run(30.0, bar=1.0, whole=False) == []
    assert "oil_pressure_low_danger" in alone.stage.beyond
    assert "oil_pressure_low_danger" in alone.run(0.5 * DELAY_S, bar=0.1, whole=False)


def bad_now_and_then(b: Bench, seconds: float, **values: float) -> None:
    """A reading that cannot be every 3 s, and for the rest of the time these."""
    for _ in range(round(seconds / 3.0)):
        for name in values:
            setattr(b.node, name, 300.0 if name == "oil_C" else 60.0)
        b.run(0.1)
        for name, value in values.items():
            setattr(b.node, name, value)
        b.run(2.9)


def test_hot_oil_behind_readings_that_cannot_be_now_and_then_trips() -> None:
    b = working()
    b.node.oil_C = 300.0
    b.run(0.1)
    for outlet_C in range(41, 69, 2):
        b.node.oil_C = float(outlet_C)
        b.run(0.2)
    assert not b.core.tripped
    bad_now_and_then(b, 6.0, oil_C=75.5)
    assert b.core.tripped == ["oil_outlet_high_danger"]


def test_a_jump_of_the_outlet_does_not_count_before_oil_can_be_so_hot() -> None:
    b = working()
    b.node.oil_C = 120.0
    b.run(4.5)  # 79 K at 20 K/s, and the delay
    assert not b.core.tripped


def test_low_pressure_behind_readings_and_a_channel_that_are_bad_now_and_then_trips() -> None:
    b = working()
    b.node.pressure_bar = 60.0
    b.node.frozen_channel = 6
    b.run(1.5)
    assert "pressure_unknown" in b.names()
    assert not b.core.tripped
    bad_now_and_then(b, 3.0, pressure_bar=0.1)
    assert b.core.tripped == ["oil_pressure_low_danger"]
    assert not b.ask("arm")[0]


@pytest.mark.parametrize(("low_s", "well_s", "trips"), [
    (0.06, 0.04, True), (0.2, 0.2, True), (0.6 * DELAY_S, 0.4 * DELAY_S, True), (0.04, 0.06, False),
])  # fmt: skip
def test_low_pressure_that_comes_and_goes_trips_where_it_is_there_half_of_the_time(
    low_s: float, well_s: float, trips: bool
) -> None:
    alone, told = Alone(), []
    for _ in range(round(20.0 * DELAY_S / (low_s + well_s))):
        told += alone.run(low_s, bar=0.1) + alone.run(well_s)
    assert ("oil_pressure_low_danger" in told) == trips
    alone.run(1.0 + DELAY_S)
    assert alone.stage.reset() == []
    assert "oil_pressure_low_danger" not in alone.run(0.9 * DELAY_S, bar=0.1)


def test_a_machine_at_rest_may_have_its_pump_off() -> None:
    alone = Alone()
    assert alone.run(10.0, bar=0.0, turning=False) == ["oil_pressure_low_alert"]
    alone.run(DELAY_S + 0.1, bar=0.0)
    assert alone.stage.tripped
    alone.run(0.1, bar=0.0, turning=False)
    assert alone.stage.reset() == []


def test_a_latch_survives_a_restart_and_the_rest_is_left_to_others() -> None:
    assert Alone(["oil_pressure_low_danger", "disp_x_danger"]).stage.tripped == [
        "oil_pressure_low_danger"
    ]
    b = Bench(latched=["oil_pressure_low_danger", "disp_x_danger"])
    b.run(0.5)
    assert sorted(b.core.tripped) == ["disp_x_danger", "oil_pressure_low_danger"]
    assert b.ask("reset") == (True, [])
    assert b.core.tripped == []


def test_a_delay_that_runs_goes_on_after_a_restart_and_does_not_count_the_time_between() -> None:
    alone = Alone()
    alone.run(0.6 * DELAY_S, bar=0.1)
    timers = alone.stage.set_points.timers()
    assert list(timers) == ["oil_pressure_low_danger"]
    again = Alone()
    again.stage.set_points.resume(timers | {"disp_x_danger": 1})
    assert again.run(0.3 * DELAY_S, bar=0.1) == []
    again.run(0.2 * DELAY_S, bar=0.1)
    assert again.stage.tripped == ["oil_pressure_low_danger"]
    assert again.stage.set_points.timers() == {}


def test_a_guard_that_was_held_up_does_not_count_that_time() -> None:
    alone = Alone()
    alone.run(0.1, bar=0.1)
    alone.now_ns += 10 * 10**9
    assert alone.run(0.5 * DELAY_S, bar=0.1) == []


def test_the_state_survives_encoding() -> None:
    alone = Alone()
    alone.run(5.0, bar=0.1)
    state = alone.stage.state
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=OilProtectionState) == state


@pytest.mark.parametrize("channel_bar", [None, 1.0])
def test_lost_pressure_ends_authority_at_once_and_trips_the_machine(
    channel_bar: float | None,
) -> None:
    b = working()
    b.node.pressure_bar, b.node.supply_bar = 0.0, channel_bar
    b.run(0.3)
    state = next(d.state for d in reversed(b.run(0.2)) if d.state)
    assert not state.authority
    assert any(
        "supply pressure 0 bar below" in r and "check pump" in r for r in state.authority_reasons
    )
    b.run(DELAY_S)
    state = next(d.state for d in reversed(b.run(0.2)) if d.state)
    assert state.arm_state == ArmState.TRIPPED
    assert state.trip_request
    assert state.target_clearance_um == b.config.machine.actuator.safe_radial_clearance_um


def test_hot_oil_trips_by_its_own_name() -> None:
    b = working()
    for _ in range(32):
        b.node.oil_C += 1.0
        b.run(0.1)
    b.run(DELAY_S + 0.5)
    assert b.core.tripped == ["oil_outlet_high_danger"]
    assert not b.ask("reset")[0]


@pytest.mark.parametrize(("node", "part"), [
    ({"pressure_bar": 0.3}, "supply pressure 0.3 bar below 0.4 "
                            "(limits.oil_pressure_low_alert_bar)"),
    ({"oil_C": 62.0}, "oil outlet 62 degC above 60 (limits.oil_outlet_high_alert_C)"),
])  # fmt: skip
def test_the_oil_is_a_permissive(node: dict[str, float], part: str) -> None:
    b = Bench()
    for name, value in node.items():
        setattr(b.node, name, value)
    b.run(1.5)
    b.ask("mode", mode=2)
    accepted, reasons = b.ask("arm")
    assert not accepted
    assert any(part in reason for reason in reasons)


def test_without_limits_they_follow_feed_and_oil() -> None:
    config = bench()
    bare = config.replaced(
        limits=msgspec.structs.replace(
            config.limits,
            oil_pressure_low_alert_bar=0.0,
            oil_pressure_low_danger_bar=0.0,
            oil_outlet_high_alert_C=0.0,
            oil_outlet_high_danger_C=0.0,
        ),
    )
    assert bare.oil_pressure_limits_bar == config.oil_pressure_limits_bar == (0.4, 0.25)
    assert bare.oil_outlet_limits_C == config.oil_outlet_limits_C == (60.0, 70.0)


@pytest.mark.parametrize("ran_before", [False, True])
def test_a_pump_that_is_off_beside_a_standing_shaft_does_not_trip(ran_before: bool) -> None:
    """Also before the mark has been away long enough to call it standstill."""
    b = working() if ran_before else Bench()
    if ran_before:
        b.ramp_to(0.0)
        b.run(0.3)
    b.node.speed_rpm = 0.0
    b.node.pressure_bar = b.node.supply_bar = 0.0
    b.run(8.0 + DELAY_S)
    assert b.core.tripped == []
    assert b.ask("reset") == (True, [])


def test_the_pressure_is_judged_while_the_speed_is_unknown() -> None:
    b = working()
    b.node.mark_valid = False
    b.node.pressure_bar = b.node.supply_bar = 0.0
    b.run(DELAY_S + 0.5)
    assert b.core.tripped == ["oil_pressure_low_danger"]
