"""A machine at rest: the pump may be off, and nobody calls that a failing machine."""

from copy import deepcopy
from functools import cache

import pytest

from firmware_py.guard import report

from ..scripted_node import Bench


def at_rest(how: str) -> Bench:
    """Stopped just now, or switched on while it stands."""
    if how == "stopped":
        return deepcopy(_stopped())
    b = Bench()
    b.node.speed_rpm = 0.0
    return b


@cache
def _stopped() -> Bench:
    b = Bench()
    b.run(1.5)
    b.ramp_to(0.0, 2000.0)
    b.cycles.clear()
    return b


def standing(b: Bench) -> dict[str, str]:
    return {alarm.name: alarm.text for alarm in report.standing(b.core.stages)}


@pytest.mark.parametrize("how", ["stopped", "switched on"])
@pytest.mark.parametrize("delay_s", [0.0, 1.0])
def test_a_pump_switched_off_at_rest_trips_nothing_and_is_one_alert_that_says_so(
    how: str, delay_s: float
) -> None:
    b = at_rest(how)
    b.run(delay_s)
    b.node.pressure_bar = 0.0
    b.events.clear()
    b.run(9.0)  # a shaft is known to stand after 2 pi s without a mark
    assert not b.core.tripped
    assert list(standing(b)) == ["oil_pressure_low_alert"]
    assert "the shaft stands" in standing(b)["oil_pressure_low_alert"]
    assert b.names().count("oil_pressure_low_alert") == 1


def test_a_pump_that_fails_while_the_shaft_turns_or_the_mark_is_away_trips() -> None:
    for speed_rpm, valid in ((6000.0, True), (400.0, True), (6000.0, False)):
        b = Bench()
        b.run(1.5)
        b.ramp_to(speed_rpm, 2000.0)
        b.run(0.5)
        b.node.mark_valid = valid
        b.node.pressure_bar = 0.0
        b.run(1.5)
        assert b.core.tripped == ["oil_pressure_low_danger"]


def test_a_mark_that_goes_away_at_rest_ends_the_knowledge_that_the_shaft_stands() -> None:
    b = at_rest("stopped")
    b.run(1.0)
    b.node.mark_valid = False
    b.node.speed_rpm, b.node.pressure_bar = 6000.0, 0.0
    b.run(1.5)
    assert b.core.tripped == ["oil_pressure_low_danger"]


def test_pressure_that_does_not_follow_counts_once_the_shaft_turns_or_the_device_commands() -> None:
    b = at_rest("stopped")
    b.node.pressure_bar = 0.6  # no low pressure
    b.run(5.0)
    assert "pressure_not_following" not in standing(b)
    assert b.ask("mode", mode=1)[0]
    assert b.ask("arm")[0]
    b.run(5.0)
    assert "pressure_not_following" in standing(b)
    turning = at_rest("stopped")
    turning.node.pressure_bar = 0.6
    turning.run(0.5)
    turning.ramp_to(2000.0, 2000.0)
    turning.run(5.0)
    assert "pressure_not_following" in standing(turning)


def test_an_alarm_of_pressure_that_does_not_follow_ends_at_rest_with_its_cause() -> None:
    b = Bench()
    b.run(1.5)
    b.node.pressure_bar = 0.6
    b.run(5.0)
    b.ramp_to(0.0, 2000.0)
    b.run(3.0)
    assert "pressure_not_following" in standing(b)
    b.node.pressure_bar = b.node.target_bar
    b.run(2.0)
    assert "pressure_not_following" not in standing(b)
