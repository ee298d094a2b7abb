"""Bypass and shelving by people, set-point multiply, and what tripped first."""

from __future__ import annotations

import msgspec
import pytest

from firmware_py.guard.protection.bypass import LONGEST_S, SHELVED_MAX
from firmware_py.guard.state import CoreState
from firmware_py.records import ArmState, CommandReply, CommandRequest, GuardState

from ..scripted_node import Bench
from .test_voting import at_work, one_probe, told

ROWS = """
[[measure]]
name = "disp_x"
may_bypass = true
[[measure]]
name = "disp_y"
may_bypass = true
[[measure]]
name = "acc_motor"
may_bypass = true
[[group]]
name = "shaft"
measures = ["disp_x", "disp_y"]
vote = "2oo2"
all_not_ok = "trip"
may_bypass = true
"""


def ask(
    b: Bench, target: str, seconds: float | None, verb: str = "bypass", owner: str = "A. Person",
    reason: str = "new probe",
) -> CommandReply:  # fmt: skip
    request = CommandRequest(
        b.seq, verb, seconds, target=target, owner=owner, reason=reason, origin="test"
    )
    return b.cycle([request]).replies[0]


def alarms(state: GuardState) -> set[str]:
    return {alarm.name for alarm in state.alarms}


def test_while_a_bypass_stands_authority_is_off_and_the_retreat_value_holds() -> None:
    b = at_work(ROWS)
    assert ask(b, "disp_x", 2.0).accepted
    assert "bypass of disp_x for 2 s from test by A. Person: new probe" in [
        e.text for e in b.events if e.name == "command"
    ]
    b.run(0.3)
    state = told(b)
    assert not state.authority
    assert state.arm_state == ArmState.RECOVERY
    assert state.target_clearance_um == b.config.machine.actuator.safe_radial_clearance_um
    alarm = next(a for a in state.alarms if a.name == "disp_x_bypassed")
    assert "A. Person: new probe" in alarm.text
    b.run(5.0)
    state = told(b)
    assert "disp_x_bypass_over" in b.names()
    assert "disp_x_bypassed" not in alarms(state)
    assert state.arm_state == ArmState.ARMED


def test_a_bypassed_measure_does_not_vote_and_the_other_trips_alone() -> None:
    b = at_work(ROWS)
    assert ask(b, "disp_x", 60.0).accepted
    one_probe(b, 0)
    b.run(2.0)
    assert "disp_x_danger" not in b.names()
    assert b.core.tripped == []
    b = at_work(ROWS)
    assert ask(b, "disp_x", 60.0).accepted
    one_probe(b, 1)
    b.run(2.0)
    assert b.core.tripped == ["disp_y_danger", "shaft_trip"]


def test_the_last_vote_of_a_group_is_not_taken_but_the_group_is() -> None:
    b = at_work(ROWS)
    assert ask(b, "disp_x", 60.0).accepted
    reply = ask(b, "disp_y", 60.0)
    assert not reply.accepted
    assert "is the last of shaft that votes" in reply.reasons[0]
    b = at_work(ROWS)
    b.node.frozen_channel = 1
    b.run(0.6)
    assert not ask(b, "disp_x", 60.0).accepted, "the other is not OK"
    assert ask(b, "shaft", 60.0).accepted
    b.node.amplitude_um = 40.0
    b.run(2.0)
    assert b.core.tripped == []
    assert "shaft_bypassed" in alarms(told(b))


def test_a_bypass_lets_a_trip_of_a_broken_group_be_reset() -> None:
    b = at_work(ROWS)
    row = b.node._row
    still = row(0)[:4]
    b.node._row = lambda n: still + row(n)[4:]  # type: ignore[method-assign]
    b.run(2.0)
    assert b.core.tripped == ["shaft_trip"]
    assert not b.ask("reset")[0]
    assert ask(b, "shaft", 60.0).accepted
    b.run(0.1)
    assert b.ask("reset") == (True, [])


def test_what_is_missing_is_told_all_at_once() -> None:
    b = at_work(ROWS)
    reply = ask(b, "acc_bearing_vertical", None, owner=" ", reason="")
    assert [reason.partition(",")[0].partition(";")[0] for reason in reply.reasons] == [
        "bypass: acc_bearing_vertical may not be bypassed",
        "bypass: no owner",
        "bypass: no reason",
        "bypass: an end in no s",
    ]
    assert not ask(b, "disp_x", LONGEST_S + 1).accepted
    assert not ask(b, "speed_high", 60.0).accepted
    assert ask(b, "disp_x", 0.0).reasons == ["bypass: disp_x is not bypassed"]
    assert ask(b, "disp_x", 60.0).accepted
    assert ask(b, "disp_x", 30.0).accepted
    assert len(b.core.stages.bypasses.state.bypasses) == 1
    assert ask(b, "disp_x", 0.0).accepted
    assert b.core.stages.bypasses.state.bypasses == []


def test_nothing_may_be_bypassed_unless_it_is_said() -> None:
    b = at_work("")
    assert not ask(b, "disp_x", 60.0).accepted


def test_shelving_changes_only_what_is_displayed() -> None:
    b = at_work("")
    assert ask(b, "acc_motor_danger", 3.0, "shelve").accepted
    b.node.acceleration_m_s2 = 90.0
    b.run(2.0)
    state = told(b)
    assert state.arm_state == ArmState.TRIPPED
    assert {a.name for a in state.alarms if a.shelved} == {"acc_motor_danger"}
    assert ask(b, "acc_motor_alert", 60.0, "shelve").accepted
    assert ask(b, "acc_motor_alert", 0.0, "shelve").accepted
    b.run(1.5)
    assert not any(a.shelved for a in told(b).alarms)
    assert not ask(b, "", 60.0, "shelve").accepted
    assert not ask(b, "x", 0.5, "shelve").accepted
    for k in range(SHELVED_MAX):
        assert ask(b, f"a{k}", 60.0, "shelve").accepted
    assert "already" in ask(b, "more", 60.0, "shelve").reasons[0]


def test_the_first_that_tripped_is_told_until_it_is_reset() -> None:
    b = at_work("")
    assert told(b).first_out == ""
    b.node.acceleration_m_s2 = 90.0
    b.run(0.5)
    b.node.amplitude_um = 40.0
    b.run(2.0)
    assert len(b.core.tripped) > 3
    assert told(b).first_out == "acc_bearing_vertical_danger"
    b.node.acceleration_m_s2, b.node.amplitude_um = 1.0, 5.0
    b.run(1.0)
    assert b.ask("reset")[0]
    b.run(0.2)
    assert told(b).first_out == ""
    b = at_work(ROWS)
    b.node.amplitude_um = 40.0
    b.run(2.0)
    assert told(b).first_out == "shaft_trip (disp_x_danger)"


MULTIPLY = """
[[multiply]]
name = "critical"
measures = ["disp_x", "disp_y", "acc_motor", "acc_bearing_vertical", "acc_bearing_horizontal"]
factor = 3.0
from_rpm = 3000.0
to_rpm = 5000.0
max_s = 3.0
reset_rpm = 2000.0
"""


def test_set_points_are_multiplied_in_the_window_for_a_time_and_never_above_the_cap() -> None:
    b = at_work(MULTIPLY)
    b.ramp_to(4000.0)
    b.node.acceleration_m_s2 = 90.0
    b.run(2.0)
    state = told(b)
    assert {"critical_active"} <= alarms(state)
    assert not {"acc_motor_danger", "acc_motor_alert"} & alarms(state)
    rows = b.core.stages.protection
    cap_um = b.config.limits.clearance_share * 70.0
    assert rows._limits(rows._rows[0], 70.0)[1] == pytest.approx(cap_um)
    assert rows._limits(rows._rows[2], 70.0) == (120.0, 240.0)
    b.run(2.5)
    state = told(b)
    assert {"critical_spent", "acc_motor_danger"} <= alarms(state)
    assert "critical_active" not in alarms(state)
    b.node.acceleration_m_s2 = 1.0
    b.ramp_to(1900.0)
    b.run(0.1)
    assert not {"critical_spent", "critical_active"} & alarms(told(b))
    b.ramp_to(3500.0)
    assert "critical_active" in alarms(told(b)), "again after the reset"


def test_an_unknown_speed_multiplies_nothing() -> None:
    b = at_work(MULTIPLY)
    b.ramp_to(4000.0)
    b.run(0.1)
    assert "critical_active" in alarms(told(b))
    b.node.mark_valid = False
    b.run(0.1)
    assert "critical_active" not in alarms(told(b))


def test_bypasses_and_windows_go_on_from_a_snapshot() -> None:
    b = at_work(ROWS + MULTIPLY)
    assert ask(b, "disp_x", 60.0).accepted
    assert ask(b, "acc_motor_alert", 60.0, "shelve").accepted
    b.ramp_to(4000.0)
    again = Bench(b.config)
    again.core.restore(b.core.snapshot(b.seq, b.now_ns))
    assert again.core.snapshot(1, 1) == b.core.snapshot(1, 1)
    assert again.core.stages.bypasses.measures == {"disp_x"}
    old = msgspec.msgpack.decode(b.core.snapshot(1, 1).state)
    del old["bypasses"], old["multiply"]
    state = msgspec.msgpack.decode(msgspec.msgpack.encode(old), type=CoreState)
    assert (state.multiply, state.bypasses.bypasses) == ({}, [])
    again.core.stages.multiply.state = {}
