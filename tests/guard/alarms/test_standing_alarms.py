"""What stands is in the alarm list with its cause, and what flutters does not bury the event
list."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from firmware_py.records import Cycle, DeviceHeartbeat, GuardState

from ..scripted_node import MS, Bench, armed, warmed_up, working

BUS_OFF = "the CAN controller is bus-off; check cable"


def alarms(b: Bench) -> dict[str, str]:
    """Names and texts of the next published list."""
    state: GuardState = next(d.state for d in iter(b.cycle, None) if d.state)
    assert len({alarm.name for alarm in state.alarms}) == len(state.alarms), (
        "one alarm of each name"
    )
    return {alarm.name: alarm.text for alarm in state.alarms}


def test_a_healthy_working_machine_has_no_alarm() -> None:
    assert alarms(working()) == {}


@pytest.mark.parametrize(("up", "name"), [(False, "link_down"), (True, "link_fault")])
def test_a_sick_link_is_told_in_event_alarm_and_refusal_and_so_is_its_recovery(
    up: bool, name: str
) -> None:
    b = working()
    b.link_up, b.link_fault = up, BUS_OFF
    b.run(0.3)
    found = alarms(b)
    assert BUS_OFF in found["link_fault"]
    assert name in found
    assert [event.text for event in b.events if event.name == "link_fault"] == [BUS_OFF]
    if not up:
        assert any(BUS_OFF in reason for reason in b.ask("arm")[1])
        assert any(BUS_OFF in event.text for event in b.events if event.name == "link_lost")
    b.link_up, b.link_fault = True, ""
    b.run(3.0)
    assert "link_fault" not in alarms(b)
    assert "link_well" in b.names()


def test_no_samples_is_an_alarm_at_once_and_over_with_the_samples() -> None:
    b = working()
    b.node.running = False
    b.run(0.2)
    assert "samples_stale" in alarms(b)
    b.node.running = True
    b.run(3.0)
    assert "samples_stale" not in alarms(b)


def test_authority_that_was_lost_stands_until_it_is_back() -> None:
    b = working()
    b.brain = False
    b.run(0.2)
    assert "brain is not connected" in alarms(b)["authority_lost"]
    b.brain = True
    b.run(5.0)
    assert "authority_lost" not in alarms(b)


def heartbeat_of_another(b: Bench, n: int) -> None:
    b.extra = [
        b.node.codec.encode(DeviceHeartbeat(n & 0xFFFF, 0x9999, 0, 0, True, False), b.now_ns)
    ]


def stall(b: Bench, n: int) -> None:
    b.now_ns += 200 * MS


def link_flutter(b: Bench, n: int) -> None:
    b.link_up = not b.link_up


def fault_flutter(b: Bench, n: int) -> None:
    b.link_fault = "" if b.link_fault else BUS_OFF


def mark_flutter(b: Bench, n: int) -> None:
    b.node.mark_valid = not b.node.mark_valid


def brain_flutter(b: Bench, n: int) -> None:
    b.brain = not b.brain


@pytest.mark.parametrize(
    "act", [heartbeat_of_another, stall, link_flutter, fault_flutter, mark_flutter, brain_flutter]
)
def test_whatever_flutters_ten_times_a_second_gives_a_handful_of_events_of_each_name(act) -> None:
    b = working()
    b.events.clear()
    for n in range(40):
        act(b, n)
        b.run(0.1)
    counted = Counter(event.name for event in b.events)
    assert not counted or max(counted.values()) <= 4, counted
    assert all(event.count >= 1 for event in b.events)


def shake(b: Bench) -> None:
    b.node.amplitude_um = 45.0
    b.run(2.5)


def shake_for_a_while(b: Bench) -> None:
    shake(b)
    b.node.amplitude_um = 5.0
    b.run(1.0)


def overspeed(b: Bench) -> None:
    b.ramp_to(13_500.0)
    b.run(0.1)


@pytest.mark.parametrize(
    ("act", "name", "said"),
    [
        (shake, "disp_x_alert", ("um peak-to-peak", "limit", "reduce")),
        (shake, "disp_y_danger", ("um peak-to-peak", "limit", "`reset`")),
        (shake_for_a_while, "disp_x_danger", ("is now at 10", "`reset`")),
        (overspeed, "speed_high", ("faster than 13200", "now 13", "`reset`")),
    ],
)
def test_a_limit_that_stands_says_value_limit_and_next_step(
    act: Callable[[Bench], None], name: str, said: tuple[str, ...]
) -> None:
    b = working()
    act(b)
    assert [part for part in said if part not in alarms(b)[name]] == []


@pytest.mark.parametrize("name", ["trip_file_unreadable", "disp_x_danger", "of_another_version"])
def test_what_an_earlier_guard_left_latched_says_what_to_do(name: str) -> None:
    assert "`reset`" in alarms(Bench(latched=[name]))[name]


def test_a_cycle_of_an_old_recording_has_a_well_link() -> None:
    assert Cycle(1, 1, [], None, [], True, True, True).link_fault == ""


@pytest.mark.parametrize(
    ("act", "name", "said"),
    [
        (
            lambda b: b.ramp_to(0.0),
            "no_admissible_clearance",
            ("the shaft stands (0 rpm)", "start the machine"),
        ),
        (
            lambda b: setattr(b.node, "mark_valid", False),
            "no_admissible_clearance",
            ("speed is unknown", "check the once"),
        ),
        (
            lambda b: b.ramp_to(1000.0),
            "speed_undeclared",
            ("speed, 1000 rpm", "(1500 .. 12000)", "change the speed"),
        ),
        (shake, "vibration_high", ("um peak-to-peak", "set point", "reduce speed")),
        (lambda b: stall(b, 0), "cycle_gap", ("stood still", "look at the load")),
    ],
)
def test_a_failsafe_says_its_figures_and_the_next_step(
    act, name: str, said: tuple[str, ...]
) -> None:
    b = warmed_up(5.0)
    act(b)
    b.run(7.0 if b.node.speed_rpm == 0.0 else 0.5)
    told = next(event.text for event in reversed(b.events) if event.name == name)
    text = "; ".join([told, *b.core.stages.arming.state.authority.reasons])
    assert all(words in text for words in said), text


def test_a_standing_alarm_says_its_present_figures_and_differences() -> None:
    b = armed()
    b.node.rate_um_s = 0.0
    b.node.clearance_um += 8.0
    b.node.info_boot_um += 1.0
    b.run(4.0)
    first = alarms(b)
    assert "boot clearance 51 um" in first["node_mismatch"]
    b.node.clearance_um += 2.0
    b.node.info_boot_um += 1.0
    b.run(1.5)
    assert "boot clearance 52 um" in alarms(b)["node_mismatch"]
    assert "now 58 um" in first["clearance_not_following"]
    assert "now 60 um" in alarms(b)["clearance_not_following"]
