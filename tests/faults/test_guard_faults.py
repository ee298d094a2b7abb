"""What the guard does when something around it fails; all on the simulated clock."""

from collections.abc import Callable

import pytest

from firmware_py.records import (
    Advice,
    ArmState,
    Command,
    DeviceHeartbeat,
    GuardState,
    RawFrame,
    SampleFrame,
)
from firmware_py.wire.codec import CanCodec

from ..guard.scripted_node import MS, SESSION, Bench, working

CODEC = CanCodec()
SAMPLES = 0x0C0


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def commands(b: Bench, seconds: float) -> list[Command]:
    frames = [f for d in b.run(seconds) for f in d.frames_out]
    return [m for m in map(CODEC.decode, frames) if isinstance(m, Command)]


# ------------------------------------------------------------------ frames


@pytest.mark.parametrize(
    ("damage", "counter"),
    [
        (lambda f: RawFrame(f.arrival_ns, f.frame_id, f.data[:-1]), "reject_length"),
        (lambda f: RawFrame(f.arrival_ns, f.frame_id, b""), "reject_length"),
        (
            lambda f: RawFrame(f.arrival_ns, f.frame_id, f.data[:-1] + bytes([f.data[-1] ^ 0x10])),
            "reject_crc",
        ),
        (lambda f: RawFrame(f.arrival_ns, 0x0B0, f.data), "reject_length"),
        (lambda f: RawFrame(f.arrival_ns, 0x7FF, f.data), "reject_unknown_id"),
        (lambda f: f, "reject_repeated"),
    ],
)
def test_a_bad_frame_beside_the_good_ones_is_counted_and_changes_nothing(
    damage: Callable[[RawFrame], RawFrame], counter: str
) -> None:
    b = working()
    b.tamper = lambda frames: [
        each for f in frames for each in ([f, damage(f)] if f.frame_id == SAMPLES else [f])
    ]
    b.run(0.2)
    found = state(b)
    assert found.counters[counter] > 300
    assert found.authority
    assert found.counters["frames_lost"] == 0


def test_a_late_frame_is_dropped_and_counted() -> None:
    b = working()
    old = next(f for f in b.cycles[-10].frames if f.frame_id == SAMPLES)
    b.extra = [old]
    b.cycle()
    found = state(b)
    assert found.counters["reject_reordered"] == 1
    assert found.authority


def test_a_forged_far_counter_does_not_blind_the_guard() -> None:
    b = working()
    sample = next(
        f for f in reversed(b.cycles[-1].frames + b.cycles[-2].frames) if f.frame_id == SAMPLES
    )
    message = CODEC.decode(sample)
    assert isinstance(message, SampleFrame)
    forged = SampleFrame(
        (message.counter + 20_000) & 0xFFFF,
        message.tick_us,
        message.mark_tick_us,
        message.turn_count,
        message.flags,
        message.samples,
    )
    b.extra = [CODEC.encode(forged, b.now_ns)]
    b.run(0.5)
    assert state(b).authority


def test_lost_frames_are_counted_exactly() -> None:
    b = working()
    before = state(b).counters["frames_lost"]
    for _ in range(5):
        b.node.counter(SampleFrame)
    b.run(0.2)
    assert state(b).counters["frames_lost"] - before == 5


def test_frames_that_come_200_ms_late_are_not_fresh_and_stop_the_commands() -> None:
    b = working()
    held: list[list[RawFrame]] = []

    def late(frames: list[RawFrame]) -> list[RawFrame]:
        held.append([RawFrame(f.arrival_ns + 200 * MS, f.frame_id, f.data) for f in frames])
        return held.pop(0) if len(held) > 200 else []

    b.tamper = late
    commands(b, 0.1)
    assert not commands(b, 2.0)
    assert "samples_stale" in b.names()


# ------------------------------------------------------------------ rooms


def test_brain_loss_takes_authority_at_once_and_the_target_is_safe() -> None:
    b = working()
    b.brain = False
    b.cycle()
    found = state(b)
    assert not found.authority
    assert found.target_clearance_um == 50.0
    assert found.arm_state == ArmState.ARMED
    assert {m.clearance_um for m in commands(b, 0.5)} == {50.0}
    b.brain = True
    b.run(3.0)
    assert state(b).authority


def test_a_brain_that_hangs_loses_authority_when_its_advice_expires() -> None:
    b = working()
    stale = Advice(10_000, b.now_ns, b.now_ns, 300 * MS, 70.0, None, True, [], None)
    b.advice = lambda: stale  # type: ignore[method-assign]
    b.run(0.15)
    assert state(b).authority
    b.run(0.3)
    found = state(b)
    assert not found.authority
    assert "the advice has expired" in found.authority_reasons


def test_gate_loss_is_told_and_control_goes_on() -> None:
    b = working()
    b.gate = False
    b.run(1.0)
    assert "gate_lost" in b.names()
    assert state(b).authority


# ------------------------------------------------------------------ link and node


def test_link_loss_means_recovery_without_commands_and_comes_back_by_itself() -> None:
    b = working()
    b.link_up = False
    assert not commands(b, 1.0)
    assert state(b).arm_state == ArmState.RECOVERY
    b.link_up = True
    b.run(4.0)
    assert state(b).arm_state == ArmState.ARMED
    assert "recovered" in b.names()


def test_a_link_that_stays_away_ends_disarmed() -> None:
    b = working()
    b.link_up = False
    for _ in range(61 * 20):
        b.now_ns += 49 * MS
        b.cycle()
    assert state(b).arm_state == ArmState.DISARMED


def test_a_node_that_stops_for_two_seconds() -> None:
    b = working()
    b.node.running = False
    said = commands(b, 2.0)
    assert len(said) <= 2, "nothing is commanded on samples older than the limit"
    assert state(b).arm_state == ArmState.RECOVERY
    b.node.running = True
    back = commands(b, 1.0)
    assert {m.clearance_um for m in back} == {50.0}
    b.run(5.0)
    found = state(b)
    assert found.authority
    assert found.counters["clock_jumps"] == 1


def test_a_node_that_restarts_is_checked_again_before_it_is_commanded() -> None:
    b = working()
    b.node.restart()
    b.run(0.05)
    assert state(b).arm_state == ArmState.RECOVERY
    assert state(b).counters["node_restarts"] == 1
    b.run(5.0)
    assert state(b).arm_state == ArmState.ARMED


def test_a_node_that_came_back_as_another_disarms() -> None:
    b = working()
    b.node.restart()
    b.node.info_boot_um = 80.0
    b.run(3.0)
    assert state(b).arm_state == ArmState.DISARMED
    assert "node_mismatch" in b.names()


def test_the_guard_stopped_for_two_seconds_discards_what_it_had_computed() -> None:
    b = working()
    b.now_ns += 2000 * MS
    decision = b.cycle()
    out = [m for m in map(CODEC.decode, decision.frames_out) if isinstance(m, Command)]
    assert all(m.clearance_um == 50.0 for m in out)
    found = state(b)
    assert not found.authority
    assert found.counters["cycle_gaps"] == 1
    assert found.arm_state == ArmState.RECOVERY


# ------------------------------------------------------------------ a second device


def test_a_second_device_that_commands_disarms_and_bars_arming() -> None:
    b = working()
    b.extra = [CODEC.encode(Command(1, 0x9999, 0, 120.0, 1.0), b.now_ns)]
    b.cycle()
    assert state(b).arm_state == ArmState.DISARMED
    assert "foreign_device" in b.names()
    accepted, reasons = b.ask("arm")
    assert not accepted
    assert any("another device sends commands" in r for r in reasons)
    b.run(6.0)
    assert b.ask("arm")[0]


def test_a_second_device_that_only_beats_takes_authority() -> None:
    b = working()
    for _ in range(10):
        b.extra = [CODEC.encode(DeviceHeartbeat(1, 0x9999, 0, 2, True, False), b.now_ns)]
        b.run(0.05)
    found = state(b)
    assert not found.authority
    assert found.arm_state == ArmState.ARMED
    assert found.counters["foreign"] == 10


def test_a_masquerade_in_our_own_name_disarms() -> None:
    b = working()
    b.extra = [CODEC.encode(Command(9, SESSION, 0, 120.0, 1.0), b.now_ns)]
    b.cycle()
    found = state(b)
    assert found.arm_state == ArmState.DISARMED
    assert found.counters["reject_masquerade"] == 1
    assert "masquerade" in b.names()


# ------------------------------------------------------------------ sensors


def test_a_dead_probe_takes_authority_and_names_itself() -> None:
    b = working()
    b.node.frozen_channel = 0
    b.run(1.0)
    found = state(b)
    assert not found.authority
    assert "disp_x_not_ok" in [a.name for a in found.alarms]
    assert found.arm_state == ArmState.ARMED


def test_a_lost_mark_takes_authority() -> None:
    b = working()
    b.node.mark_valid = False
    b.run(0.2)
    found = state(b)
    assert not found.authority
    assert found.target_clearance_um == 50.0


@pytest.mark.parametrize(("rpm", "kept"), [(12000.0, True), (12300.0, False)])
def test_a_speed_beyond_the_declared_range_takes_authority(rpm: float, kept: bool) -> None:
    b = working()
    b.advise_um = 55.0
    b.node.mean_um = (-5.0, -5.0)
    b.ramp_to(rpm)
    b.run(0.3)
    assert state(b).authority == kept


@pytest.mark.parametrize(("amplitude_um", "kept"), [(17.0, True), (26.0, False)])
def test_vibration_beyond_the_set_point_takes_authority_before_the_danger_delay(
    amplitude_um: float, kept: bool
) -> None:
    b = working()
    b.node.clearance_um = 70.0
    b.run(0.1)  # until it is reported
    b.node.amplitude_um = amplitude_um
    b.run(0.4)
    found = state(b)
    assert found.authority == kept
    assert not found.trip_request


@pytest.mark.parametrize("frame_id", [0x0A0, 0x0B0])
def test_a_node_that_stops_reporting_is_not_commanded_on_old_reports(frame_id: int) -> None:
    b = working()
    b.tamper = lambda frames: [f for f in frames if f.frame_id != frame_id]
    b.run(0.7)
    assert state(b).arm_state == ArmState.RECOVERY
    assert state(b).target_clearance_um == 50.0
