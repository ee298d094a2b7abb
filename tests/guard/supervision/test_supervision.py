"""Setpoint and feedback compared: each way in which node or actuator may not do what it is told."""

from collections.abc import Callable
from random import Random

import msgspec
import pytest

from firmware_py.guard.core import GuardCore
from firmware_py.guard.state import CoreState
from firmware_py.guard.supervision.following import Following, Quantity
from firmware_py.guard.supervision.recent import Span, extremes, note
from firmware_py.records import ArmState, DeviceHeartbeat, GuardState, NodeState
from firmware_py.wire.codec import CanCodec

from ..scripted_node import MS, SESSION, Bench, ScriptedNode, bench, working

CODEC = CanCodec()
QUANTITY = Quantity("x", "um", "measured x", 5.0, 50.0, 300 * MS, 1000 * MS)


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def alarms(b: Bench) -> list[str]:
    return [alarm.name for alarm in state(b).alarms]


def until(b: Bench, event: str, seconds: float) -> float:
    """Run until ``event`` is told; how long it took, s."""
    start_ns, seen = b.now_ns, len(b.events)
    for _ in range(round(seconds * 1000)):
        b.cycle()
        if any(e.name == event for e in b.events[seen:]):
            return (b.now_ns - start_ns) * 1e-9
    raise AssertionError(f"no {event} within {seconds} s, but {b.names()[-5:]}")


def text_of(b: Bench, event: str) -> str:
    return next(e.text for e in reversed(b.events) if e.name == event)


def reporting(b: Bench, **changed: object) -> None:
    """From now on each NODE_STATE says so."""

    def tampered(frames: list) -> list:
        out = []
        for frame in frames:
            message = CODEC.decode(frame)
            if isinstance(message, NodeState):
                frame = CODEC.encode(msgspec.structs.replace(message, **changed), frame.arrival_ns)
            out.append(frame)
        return out

    b.tamper = tampered


# ------------------------------------------------------------------ the actuator


def stuck(node: ScriptedNode) -> Callable[[float], float]:
    where = node.clearance_um
    return lambda target: where


def runs_away(node: ScriptedNode) -> Callable[[float], float]:
    return lambda target: 160.0


def wrong_sign(node: ScriptedNode) -> Callable[[float], float]:
    return lambda target: 140.0 - target


def stops_at_an_end(node: ScriptedNode) -> Callable[[float], float]:
    return lambda target: min(target, 80.0)


def stands_10_um_off(node: ScriptedNode) -> Callable[[float], float]:
    return lambda target: target + 10.0


def half_as_fast(node: ScriptedNode) -> Callable[[float], float]:
    node.rate_um_s = 25.0
    return lambda target: target


@pytest.mark.parametrize(
    ("fault", "within_s"),
    [
        (stuck, 2.0),
        (runs_away, 2.0),
        (wrong_sign, 2.0),
        (stops_at_an_end, 4.0),
        (stands_10_um_off, 4.0),
        (half_as_fast, 2.0),
    ],
)
def test_an_actuator_that_does_not_follow_is_an_alarm_and_costs_authority(
    fault: Callable[[ScriptedNode], Callable[[float], float]], within_s: float
) -> None:
    b = working()
    b.advise_um = 50.0
    b.run(1.5)
    b.node.actuate = fault(b.node)
    b.advise_um = 95.0
    until(b, "clearance_not_following", within_s)
    told = text_of(b, "clearance_not_following")
    assert "measured radial clearance" in told
    assert "um" in told
    found = state(b)
    assert not found.authority
    assert found.target_clearance_um == 50.0
    assert "clearance_not_following" in [alarm.name for alarm in found.alarms]
    assert found.arm_state == ArmState.ARMED


@pytest.mark.parametrize(("noise_um", "alarm"), [(0.5, False), (4.0, True), (9.0, True)])
def test_noise_of_the_measured_position_is_an_alarm_where_it_is_large(
    noise_um: float, alarm: bool
) -> None:
    b = working()
    random = Random(1)
    b.node.rate_um_s = 1e6
    b.node.actuate = lambda target: target + random.gauss(0.0, noise_um)
    b.events.clear()

    def told() -> bool:
        return any(name.startswith("clearance_") for name in b.names())

    if alarm:
        b.until(told, 12.0)
    else:
        b.run(12.0)
        assert not told()


def test_the_alarm_tells_both_figures() -> None:
    b = working()
    b.node.actuate = stands_10_um_off(b.node)
    until(b, "clearance_not_following", 4.0)
    told = text_of(b, "clearance_not_following")
    assert "measured radial clearance 80 um, commanded 70" in told
    alarm = next(a for a in state(b).alarms if a.name == "clearance_not_following")
    assert alarm.value > alarm.limit


@pytest.mark.parametrize("to_um", [58.0, 160.0, 40.0])
def test_movement_that_nobody_commanded_is_an_alarm_while_disarmed(to_um: float) -> None:
    b = Bench()
    b.run(2.0)
    assert "clearance_not_following" not in b.names()
    b.node.actuate = lambda target: to_um
    assert until(b, "clearance_not_following", 4.0) < 3.0
    assert "boot value: nothing is commanded" in text_of(b, "clearance_not_following")
    b.ask("mode", mode=2)
    accepted, reasons = b.ask("arm")
    assert not accepted
    assert any("measured radial clearance" in reason for reason in reasons)


def test_an_actuator_that_stood_elsewhere_at_the_start_may_run_to_its_boot_value() -> None:
    b = Bench()
    b.node.clearance_um, b.node.moved = 160.0, (160.0, 1.0)
    b.run(5.0)
    assert "clearance_not_following" not in b.names()


def test_a_stuck_one_that_fails_a_second_time_stays_an_alarm_until_reset() -> None:
    b = working()
    b.node.actuate = lambda target: 50.0
    until(b, "clearance_not_following", 4.0)
    until(b, "clearance_not_following_ended", 4.0)
    until(b, "authority_gained", 4.0)
    until(b, "clearance_not_following", 4.0)
    b.run(8.0)
    assert not state(b).authority
    b.node.actuate = lambda target: target
    b.run(3.0)
    assert "clearance_not_following" in alarms(b)
    assert b.ask("reset")[0]
    b.run(4.0)
    assert "clearance_not_following" not in alarms(b)
    assert state(b).authority


def test_one_that_sticks_now_and_then_is_an_alarm() -> None:
    b = working()
    for _ in range(4):
        b.advise_um = 90.0
        b.node.rate_um_s = 0.0
        b.run(0.95)
        b.node.rate_um_s = 60.0
        b.run(2.0)
        b.advise_um = 65.0
        b.run(2.0)
    assert "clearance_not_following" in b.names()


@pytest.mark.parametrize(
    ("of_ten", "off_um", "within_s"),
    [
        ("XXXXXX....", 10.0, 8.0),
        ("X.X.X.X.X.", -10.0, 22.0),
        ("X.X.X.X.X.", 22.0, 8.0),
        ("X.........", 10.0, 0.0),
    ],
)
def test_an_error_that_comes_and_goes_adds_up(of_ten: str, off_um: float, within_s: float) -> None:
    alone, told, now_ns = Following(QUANTITY), 0.0, 10**10
    for n in range(600):
        now_ns += 50 * MS
        alone.target(70.0, now_ns)
        measured = 70.0 + off_um * (of_ten[n % 10] == "X") * (1 if n % 20 < 10 else -1)
        if alone.step(measured, 70.0, now_ns):
            told = told or n * 0.05
    assert 0.0 <= told <= within_s
    assert bool(told) == bool(within_s)


def test_an_error_before_and_after_a_gap_adds_up() -> None:
    alone, now_ns, told = Following(QUANTITY), 10**10, []
    for n in range(30):
        now_ns += 50 * MS if n % 10 else 5000 * MS
        alone.target(70.0, now_ns)
        told += [n] * bool(alone.step(80.0 if n else 70.0, 70.0, now_ns))
    assert told == [23]


def test_an_overshoot_each_time_is_an_alarm() -> None:
    b = working()
    b.node.rate_um_s = 120.0
    for k in range(4):
        b.advise_um = 90.0 if k % 2 else 65.0
        b.node.actuate = lambda target: target + 12.0
        b.run(0.5)
        b.node.actuate = lambda target: target
        b.run(3.0)
    assert "times within 60 s" in text_of(b, "clearance_not_following")


@pytest.mark.parametrize("advised_um", [55.0, 70.0, 95.0])
def test_an_actuator_of_the_declared_rate_and_lag_is_none(advised_um: float) -> None:
    b = working()
    random = Random(2)
    lagging = [70.0]

    def lag(target: float) -> float:
        lagging[0] += (target - lagging[0]) * (1.0 / 50.0)
        return lagging[0] + random.gauss(0.0, 0.3)

    b.node.actuate = lag
    for _ in range(2):  # four ways: three short errors would be an alarm
        b.advise_um = advised_um
        b.run(2.5)
        b.advise_um = 50.0
        b.run(2.5)
    assert not [name for name in b.names() if "not_following" in name]


@pytest.mark.parametrize(
    ("supplied_bar", "alarm"), [(0.0, True), (1.1, False), (0.6, True), (2.4, True)]
)
def test_a_pressure_that_is_not_there_is_an_alarm(supplied_bar: float, alarm: bool) -> None:
    b = working()
    b.node.supply = lambda target: supplied_bar
    b.run(6.0)
    assert ("pressure_not_following" in b.names()) == alarm
    assert state(b).authority != alarm


def test_a_reading_gap_does_not_count_as_error() -> None:
    b = working()
    b.node.actuate = stands_10_um_off(b.node)
    for _ in range(4):
        b.run(0.3)
        b.tamper = lambda frames: [f for f in frames if f.frame_id != 0x0B0]
        b.run(0.6)
        b.tamper = list
    assert "clearance_not_following" not in b.names()


# ------------------------------------------------------------------ the node


def test_a_node_that_stays_safe_is_an_alarm() -> None:
    b = Bench()
    b.node.obeys = False
    b.armed()
    b.advise_um = 70.0
    assert until(b, "node_not_following", 2.0) < 0.7
    b.run(4.0)
    assert not state(b).authority
    b.node.obeys = True
    until(b, "node_not_following_ended", 1.0)
    b.run(3.0)
    assert state(b).authority


@pytest.mark.parametrize("which", [0, 1, 2, 3])
def test_each_refusal_counter_that_grows_is_an_alarm(which: int) -> None:
    b = working()
    b.node.refused[which] = 65534
    b.run(1.0)
    b.events.clear()
    for _ in range(10):
        b.node.refused[which] = (b.node.refused[which] + 1) & 0xFFFF
        b.run(0.1)
    assert "node_refuses" in b.names()
    assert ("stale", "check", "session", "range")[which] in text_of(b, "node_refuses")
    assert not state(b).authority
    b.until(lambda: b.authority, 10.0)
    assert "node_refuses" not in alarms(b)


def test_two_refusals_are_none() -> None:
    b = working()
    b.node.refused[1] = 2
    b.run(6.0)
    assert "node_refuses" not in b.names()


@pytest.mark.parametrize("changed", [{"target_clearance_um": 65.0}, {"target_pressure_bar": 2.0}])
def test_another_target_than_the_commanded_one_is_an_alarm(changed: dict[str, float]) -> None:
    b = working()
    reporting(b, **changed)
    assert until(b, "node_target_differs", 1.5) < 1.0
    assert not state(b).authority
    b.tamper = list
    b.until(lambda: b.authority, 4.0)


def in_part(b: Bench, says: Callable[[int], bool], **changed: object) -> None:
    """From now on those NODE_STATE say so whose number is one."""
    reporting(b, **changed)
    tampered, plain = b.tamper, [0]

    def mixed(frames: list) -> list:
        plain[0] += any(isinstance(CODEC.decode(f), NodeState) for f in frames)
        return tampered(frames) if says(plain[0]) else frames

    b.tamper = mixed


@pytest.mark.parametrize("of_ten", ["XXXXXX....", "X.X.X.X.X.", "XX.XX.X..X", "X........."])
def test_a_doubt_that_comes_and_goes_adds_up_and_stays(of_ten: str) -> None:
    b = working()
    in_part(b, lambda n: of_ten[n % 10] == "X", target_clearance_um=66.0)
    b.run(2.5)
    half = of_ten.count("X") >= 5
    assert b.names().count("node_target_differs") == half
    assert "node_target_differs_ended" not in b.names()
    assert state(b).authority != half
    b.tamper = list
    b.run(0.7)
    assert "node_target_differs" not in alarms(b)


def claiming(b: Bench, counter: Callable[[int], int]) -> None:
    """From now on NODE_STATE reports a command counter made of the true one."""

    def tampered(frames: list) -> list:
        out = []
        for frame in frames:
            message = CODEC.decode(frame)
            if isinstance(message, NodeState):
                told = msgspec.structs.replace(
                    message, command_counter=counter(message.command_counter)
                )
                frame = CODEC.encode(told, frame.arrival_ns)
            out.append(frame)
        return out

    b.tamper = tampered


def test_a_snapshot_of_a_version_without_some_alarms_goes_on() -> None:
    b = working()
    snapshot = b.core.snapshot(1, b.now_ns)
    older = msgspec.msgpack.decode(snapshot.state, type=CoreState)
    assert older.supervision is not None
    assert older.readings is not None
    for named in (older.readings.alarms, older.pair.kinds):
        del named["blind" if "blind" in named else "rest"]
    for named in (
        older.supervision.node.conditions,
        older.supervision.node.doubted,
        older.supervision.node.cleared,
    ):
        del named["node_counter_frozen"]
    core = GuardCore(b.config, CODEC, SESSION)
    core.restore(msgspec.structs.replace(snapshot, state=msgspec.msgpack.encode(older)))
    b.core = core
    claiming(b, lambda newest: 0)
    b.node.frozen_channel, b.node.pressure_bar = 6, 60.0
    until(b, "node_counter_frozen", 2.0)
    until(b, "pressure_unknown", 2.0)


@pytest.mark.parametrize("counter", ["stands", "zero", "behind"])
def test_a_command_counter_that_does_not_follow_the_commands_is_an_alarm(counter: str) -> None:
    b = working()
    stood = b.node.command_counter
    claiming(b, lambda newest: {"stands": stood, "zero": 0, "behind": newest - 25}[counter])
    assert until(b, "node_counter_frozen", 2.0) < 0.8
    assert not state(b).authority
    told = text_of(b, "node_counter_frozen")
    assert "the newest that was sent is" in told
    b.tamper = list
    b.until(lambda: b.authority, 4.0)
    assert "node_counter_frozen" not in alarms(b)


def test_a_command_counter_that_is_late_or_has_not_begun_is_none() -> None:
    b = working()
    newest: list[int] = []

    def late(counter: int) -> int:
        newest.append(counter)
        return newest[-6] if len(newest) > 6 else 0

    b.ask("disarm")
    b.run(0.5)
    b.ask("arm")
    b.run(0.02)
    claiming(b, late)
    b.run(2.0)
    assert not [name for name in b.names() if name.startswith("node_")]


def test_a_target_cut_by_the_nodes_own_range_is_one_alarm() -> None:
    b = working()
    b.node.obeys = True
    hear = b.node.hear

    def clipped(frames: list) -> None:
        hear(frames)
        b.node.target_um = min(b.node.target_um, 62.0)

    b.node.hear = clipped  # type: ignore[method-assign]
    until(b, "node_target_differs", 1.5)
    b.run(0.1)
    assert "clearance_not_following" not in b.names()


def test_safe_with_another_target_than_the_boot_value_bars_arming() -> None:
    b = Bench()
    b.run(1.5)
    reporting(b, target_clearance_um=130.0)
    until(b, "node_target_differs", 1.0)
    b.ask("mode", mode=2)
    assert not b.ask("arm")[0]


def test_commands_that_never_expire_are_an_alarm_after_disarming() -> None:
    b = working()
    b.node.expires = False
    b.ask("disarm")
    assert until(b, "node_not_expired", 2.0) < 0.7
    assert not b.ask("arm")[0]


@pytest.mark.parametrize("changed", [{"session": 0x9999}, {"command_counter": 60_000}])
def test_a_node_that_follows_commands_which_were_not_sent_disarms_once_confirmed(
    changed: dict[str, int],
) -> None:
    b = working()
    reporting(b, mode=1, **changed)
    took_s = until(b, "node_elsewhere", 1.0)
    assert 0.15 <= took_s <= 0.3
    found = state(b)
    assert found.arm_state == ArmState.DISARMED
    assert found.run_permit
    assert not b.ask("arm")[0]
    b.tamper = list
    b.run(1.0)
    assert b.ask("arm")[0]


def test_one_such_report_is_not_enough() -> None:
    b = working()
    for _ in range(3):
        reporting(b, session=0x9999)
        b.run(0.1)
        b.tamper = list
        b.run(0.1)
    assert state(b).arm_state == ArmState.ARMED


@pytest.mark.parametrize("trips", [False, True])
def test_the_permit_goes_with_a_foreign_command_only_where_that_is_configured(trips: bool) -> None:
    config = bench()
    b = Bench(config.replaced(drive=msgspec.structs.replace(config.drive, trip_on_foreign=trips)))
    b.armed()
    reporting(b, mode=1, session=0x9999)
    until(b, "node_elsewhere", 1.0)
    assert state(b).run_permit != trips
    beats = [
        m
        for d in b.run(0.2)
        for m in map(CODEC.decode, d.frames_out)
        if isinstance(m, DeviceHeartbeat)
    ]
    assert {beat.run_permit for beat in beats} == {not trips}
    assert not any(beat.trip_request for beat in beats)


@pytest.mark.parametrize("how", ["disarm", "monitor", "no samples", "again and again"])
def test_a_node_whose_commands_have_ended_is_safe_and_no_alarm(how: str) -> None:
    b = working()
    if how == "disarm":
        b.ask("disarm")
    elif how == "monitor":
        b.ask("mode", mode=0)
    elif how == "again and again":
        for _ in range(4):
            b.ask("disarm")
            b.run(0.137)
            b.ask("arm")
            b.run(0.3)
        b.ask("disarm")
    else:
        b.node.running = False
        b.run(0.3)
        b.node.running = True
    b.run(1.5)
    assert not [name for name in b.names() if name.startswith("node_")]


def test_a_state_that_speaks_of_the_past_is_an_alarm() -> None:
    b = working()
    reporting(b, tick_us=(b.node.tick_at(b.now_ns) - 600_000) & 0xFFFFFFFF)
    until(b, "node_state_frozen", 1.0)
    assert state(b).arm_state == ArmState.RECOVERY


def test_a_node_that_restarts_while_it_moves_is_none() -> None:
    b = working()
    b.advise_um = 95.0
    b.run(0.3)
    b.node.refused[0] = 40
    b.node.restart()
    b.run(6.0)
    assert not [
        e.name
        for e in b.events
        if "not_following" in e.name or e.name in ("node_refuses", "two_senders")
    ]
    assert state(b).authority


# ------------------------------------------------------------------ memory


def test_a_snapshot_carries_the_supervision_and_an_old_one_may_lack_it() -> None:
    b = working()
    b.node.actuate = lambda target: 50.0
    until(b, "clearance_not_following", 4.0)
    taken = b.core.snapshot(b.seq, b.now_ns)
    other = GuardCore(b.config, CanCodec(), SESSION)
    other.restore(taken)
    assert list(other.stages.supervision.doubts) == ["clearance_not_following"]
    old = msgspec.msgpack.decode(taken.state, type=CoreState)
    old.supervision = None
    fresh = GuardCore(b.config, CanCodec(), SESSION)
    fresh.restore(msgspec.structs.replace(taken, state=msgspec.msgpack.encode(old)))
    assert fresh.stages.supervision.doubts == {}


def test_the_window_of_targets_keeps_what_was_valid_in_it() -> None:
    spans: list[Span] = []
    for k in range(100):
        note(spans, k * 10 * MS, float(k), 400 * MS)
        assert len(spans) <= 10
    low, high = extremes(spans)
    assert high == 99.0
    assert 53.0 <= low <= 59.0
    note(spans, 1000 * MS, 10.0, 400 * MS)
    for k in range(1001, 2000):
        note(spans, k * MS, 99.0, 400 * MS)
    assert extremes(spans) == (99.0, 99.0)
    assert len(spans) == 1
