import msgspec
import pytest

from firmware_py.guard.core import GuardCore
from firmware_py.guard.facts import SHIELD_PERIOD_NS
from firmware_py.guard.state import CoreState
from firmware_py.records import (
    ArmState,
    Command,
    CommandRequest,
    Cycle,
    Decision,
    DeviceHeartbeat,
    GuardState,
    Mode,
    RawFrame,
    Snapshot,
)
from firmware_py.wire.codec import CanCodec

from .scripted_node import MS, SESSION, Bench, armed, bench

CODEC = CanCodec()


def state(b: Bench) -> GuardState:
    """The next published state."""
    return next(d.state for d in iter(b.cycle, None) if d.state)


def sent(decisions: list[Decision], kind: type) -> list[RawFrame]:
    frames = [f for d in decisions for f in d.frames_out]
    return [f for f in frames if isinstance(CODEC.decode(f), kind)]


# ------------------------------------------------------------------ arming


def test_a_new_installation_monitors_checks_and_stays_disarmed() -> None:
    b = Bench()
    assert state(b).arm_state == ArmState.CHECK
    b.run(1.5)
    found = state(b)
    assert (found.mode, found.arm_state) == (Mode.MONITOR, ArmState.DISARMED)
    assert (found.run_permit, found.trip_request) == (True, False)


def test_arming_is_refused_with_all_reasons() -> None:
    b = Bench()
    b.link_up = False
    accepted, reasons = b.ask("arm")
    assert not accepted
    assert len(reasons) >= 4
    assert any("monitor" in r for r in reasons)
    assert any("link" in r for r in reasons)
    assert any("fresh" in r for r in reasons)


def test_a_node_that_is_not_the_configured_one_bars_arming() -> None:
    b = Bench()
    b.node.info_boot_um = 60.0
    b.run(1.5)
    b.ask("mode", mode=2)
    accepted, reasons = b.ask("arm")
    assert not accepted
    assert any(
        "boot clearance 60 um is not actuator.safe_radial_clearance_um = 50" in r for r in reasons
    )


def test_disarm_is_never_refused_and_goes_before_what_came_first() -> None:
    b = Bench()
    assert b.ask("disarm") == (True, [])
    b.armed(mode=1)
    decision = b.cycle(
        [
            CommandRequest(1, "set_clearance", 45.0),
            CommandRequest(2, "arm"),
            CommandRequest(3, "disarm"),
        ]
    )
    assert [r.seq for r in decision.replies] == [3, 1, 2]


@pytest.mark.parametrize(
    ("verb", "value", "mode", "why"),
    [
        ("set_clearance", 39.9, None, "outside 40 .. 160"),
        ("set_clearance", 160.1, None, "outside 40 .. 160"),
        ("set_clearance", None, None, "finite"),
        ("set_clearance", float("nan"), None, "finite"),
        ("set_pressure", 3.01, None, "outside 0.5 .. 3"),
        ("mode", None, 7, "not one of"),
        ("mode", None, None, "not one of"),
        ("fly", None, None, "unknown verb"),
    ],
)
def test_bad_requests_are_refused_by_name(
    verb: str, value: float | None, mode: int | None, why: str
) -> None:
    b = armed(mode=1)
    accepted, reasons = b.ask(verb, value, mode)
    assert not accepted
    assert why in reasons[0]


def test_set_points_belong_to_manual() -> None:
    b = armed(mode=2)
    accepted, reasons = b.ask("set_clearance", 60.0)
    assert not accepted
    assert "manual" in reasons[0]


@pytest.mark.parametrize("wish_um", [40.0, 45.0, 60.0, 90.0, 120.0, 160.0])
def test_manual_set_points_are_narrowed_by_the_shield(wish_um: float) -> None:
    b = armed(mode=1)
    assert b.ask("set_clearance", wish_um)[0]
    b.run(0.02 + abs(wish_um - 50.0) / b.config.machine.actuator.rate_um_s)
    found = state(b)
    assert found.clearance_low_um <= found.target_clearance_um <= found.clearance_high_um
    expected = min(max(wish_um, found.clearance_low_um), found.clearance_high_um)
    assert found.target_clearance_um == pytest.approx(expected)
    assert b.node.target_um == pytest.approx(expected, abs=0.02)


# ------------------------------------------------------------------ what goes out


def test_every_command_rests_on_an_interval_of_its_own_cycle() -> None:
    """With a command period that is none of the shield's."""
    config = bench()
    actuator = msgspec.structs.replace(config.machine.actuator, command_period_ms=33)
    b, commands = Bench(config.replaced(actuator=actuator)).armed(mode=1), 0
    for _ in range(1000):
        if sent([b.cycle()], Command):
            commands += 1
            assert b.core.stages.memory.shield_due_ns == b.now_ns + SHIELD_PERIOD_NS
    assert commands >= 30


def test_monitor_mode_sends_heartbeats_but_never_a_command() -> None:
    b = Bench()
    b.advise_um = 60.0
    decisions = b.run(3.0)
    assert not sent(decisions, Command)
    assert len(sent(decisions[1000:2000], DeviceHeartbeat)) == 20
    assert state(b).target_clearance_um == 60.0, "monitor shows what it would do"


def test_commands_go_out_every_period_and_echo_the_newest_tick() -> None:
    b = armed()
    decisions = b.run(1.0)
    frames = sent(decisions, Command)
    assert len(frames) == 50
    messages = [CODEC.decode(f) for f in frames]
    assert [m.counter for m in messages] == list(
        range(messages[0].counter, messages[0].counter + 50)
    )
    for frame, message in zip(frames, messages, strict=True):
        age_us = (b.node.tick_at(frame.arrival_ns) - message.echo_tick_us) & 0xFFFFFFFF
        assert age_us < 3000
        assert message.session == SESSION


def test_auto_follows_good_advice_and_no_other() -> None:
    b = armed()
    b.advise_um = 70.0
    b.run(1.5)
    assert state(b).target_clearance_um == 50.0
    b.run(1.5)
    assert state(b).target_clearance_um == 70.0
    b.advise_um = 500.0
    b.run(2.0)
    found = state(b)
    assert found.target_clearance_um == found.clearance_high_um < 160.0


def test_danger_trips_latches_and_sends_the_safe_command_in_the_same_cycle() -> None:
    b = armed()
    b.advise_um = 70.0
    b.run(4.0)
    b.node.amplitude_um = 40.0
    tripping = next(d for d in iter(b.cycle, None) if any(e.name == "tripped" for e in d.events))
    out = [CODEC.decode(f) for f in tripping.frames_out]
    command = next(m for m in out if isinstance(m, Command))
    heartbeat = next(m for m in out if isinstance(m, DeviceHeartbeat))
    assert command.clearance_um == 50.0
    assert (heartbeat.trip_request, heartbeat.run_permit, heartbeat.arm_state) == (
        True,
        False,
        ArmState.TRIPPED,
    )
    b.node.amplitude_um = 5.0
    b.run(2.0)
    assert state(b).arm_state == ArmState.TRIPPED
    assert not b.ask("arm")[0]
    assert b.ask("reset") == (True, [])
    b.run(0.2)
    assert state(b).arm_state == ArmState.DISARMED


def test_trip_latency_is_the_delay_and_one_block() -> None:
    b = armed()
    b.run(0.5)
    b.node.amplitude_um = 40.0
    start_ns = b.now_ns
    next(d for d in iter(b.cycle, None) if any(e.name == "tripped" for e in d.events))
    delay_ns = b.config.limits.danger_delay_s * 1e9
    assert delay_ns <= b.now_ns - start_ns <= delay_ns + 15 * MS


def test_a_trip_that_the_drive_must_not_obey_still_goes_to_safe() -> None:
    config = bench()
    b = Bench(
        config.replaced(drive=msgspec.structs.replace(config.drive, trip_on_danger=False))
    ).armed()
    b.node.amplitude_um = 40.0
    b.run(1.5)
    found = state(b)
    assert (found.arm_state, found.trip_request, found.run_permit) == (
        ArmState.TRIPPED,
        False,
        True,
    )
    assert found.target_clearance_um == 50.0


def test_a_restarted_guard_keeps_latched_trips() -> None:
    b = Bench(latched=["disp_x_danger"])
    decision = b.cycle()
    heartbeat = CODEC.decode(sent([decision], DeviceHeartbeat)[0])
    assert isinstance(heartbeat, DeviceHeartbeat)
    assert heartbeat.trip_request
    b.run(1.5)
    assert b.core.tripped == ["disp_x_danger"]
    assert b.ask("reset")[0]
    assert b.core.tripped == []


# ------------------------------------------------------------------ replay


def eventful(b: Bench) -> None:
    """Twenty seconds with arming, authority, a gap, a trip and a reset."""
    b.armed()
    b.advise_um = 80.0
    b.run(5.0)
    b.node.running = False
    b.run(0.4)
    b.node.running = True
    b.run(4.0)
    b.brain = False
    b.run(1.0)
    b.brain = True
    b.run(3.0)
    b.node.amplitude_um = 40.0
    b.run(2.0)
    b.node.amplitude_um = 5.0
    b.run(1.0)
    b.ask("reset")
    b.run(2.5)


def test_replay_from_a_snapshot_gives_the_same_bits() -> None:
    b = Bench(drift_ppm=50)
    encode, step = msgspec.msgpack.Encoder().encode, b.core.step
    decisions, snapshots = list[bytes](), dict[int, Snapshot]()

    def kept(cycle: Cycle) -> Decision:
        if len(decisions) % 1777 == 0:
            snapshots[len(decisions)] = b.core.snapshot(cycle.seq, cycle.now_ns)
        decision = step(cycle)
        decisions.append(encode(decision))
        return decision

    b.core.step = kept  # type: ignore[method-assign]
    eventful(b)
    assert len(b.cycles) > 20_000
    for k in (1777, 7 * 1777, 10 * 1777):
        again = GuardCore(b.config, CanCodec(), SESSION)
        again.restore(snapshots[k])
        for cycle, decision in zip(b.cycles[k : k + 4000], decisions[k : k + 4000], strict=True):
            assert encode(again.step(cycle)) == decision
        assert again.snapshot(0, 0).state


def test_a_snapshot_of_a_restored_guard_is_the_same_snapshot() -> None:
    b = armed()
    b.run(0.5)
    taken = b.core.snapshot(1, 2)
    other = GuardCore(b.config, CanCodec(), SESSION)
    other.restore(taken)
    assert other.snapshot(1, 2) == taken


# ------------------------------------------------------------------ events


def test_a_good_start_raises_no_alarm_and_a_bad_one_does() -> None:
    good, bad = Bench(), Bench()
    bad.link_up = False
    good.run(3.5)
    bad.run(3.5)
    assert set(good.names()) == {"gate_back", "brain_back", "run_permit_granted"}
    assert {"link_lost", "link_down", "samples_stale", "no_samples"} <= set(bad.names())


def test_a_trip_is_told_once_and_so_is_one_from_an_earlier_run() -> None:
    fresh, old = armed(), Bench(latched=["of_an_older_version_danger"])
    fresh.node.amplitude_um = 40.0
    fresh.run(1.5)
    old.run(1.5)
    assert fresh.names().count("tripped") == old.names().count("tripped") == 1
    assert old.core.tripped == ["of_an_older_version_danger"]
    assert old.ask("reset")[0]
    assert old.core.tripped == []


def test_a_snapshot_of_a_guard_that_did_not_judge_readings_is_restored() -> None:
    b = armed()
    taken = b.core.snapshot(b.seq, b.now_ns)
    old = msgspec.msgpack.decode(taken.state, type=CoreState)
    old.readings = None
    fresh = GuardCore(b.config, CanCodec(), SESSION)
    fresh.restore(msgspec.structs.replace(taken, state=msgspec.msgpack.encode(old)))
    assert fresh.tripped == b.core.tripped
    assert fresh.stages.arming.state == b.core.stages.arming.state
