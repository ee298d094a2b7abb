"""Votes over danger: what trips, what a lost channel does, and authority by the first."""

from __future__ import annotations

import shutil
from copy import deepcopy
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import pytest

from firmware_py.config import SHIPPED, Config, load
from firmware_py.config.measure_types import Effect, Group
from firmware_py.guard.protection.set_points import Ballot
from firmware_py.guard.protection.voting import GroupState, GroupVote
from firmware_py.guard.state import CoreState
from firmware_py.records import ArmState, GuardState, Severity

from ..scripted_node import Bench

NS = 1_000_000_000
YES, NO, OUT = Ballot(True, True, "x above"), Ballot(True, False, ""), Ballot(False, False, "")
OUT_YES = Ballot(False, True, "x above")

# ------------------------------------------------------------------ the count alone


def vote(kind: str, *ballots: Ballot, all_not_ok: Effect = Effect.AUTHORITY) -> GroupVote:
    names = tuple("abc"[: len(ballots)])
    stage = GroupVote(Group("g", names, kind, all_not_ok, True), [])
    stage.step(list(ballots), NS)
    return stage


@pytest.mark.parametrize(
    ("kind", "ballots", "trips"),
    [
        ("1oo1", (YES,), True),
        ("1oo1", (NO,), False),
        ("1oo2", (YES, NO), True),
        ("1oo2", (NO, NO), False),
        ("1oo2", (OUT, YES), True),
        ("2oo2", (YES, NO), False),
        ("2oo2", (YES, YES), True),
        ("2oo2", (OUT, YES), True),
        ("2oo2", (OUT, NO), False),
        ("2oo2", (OUT_YES, NO), False),
        ("2oo2", (OUT_YES, OUT_YES), False),
        ("2oo2_strict", (YES, YES), True),
        ("2oo2_strict", (OUT, YES), False),
        ("2oo2_strict", (OUT_YES, YES), False),
        ("2oo3", (YES, NO, NO), False),
        ("2oo3", (YES, NO, YES), True),
        ("2oo3", (OUT, NO, YES), False),
        ("2oo3", (OUT, YES, YES), True),
        ("2oo3", (OUT, OUT, YES), True),
        ("2oo3", (OUT, OUT, NO), False),
    ],
)
def test_the_vote_counts_those_that_are_ok(
    kind: str, ballots: tuple[Ballot, ...], trips: bool
) -> None:
    assert vote(kind, *ballots).state.trip.standing is trips


@pytest.mark.parametrize("effect", [Effect.ALARM, Effect.AUTHORITY, Effect.RETREAT, Effect.TRIP])
def test_a_group_without_any_channel_does_what_is_configured_and_says_so(effect: Effect) -> None:
    stage = vote("2oo2", OUT, OUT, all_not_ok=effect)
    assert not stage.state.trip.standing, "a start takes a moment"
    stage.step([OUT, OUT], 4 * NS)
    names = [alarm.name for alarm in stage.standing()]
    assert names == ["g_trip", "g_not_ok"] if effect is Effect.TRIP else ["g_not_ok"]
    assert [(name, does) for name, does, _ in stage.acting] == [("g_not_ok", effect)]
    if effect is Effect.TRIP:
        (reason,) = stage.reset([OUT, OUT])
        assert "every measure of g is not OK" in reason
    stage.step([NO, OUT], 5 * NS)
    assert stage.reset([NO, OUT]) == []
    assert stage.standing() == []
    for seconds, trips in ((6.0, False), (6.9, False), (7.0, effect is Effect.TRIP)):
        stage.step([OUT, OUT], round(seconds * NS))
        assert stage.state.trip.standing is trips


def test_a_strict_vote_that_cannot_be_reached_is_shown() -> None:
    stage = vote("2oo2_strict", OUT, NO)
    (alarm,) = stage.standing()
    assert (alarm.name, alarm.severity) == ("g_defeated", Severity.FAULT)
    assert "1 is OK" in alarm.text
    assert [(name, effect) for name, effect, _ in stage.acting] == [
        ("g_defeated", Effect.AUTHORITY)
    ]
    assert [n.name for n in stage.step([NO, NO], 2 * NS)] == ["g_votes"]


def test_the_trip_is_told_once_latches_and_is_reset_when_no_danger_stands() -> None:
    stage = vote("2oo2", NO, NO)
    (notice,) = stage.step([YES, YES], 2 * NS)
    assert (notice.name, notice.severity, notice.value, notice.limit) == (
        "g_trip", Severity.DANGER, 2.0, 2.0,
    )  # fmt: skip
    assert "2oo2 of g: 2 of 2 in danger, 2 needed: x above; x above" in notice.text
    assert stage.step([YES, YES], 3 * NS) == stage.step([NO, YES], 4 * NS) == []
    assert stage.reset([NO, YES]) == ["g_trip stands: x above"]
    assert stage.reset([NO, NO]) == []
    assert stage.reset([YES, NO]) == [], "nothing is latched"
    assert not stage.state.trip.standing


def test_a_latched_trip_survives_a_restart_and_a_snapshot() -> None:
    group = Group("g", ("a", "b"), "2oo2", Effect.AUTHORITY, True)
    stage = GroupVote(group, ["g_trip", "other"])
    assert stage.state.trip.standing
    data = msgspec.msgpack.encode(vote("2oo2_strict", OUT, YES).state)
    stage.restore(msgspec.msgpack.decode(data, type=GroupState))
    assert [alarm.name for alarm in stage.standing()] == ["g_defeated"]
    assert stage.step([NO, NO], 5 * NS)[0].name == "g_votes"


# ------------------------------------------------------------------ in the guard


GROUP = '[[group]]\nname = "shaft"\nmeasures = ["disp_x", "disp_y"]\nvote = "{}"\n'


@cache
def configured(text: str) -> Config:
    with TemporaryDirectory() as folder:
        rig = Path(folder) / "bench"
        shutil.copytree(SHIPPED / "bench", rig)
        path = rig / "device.toml"
        path.write_text(path.read_text().replace("danger_delay_s = 3.0", "danger_delay_s = 1.0"))
        path.write_text(path.read_text() + text)
        return load(rig)[0]


@cache
def _working(text: str) -> Bench:
    b = Bench(configured(text)).armed()
    b.advise_um = 70.0
    b.run(3.0)
    del b.cycles[:-20]
    return b


def at_work(text: str) -> Bench:
    return deepcopy(_working(text))


def one_probe(b: Bench, channel: int) -> None:
    """Only one probe shows a large orbit."""
    row = b.node._row
    amplitude = b.node.amplitude_um

    def altered(n: int) -> bytes:
        b.node.amplitude_um = amplitude
        quiet = row(n)
        b.node.amplitude_um = 40.0
        loud = row(n)
        b.node.amplitude_um = amplitude
        place = slice(2 * channel, 2 * channel + 2)
        return quiet[: place.start] + loud[place] + quiet[place.stop :]

    b.node._row = altered  # type: ignore[method-assign]


def told(b: Bench) -> GuardState:
    while True:
        state = b.cycle().state
        if state is not None:
            return state


@pytest.mark.parametrize("channel", [0, 1])
def test_one_danger_of_two_takes_authority_at_once_and_does_not_trip(channel: int) -> None:
    b = at_work(GROUP.format("2oo2"))
    assert told(b).authority
    one_probe(b, channel)
    b.run(0.4)
    state = told(b)
    assert not state.authority
    assert any("danger above" in reason for reason in state.authority_reasons)
    b.run(2.0)
    state, name = told(b), f"disp_{'xy'[channel]}_danger"
    assert name in b.names()
    assert "shaft_trip" not in b.names()
    assert state.arm_state == ArmState.ARMED
    assert state.run_permit
    assert {a.name for a in state.alarms} >= {name}
    assert b.core.tripped == [name], "kept over a restart"
    assert not b.ask("arm")[0], "no arming while a danger stands"


def test_both_dangers_trip_as_the_group() -> None:
    b = at_work(GROUP.format("2oo2"))
    b.node.amplitude_um = 40.0
    b.run(2.0)
    state = told(b)
    assert (state.arm_state, state.run_permit, state.trip_request) == (
        ArmState.TRIPPED, False, True,
    )  # fmt: skip
    tripped = next(e for e in b.events if e.name == "tripped")
    assert tripped.text == "shaft_trip"
    accepted, reasons = b.ask("reset")
    assert not accepted
    assert any(reason.startswith("shaft_trip stands") for reason in reasons)
    b.node.amplitude_um = 5.0
    b.run(1.0)
    assert told(b).arm_state == ArmState.TRIPPED
    assert b.ask("reset") == (True, [])
    b.run(0.2)
    assert told(b).run_permit
    assert b.core.tripped == []


def test_a_lost_channel_leaves_the_vote_to_the_other() -> None:
    b = at_work(GROUP.format("2oo2"))
    b.node.frozen_channel = 0
    b.run(1.0)
    b.node.amplitude_um = 40.0
    b.run(2.0)
    assert b.core.tripped == ["disp_y_danger", "shaft_trip"]


def test_a_strict_vote_does_not_follow_and_says_that_it_is_defeated() -> None:
    b = at_work(GROUP.format("2oo2_strict"))
    b.node.frozen_channel = 0
    b.run(1.0)
    b.node.amplitude_um = 40.0
    b.run(2.0)
    state = told(b)
    assert b.core.tripped == ["disp_y_danger"]
    assert "shaft_defeated" in {a.name for a in state.alarms}
    assert not state.authority
    assert state.run_permit


@pytest.mark.parametrize(
    ("reaction", "arm_state"),
    [("alarm", ArmState.ARMED), ("retreat", ArmState.RECOVERY), ("trip", ArmState.TRIPPED)],
)
def test_all_channels_lost_is_never_silent(reaction: str, arm_state: ArmState) -> None:
    text = GROUP.format("2oo2") + f'all_not_ok = "{reaction}"\n'
    b = at_work(text)
    row = b.node._row
    still = row(0)[:4]
    b.node._row = lambda n: still + row(n)[4:]  # type: ignore[method-assign]
    b.run(2.0)
    state = told(b)
    assert "shaft_not_ok" in {a.name for a in state.alarms}
    assert state.arm_state == arm_state


def test_oil_votes_as_well() -> None:
    text = (
        '[[group]]\nname = "oil"\nmeasures = ["oil_pressure_low", "oil_outlet_high"]\n'
        'vote = "2oo2"\n'
    )
    b = at_work(text)
    b.node.oil_C = 71.0
    b.run(2.5)
    assert b.core.tripped == ["oil_outlet_high_danger"]
    assert told(b).arm_state == ArmState.ARMED
    b.node.pressure_bar = 0.1
    b.run(2.5)
    assert "oil_trip" in b.core.tripped


def test_effects_short_of_a_trip() -> None:
    text = """
[[measure]]
name = "disp_x"
danger_effect = "retreat"
[[measure]]
name = "disp_y"
alert_effect = "event"
danger_effect = "authority"
[[measure]]
name = "acc_motor"
danger_effect = "alarm"
[[measure]]
name = "oil_outlet_high"
danger_effect = "retreat"
alert_effect = "alarm"
"""
    b = at_work(text)
    one_probe(b, 1)
    b.run(2.0)
    state = told(b)
    assert {"disp_y_alert", "disp_y_danger"} <= set(b.names())
    assert "disp_y_alert" not in {a.name for a in state.alarms}
    assert (state.authority, state.arm_state) == (False, ArmState.ARMED)
    b = at_work(text)
    b.node.oil_C = 71.0
    b.run(2.5)
    assert told(b).arm_state == ArmState.RECOVERY
    b = at_work(text)
    b.node.acceleration_m_s2 = 90.0
    b.run(2.5)
    state = told(b)
    assert "acc_motor_danger" in {a.name for a in state.alarms}
    assert state.arm_state == ArmState.TRIPPED, "the other two trip"
    assert "acc_motor_danger" not in next(e for e in b.events if e.name == "tripped").text


def test_a_snapshot_goes_on_with_the_same_votes() -> None:
    b = at_work(GROUP.format("2oo2"))
    b.node.amplitude_um = 40.0
    b.run(2.0)
    again = Bench(b.config)
    again.core.restore(b.core.snapshot(b.seq, b.now_ns))
    assert again.core.tripped == b.core.tripped
    assert again.core.snapshot(b.seq, b.now_ns) == b.core.snapshot(b.seq, b.now_ns)
    old = msgspec.msgpack.decode(b.core.snapshot(1, 1).state)
    del old["groups"]
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(old), type=CoreState).groups == {}
