"""Speeds that no shaft can have: doubted at once, and believed again only where something speaks
for them."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from math import pi

import msgspec
import pytest

from firmware_py.guard.plausibility import speed_check
from firmware_py.records import ArmState, GuardState, Quality

from ..scripted_node import Bench, ScriptedNode, armed, bench, working

CLEAN_S = 4.0
"""Instead of half a minute."""


@pytest.fixture(autouse=True)
def soon_clean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_check, "CLEAN_NS", round(CLEAN_S * 1e9))


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def told_rpm(b: Bench) -> float:
    return b.core.stages.acquire.speed.speed_rad_s * 30 / pi


@cache
def _at(rpm: float) -> Bench:
    b = working()
    b.advise_um = 55.0
    b.ramp_to(rpm)
    b.run(1.0)
    assert state(b).authority, state(b).authority_reasons
    assert "speed_implausible" not in b.names()
    return b


def at(rpm: float) -> Bench:
    """With authority at a speed."""
    return deepcopy(_at(rpm))


def two_edges(node: ScriptedNode) -> None:
    node.edges = (0.0, 0.5)


def two_uneven_edges(node: ScriptedNode) -> None:
    node.edges = (0.0, 0.3)


def three_edges(node: ScriptedNode) -> None:
    node.edges = (0.0, 1 / 3, 2 / 3)


def every_second_missing(node: ScriptedNode) -> None:
    node.edge_seen = lambda number: number % 2 == 0


def some_missing(node: ScriptedNode) -> None:
    node.edge_seen = lambda number: number % 7 != 0


def a_reflection_now_and_then(node: ScriptedNode) -> None:
    node.edges = (0.0, 0.4)
    node.edge_seen = lambda number: number % 2 == 0 or number % 14 == 1


def number_steps_by_two(node: ScriptedNode) -> None:
    node.turns_an_edge = 2


def number_runs_backward(node: ScriptedNode) -> None:
    node.turns_an_edge = -1


def number_stands(node: ScriptedNode) -> None:
    node.turns_an_edge = 0


def mark_stops(node: ScriptedNode) -> None:
    node.edge_seen = lambda number: False


FAULTS = [
    two_edges,
    two_uneven_edges,
    three_edges,
    every_second_missing,
    some_missing,
    a_reflection_now_and_then,
    number_steps_by_two,
    number_runs_backward,
    number_stands,
    mark_stops,
]


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("rpm", [3000.0, 6000.0])
def test_a_false_mark_ends_authority_at_once_and_is_named_and_never_widens(
    fault: Callable[[ScriptedNode], None], rpm: float
) -> None:
    b = at(rpm)
    before = state(b)
    fault(b.node)
    b.run(10 * 60 / rpm)
    for _ in range(6):
        found = state(b)
        assert not found.authority
        assert found.target_clearance_um == 50.0
        assert found.clearance_high_um <= before.clearance_high_um
        b.run(0.1)
    assert "mark_lost" in b.names()
    alarms = [a.name for a in found.alarms]
    assert ("speed_implausible" in alarms) == (fault is not mark_stops)
    assert b.names().count("speed_implausible") == (fault is not mark_stops), "an event is a change"
    trips = (fault, rpm) == (
        three_edges,
        6000.0,
    )  # 18000 rpm told: it counts, although no shaft turns so
    assert found.arm_state == (ArmState.TRIPPED if trips else ArmState.ARMED)


def test_manual_mode_goes_to_the_safe_value_too() -> None:
    b = armed(mode=1)
    b.run(2.0)
    b.ask("set_clearance", 60.0)
    b.run(0.5)
    assert state(b).target_clearance_um == 60.0
    two_edges(b.node)
    b.run(0.1)
    assert state(b).target_clearance_um == 50.0


def test_blocks_of_a_doubted_speed_say_so() -> None:
    b = at(6000.0)
    two_edges(b.node)
    blocks = [block for d in b.run(0.5) for block in d.blocks]
    assert all(block.quality & Quality.NO_MARK for block in blocks[5:])


# ------------------------------------------------------------------ the end of a doubt


def test_one_false_edge_is_believed_again_after_its_time_and_not_before() -> None:
    b = at(6000.0)
    b.node.edges = (0.0, 0.4)
    b.run(0.01)
    b.node.edges = (0.0,)
    b.node.amplitude_um = 0.6  # too small to be evidence: the speed came back to its course
    b.run(CLEAN_S - 1.0)
    assert not state(b).authority
    assert b.core.stages.speed_check.state.cause == "ramp"
    b.until(lambda: b.authority, 4.0)
    assert "speed_plausible" in b.names()


@pytest.mark.parametrize("fault", [two_edges, every_second_missing, number_steps_by_two])
def test_a_lasting_fault_is_never_believed(fault: Callable[[ScriptedNode], None]) -> None:
    b = at(6000.0)
    fault(b.node)
    b.run(CLEAN_S + 5.0)
    assert not state(b).authority
    assert "speed_plausible" not in b.names()


def test_a_real_jump_of_speed_is_believed_when_the_orbit_turns_with_it() -> None:
    b = at(3000.0)
    b.node.speed_rpm = 6000.0
    b.run(2.0)
    assert not state(b).authority
    assert state(b).speed_rad_s == pytest.approx(200 * pi, rel=1e-3), "told as it is"
    b.until(lambda: b.authority, CLEAN_S + 2.0)
    assert "speed_plausible" in b.names()


def test_a_jump_without_an_orbit_to_speak_for_it_waits_for_a_person() -> None:
    b = at(3000.0)
    b.node.amplitude_um = 0.6
    b.node.speed_rpm = 6000.0
    b.run(CLEAN_S + 3.0)
    assert not state(b).authority
    assert b.ask("reset")[0]
    b.until(lambda: b.authority, 3.0)
    assert "speed_plausible" in b.names()


def test_a_reset_while_the_fault_lasts_is_doubted_again() -> None:
    b = at(6000.0)
    two_edges(b.node)
    b.run(1.0)
    b.ask("reset")
    b.run(2.5)
    assert not state(b).authority
    assert b.names().count("speed_implausible") == 2


def test_a_shaft_that_stands_ends_the_doubt() -> None:
    b = Bench()
    b.run(2.0)
    b.node.edges = (0.0, 0.4)
    b.run(0.3)
    b.node.edges = (0.0,)
    b.node.amplitude_um = 0.0
    b.ramp_to(0.0)
    b.run(8.0)
    assert told_rpm(b) == 0.0
    assert "speed_plausible" in b.names()


# --------------------------------------------------------------- a guard that starts beside a fault


def starting(
    fault: Callable[[ScriptedNode], None], amplitude_um: float = 5.0, rpm: float = 6000.0
) -> Bench:
    b = Bench()
    b.node.speed_rpm, b.node.amplitude_um = rpm, amplitude_um
    fault(b.node)
    b.run(3.2)
    return b


@pytest.mark.parametrize(
    "fault", [two_edges, three_edges, every_second_missing, number_steps_by_two]
)
@pytest.mark.parametrize("rpm", [3000.0, 6000.0])
def test_a_guard_that_starts_with_false_marks_sees_it_by_the_orbit(
    fault: Callable[[ScriptedNode], None], rpm: float
) -> None:
    b = starting(fault, rpm=rpm)
    (event,) = [event for event in b.events if event.name == "speed_implausible"]
    assert event.limit == pytest.approx(rpm, rel=0.01), "how often the shaft moves"
    assert "mark_lost" in b.names()


@pytest.mark.parametrize("fault", [two_edges, every_second_missing])
def test_an_orbit_within_noise_is_no_evidence(fault: Callable[[ScriptedNode], None]) -> None:
    b = starting(fault, amplitude_um=0.4)
    assert "speed_implausible" not in b.names()


def test_runout_raises_the_floor_of_the_evidence() -> None:
    config = bench()
    channels = [
        msgspec.structs.replace(channel, slow_roll_um=4.0) for channel in config.machine.channel
    ]
    b = Bench(config.replaced(channel=channels))
    two_edges(b.node)
    b.run(3.2)
    assert "speed_implausible" not in b.names()


def test_a_whirl_that_begins_later_is_no_fault_of_the_mark() -> None:
    b = at(6000.0)
    row, node = b.node._row, b.node

    def whirling(n: int) -> bytes:
        phase = node._phase
        node._phase = (phase + 2 * pi * (node._turns & 1)) / 2
        counts = row(n)
        node._phase = phase
        return counts

    node._row = whirling  # type: ignore[method-assign]
    b.run(3.0)
    assert "speed_implausible" not in b.names()


def test_a_mark_that_is_dead_from_the_start_is_no_standing_shaft() -> None:
    b = Bench()
    b.node._mark_tick -= 60_000_000
    mark_stops(b.node)
    b.run(3.5)
    assert not b.core.stages.acquire.speed.known
    assert "mark_lost" in [a.name for a in state(b).alarms]


def test_a_shaft_that_stood_and_swings_is_doubted() -> None:
    b = Bench()
    b.node.speed_rpm = 0.0
    b.node._mark_tick -= 60_000_000
    b.run(2.0)
    assert (told_rpm(b), b.core.stages.acquire.speed.known) == (0.0, True)
    mark_stops(b.node)
    b.node.speed_rpm = 6000.0
    b.run(2.6)
    assert "speed_implausible" in b.names()
    (alarm,) = [a for a in state(b).alarms if a.name == "speed_implausible"]
    assert alarm.value == 0.0


def test_a_standing_shaft_that_is_moved_once_stands() -> None:
    b = Bench()
    b.node.speed_rpm, b.node.amplitude_um = 0.0, 0.0
    b.node._mark_tick -= 60_000_000
    b.run(2.0)
    assert b.core.stages.acquire.speed.known, "quiet for 1.5 s"
    b.events.clear()
    b.node.mean_um = (-40.0, -30.0)
    b.run(2.0)
    assert told_rpm(b) == 0.0
    assert "speed_implausible" not in b.names()
    assert "mark_lost" not in b.names()
