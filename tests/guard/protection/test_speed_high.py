"""The speed-high trip: every speed that the marks tell counts, one false edge does not."""

from __future__ import annotations

from math import pi

import msgspec
import pytest

from firmware_py.acquire.speed import Turn
from firmware_py.config.measures import SPEED_HIGH, speed_high
from firmware_py.guard.core import GuardCore
from firmware_py.guard.protection.speed_high import TURNS, SpeedHigh
from firmware_py.records import ArmState, DeviceHeartbeat, GuardState
from firmware_py.wire.codec import CanCodec

from ..scripted_node import MS, SESSION, Bench, armed, bench

CODEC = CanCodec()
LIMIT_RPM = 13_200.0


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def turn(rpm: float, doubt: str = "", turns: int = 1) -> Turn:
    return Turn(round(60e6 * turns / rpm), rpm * pi / 30, doubt)


def tripped(*turns: Turn) -> bool:
    stage = SpeedHigh(bench(), latched=False)
    return any(stage.step([one], k * MS) for k, one in enumerate(turns))


def healthy(rpm: float, edges: tuple[float, ...]) -> list[Turn]:
    """A turn with false edges between its marks."""
    return [Turn(round(share * 60e6 / rpm), rpm / share * pi / 30, "ramp") for share in edges]


# ------------------------------------------------------------------ the stage


def test_the_limit_is_the_configured_one_or_a_share_of_the_declared_speed() -> None:
    config = bench()
    assert speed_high(config).points[0].limit == pytest.approx(LIMIT_RPM)
    limits = msgspec.structs.replace(config.limits, speed_high_rpm=12_500.0)
    assert speed_high(config.replaced(limits=limits)).points[0].limit == 12_500.0


@pytest.mark.parametrize(
    ("rpm", "trips"), [(12_000.0, False), (13_150.0, False), (13_250.0, True), (18_000.0, True)]
)
@pytest.mark.parametrize("doubt", ["", "ramp"])
def test_a_speed_above_the_limit_trips_whether_it_is_plausible_or_not(
    rpm: float, trips: bool, doubt: str
) -> None:
    assert tripped(*[turn(rpm, doubt)] * 10) == trips


@pytest.mark.parametrize("rpm", [1500.0, 6000.0, 12_000.0, 13_000.0])
@pytest.mark.parametrize(
    "edges",
    [(0.5, 0.5), (0.05, 0.95), (0.97, 0.03), (0.2, 0.3, 0.5), (0.01, 0.99), tuple([0.05] * 20)],
)
def test_false_edges_within_a_turn_do_not_trip_a_healthy_machine(
    rpm: float, edges: tuple[float, ...]
) -> None:
    if len(edges) > 3 and rpm < 6000.0:
        edges = (*edges[:5], 0.75)  # a burst of 10 ms
    turns = [turn(rpm)] * 5 + [*healthy(rpm, edges), turn(rpm)] * 20
    assert not tripped(*turns)


def test_a_missing_edge_now_and_then_does_not_put_the_trip_off() -> None:
    assert tripped(*(([turn(14_000.0)] * 3 + [turn(7_000.0, "ramp")]) * 6))


def test_two_uneven_edges_do_not_trip_a_machine_at_half_its_speed() -> None:
    assert not tripped(*healthy(6000.0, (0.3, 0.7)) * 200)


@pytest.mark.parametrize(
    ("rpm", "share"), [(4000.0, 0.125), (2000.0, 0.05), (6000.0, 0.2), (1500.0, 0.02)]
)
def test_the_time_in_which_the_mark_is_lost_after_a_false_edge_is_taken_off(
    rpm: float, share: float
) -> None:
    """A second strip close behind the first: the rest of the turn tells no reading, for the mark is
    lost."""
    stage, now_ns, told = SpeedHigh(bench(), latched=False), 0, []
    close, rest_ms = (
        Turn(round(share * 60e6 / rpm), rpm / share * pi / 30, "ramp"),
        round((1 - share) * 60e3 / rpm),
    )
    for _ in range(100):
        told += stage.step([close], now_ns)
        for _ in range(rest_ms):
            now_ns += MS
            told += stage.step([], now_ns, lost=True)
    assert not told


@pytest.mark.parametrize("lost_ms", [1, 3, 4])
def test_a_mark_that_is_lost_now_and_then_does_not_put_the_trip_off(lost_ms: int) -> None:
    stage, now_ns, told = SpeedHigh(bench(), latched=False), 0, []
    for _ in range(20):
        for _ in range(3):
            now_ns += 4 * MS
            told += stage.step([turn(15_000.0)], now_ns)
        for _ in range(lost_ms):
            now_ns += MS
            told += stage.step([], now_ns, lost=True)
    assert len(told) == 1


def test_a_number_that_jumps_once_does_not_trip() -> None:
    assert not tripped(turn(1500.0), Turn(40_000, 100 * 1500 * pi / 30, "ramp"), turn(1500.0))


def test_marks_that_contradict_themselves_neither_count_nor_reset() -> None:
    assert tripped(*([turn(14_000.0), Turn(0, 0.0, "count")] * 6))


def test_a_latched_trip_survives_a_restart_and_is_reset_when_the_speed_is_low() -> None:
    stage = SpeedHigh(bench(), latched=True)
    assert stage.tripped == [SPEED_HIGH]
    assert stage.reset(speed_lost=False) == []
    assert stage.standing() == []
    for _ in range(6):
        stage.step([turn(14_000.0)], MS)
    (refused,) = stage.reset(speed_lost=False)
    assert "14000 rpm above 13200" in refused
    (alarm,) = stage.standing()
    assert (alarm.name, alarm.latched, alarm.limit) == (SPEED_HIGH, True, pytest.approx(LIMIT_RPM))
    stage.step([turn(5_000.0, "ramp")], MS)
    assert stage.reset(speed_lost=False), "an implausible speed below the limit says nothing"
    stage.step([turn(5_000.0)], MS)
    assert stage.reset(speed_lost=False) == []


def test_a_lost_mark_does_not_bar_the_reset_for_ever() -> None:
    stage = SpeedHigh(bench(), latched=False)
    stage.step([turn(14_000.0)] * 6, MS)
    assert stage.reset(speed_lost=True) == []


# ------------------------------------------------------------------ the guard


@pytest.mark.parametrize("rpm", [13_300.0, 18_000.0, 30_000.0])
def test_a_load_rejection_trips_within_the_stated_latency(rpm: float) -> None:
    b = armed()
    b.ramp_to(12_000.0)
    b.run(0.2)
    b.node.speed_rpm = rpm
    start_ns = b.now_ns
    tripping = next(d for d in iter(b.cycle, None) if any(e.name == "tripped" for e in d.events))
    assert b.now_ns - start_ns <= (TURNS + 2) * 60e9 / LIMIT_RPM + 2 * MS
    heartbeat = next(
        m for m in map(CODEC.decode, tripping.frames_out) if isinstance(m, DeviceHeartbeat)
    )
    assert (heartbeat.trip_request, heartbeat.run_permit) == (True, False)
    assert SPEED_HIGH in b.names()
    found = state(b)
    assert found.arm_state == ArmState.TRIPPED
    assert {"speed_high", "speed_implausible"} & {a.name for a in found.alarms} >= {"speed_high"}
    assert b.core.tripped == [SPEED_HIGH]
    b.node.speed_rpm = 3000.0
    b.run(1.0)
    assert b.core.tripped == [SPEED_HIGH], "latched"


def test_a_slow_rise_trips_just_above_the_limit_and_a_reset_needs_a_low_speed() -> None:
    b = Bench()
    b.run(2.0)
    b.ramp_to(13_100.0)
    b.run(0.5)
    assert b.core.tripped == []
    b.ramp_to(13_300.0)
    b.run(0.1)
    assert b.core.tripped == [SPEED_HIGH]
    accepted, reasons = b.ask("reset")
    assert not accepted
    assert any("speed_high still exceeded" in reason for reason in reasons)
    b.ramp_to(6_000.0)
    b.run(0.1)
    assert b.ask("reset") == (True, [])
    assert b.core.tripped == []


@pytest.mark.parametrize("position", [0.02, 0.3, 0.5, 0.9])
def test_a_reflection_now_and_then_at_full_speed_does_not_trip(position: float) -> None:
    b = Bench()
    b.ramp_to(12_000.0)
    b.node.edges = (0.0, position)
    b.node.edge_seen = lambda number: number % 2 == 0 or number % 10 == 1
    b.run(2.0)
    assert b.core.tripped == []


def test_a_restarted_guard_keeps_the_trip_under_its_own_name_once() -> None:
    b = Bench(latched=[SPEED_HIGH, "disp_x_danger"])
    b.run(0.5)
    assert sorted(b.core.tripped) == ["disp_x_danger", SPEED_HIGH]
    assert [a.name for a in state(b).alarms].count(SPEED_HIGH) == 1


def test_an_old_snapshot_without_speed_judgement_is_read() -> None:
    b = Bench()
    b.run(0.5)
    taken = b.core.snapshot(1, 2)
    raw = msgspec.msgpack.decode(taken.state)
    del raw["speed_check"], raw["speed_high"]
    other = GuardCore(b.config, CanCodec(), SESSION)
    other.restore(msgspec.structs.replace(taken, state=msgspec.msgpack.encode(raw)))
    assert other.tripped == []
