"""The following error by itself: a band, a tolerance, and what makes an error an alarm."""

from collections.abc import Callable

import msgspec
import pytest

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.supervision import ActuatorReadings, NodeReports, Supervision
from firmware_py.guard.supervision.following import AGAIN_NS, Following, Quantity
from firmware_py.guard.supervision.node_watch import Refusals

from ..scripted_node import SESSION, bench

S = 1_000_000_000
STEP_NS = 50_000_000
START_UM, TOLERANCE_UM, RATE_UM_S = 55.0, 2.0, 50.0
QUANTITY = Quantity(
    "clearance_not_following",
    "um",
    "measured radial clearance",
    TOLERANCE_UM,
    RATE_UM_S,
    delay_ns=200_000_000,
    lasting_ns=S,
)


class Axis:
    """One actuator, read every 50 ms."""

    def __init__(self) -> None:
        self.following = Following(QUANTITY)
        self.now_ns = 10 * S
        self.told: list[Notice] = []

    def run(
        self,
        seconds: float,
        measured: float | Callable[[float], float],
        target: float = START_UM,
        *,
        excused: bool = False,
    ) -> list[str]:
        """Names of what is told; ``measured`` may be a function of the time since now, s."""
        begun_ns, seen = self.now_ns, len(self.told)
        for _ in range(round(seconds * S / STEP_NS)):
            value = measured if isinstance(measured, float) else measured(self._since(begun_ns))
            self.following.target(target, self.now_ns)
            self.told += self.following.step(value, target, self.now_ns, excused=excused)
            self.now_ns += STEP_NS
        return [notice.name for notice in self.told[seen:]]

    def _since(self, begun_ns: int) -> float:
        return (self.now_ns - begun_ns) / S

    @property
    def stands(self) -> bool:
        return self.following.state.alarm.standing


BEGUN, ENDED = ["clearance_not_following"], ["clearance_not_following_ended"]


@pytest.mark.parametrize("target", [90.0, 42.0])
@pytest.mark.parametrize("share", [0.95, 1.0, 3.0])
def test_an_actuator_of_the_declared_rate_or_faster_follows(target: float, share: float) -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    way = target - START_UM

    def moving(t_s: float) -> float:
        return START_UM + max(-abs(way), min(abs(way), share * RATE_UM_S * t_s)) * (
            1.0 if way > 0 else -1.0
        )

    assert axis.run(3.0, moving, target) == []


def test_where_it_stood_before_the_first_reading_is_unknown() -> None:
    axis = Axis()
    assert axis.run(3.0, lambda t_s: max(START_UM, 100.0 - RATE_UM_S * t_s)) == []


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("off_um", "after_s", "why"),
    [
        (1.9, None, ""),
        (5.0, 1.0, "for 1.0 s"),
        (TOLERANCE_UM * 4.0 + 0.1, 0.5, "by more than 4 tolerances for 0.5 s"),
    ],
)
def test_an_error_is_an_alarm_when_it_lasts_and_sooner_when_it_is_gross(
    side: int, off_um: float, after_s: float | None, why: str
) -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    if after_s is None:
        assert axis.run(5.0, START_UM + side * off_um) == []
        return
    assert axis.run(after_s, START_UM + side * off_um) == []
    assert axis.run(2.0, START_UM + side * off_um) == BEGUN, "once"
    assert why in axis.told[0].text
    assert (axis.told[0].value, axis.told[0].limit) == (START_UM + side * off_um, START_UM)


def test_a_gross_error_that_shrinks_for_a_moment_goes_on() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    assert axis.run(0.4, START_UM + 9.0) == []
    assert axis.run(0.1, START_UM + 7.0) == []
    assert axis.run(0.4, START_UM + 9.0) == BEGUN
    assert "by more than 4 tolerances" in axis.told[0].text


def test_a_gross_reading_of_three_is_no_gross_error() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    for _ in range(20):
        assert axis.run(0.05, START_UM + 9.0) == []
        assert axis.run(0.1, START_UM) == []


def test_a_slow_actuator_is_told_by_its_rate() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    assert axis.run(2.0, lambda t_s: START_UM + 0.5 * RATE_UM_S * t_s, 120.0) == BEGUN
    assert "% of the declared rate" in axis.told[0].text


def test_three_short_errors_within_a_minute_are_an_alarm_single_readings_are_none() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    for _ in range(9):
        assert axis.run(0.05, START_UM + 4.0) == []
        assert axis.run(1.0, START_UM) == []
    for _ in range(2):
        assert axis.run(0.1, START_UM + 4.0) == []
        assert axis.run(1.0, START_UM) == []
    axis.run(0.1, START_UM - 4.0)
    assert axis.run(0.05, START_UM) == BEGUN
    assert "3 times within 60 s" in axis.told[-1].text


def test_short_errors_are_forgotten_after_a_minute() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    for _ in range(5):
        axis.run(0.1, START_UM + 4.0)
        assert axis.run(31.0, START_UM) == []


def test_an_error_that_changes_its_side_is_two_short_ones() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    for side in (1, -1, 1):
        axis.run(0.1, START_UM + side * 4.0)
    assert axis.run(0.05, START_UM) == BEGUN


def test_an_alarm_ends_after_a_second_inside_and_the_second_one_stands_until_reset() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    axis.run(1.5, START_UM + 5.0)
    assert axis.run(0.9, START_UM) == []
    assert axis.run(0.2, START_UM) == ENDED
    assert axis.run(1.5, START_UM + 5.0) == BEGUN
    assert "until `reset`" in axis.told[-1].text
    assert axis.run(20.0, START_UM) == []
    assert axis.stands
    axis.following.reset()
    assert axis.run(0.1, START_UM) == ENDED


def test_a_second_alarm_long_after_the_first_ends_by_itself() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    axis.run(1.5, START_UM + 5.0)
    axis.run(2.0, START_UM)
    axis.now_ns += AGAIN_NS
    axis.run(1.0, START_UM)
    assert axis.run(1.5, START_UM + 5.0) == BEGUN
    assert axis.run(1.5, START_UM) == ENDED


def test_a_standing_alarm_says_its_present_figures() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    axis.run(1.5, START_UM + 5.0)
    axis.run(0.05, START_UM + 6.0)
    assert axis.following.state.alarm.text.endswith("now 61 um, commanded 55")


def test_an_error_that_is_excused_counts_for_nothing_but_holds_an_alarm() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    assert axis.run(0.6, START_UM + 5.0) == []
    assert axis.run(5.0, START_UM + 20.0, excused=True) == []
    assert axis.run(0.9, START_UM + 5.0) == [], "counted from the end of the excuse"
    assert axis.run(0.3, START_UM + 5.0) == BEGUN
    assert axis.run(5.0, START_UM + 5.0, excused=True) == []
    assert axis.run(1.1, START_UM, excused=True) == ENDED


def test_a_time_without_readings_counts_neither_for_an_error_nor_against_it() -> None:
    axis = Axis()
    axis.run(1.0, START_UM)
    for _ in range(2):
        assert axis.run(0.5, START_UM + 5.0) == []
        axis.now_ns += 30 * S
    assert axis.run(0.5, START_UM + 5.0) == BEGUN


# ------------------------------------------------------------------ both quantities together


def heard(clearance_um: float | None, bar: float | None, **more: object) -> NodeReports:
    """A reading without any account of the node itself."""
    facts: dict[str, object] = {"states": [], "restarted": False, "node": None, "info": None,
                                "tick_us": None, "two_senders": []}  # fmt: skip
    measured = ActuatorReadings(clearance_um, bar)
    return NodeReports(measured=measured, **(facts | more))  # type: ignore[arg-type]


def supervise(measured: NodeReports, lag_s: float = 0.0) -> list[str]:
    """Two seconds where the device commands nothing; a lag of the actuator lets it be late."""
    config = bench()
    actuator = config.machine.actuator
    if lag_s:
        actuator = msgspec.structs.replace(actuator, time_constant_s=lag_s)
        machine = msgspec.structs.replace(config.machine, actuator=actuator)
        config = msgspec.structs.replace(config, machine=machine)
    supervision, told = Supervision(config, SESSION), list[str]()
    boot = (actuator.safe_radial_clearance_um, actuator.safe_pressure_bar)
    for step in range(200):
        good = heard(*boot)
        told += [n.name for n in supervision.step(good if step < 20 else measured, step * STEP_NS)]
    return told


BOOT_UM, BOOT_BAR = (
    bench().machine.actuator.safe_radial_clearance_um,
    bench().machine.actuator.safe_pressure_bar,
)


@pytest.mark.parametrize("lag_s", [0.0, 1.0])
def test_the_quantity_that_does_not_follow_is_named_whatever_the_lag(lag_s: float) -> None:
    assert supervise(heard(BOOT_UM, BOOT_BAR), lag_s) == []
    assert supervise(heard(BOOT_UM + 50.0, BOOT_BAR), lag_s) == ["clearance_not_following"]
    assert supervise(heard(BOOT_UM, BOOT_BAR + 1.0), lag_s) == ["pressure_not_following"]


def test_a_reading_that_is_not_ok_is_not_judged_here() -> None:
    assert supervise(heard(None, BOOT_BAR)) == []
    assert supervise(heard(BOOT_UM + 50.0, None)) == ["clearance_not_following"]


def test_a_pump_that_is_off_beside_a_resting_shaft_is_excused_a_clearance_is_not() -> None:
    assert supervise(heard(BOOT_UM, 0.0, resting=True)) == []
    assert supervise(heard(BOOT_UM + 50.0, 0.0, resting=True)) == ["clearance_not_following"]


def test_two_senders_are_told_once_named_and_their_end_too() -> None:
    supervision = Supervision(bench(), SESSION)
    both = heard(None, None, two_senders=["SAMPLES", "NODE_INFO"])
    begun = supervision.step(both, 0)
    assert [n.name for n in begun] == ["two_senders"]
    assert "SAMPLES, NODE_INFO" in begun[0].text
    assert supervision.step(both, S) == []
    assert [n.name for n in supervision.step(heard(None, None), 2 * S)] == ["two_senders_ended"]
    assert supervision.standing() == []


def test_a_node_that_starts_again_has_no_refusals_to_explain() -> None:
    supervision = Supervision(bench(), SESSION)
    supervision.state.node.refusals.append(Refusals(0, (9, 0, 0, 0)))
    supervision.step(heard(None, None, restarted=True), 0)
    assert supervision.state.node.refusals == []
