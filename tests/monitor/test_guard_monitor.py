"""The guard on machines that are monitor only: it protects, and commands and guesses nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_py import config
from firmware_py.config import Config
from firmware_py.gate.metrics import render
from firmware_py.gate.view import DeviceState
from firmware_py.guard import report
from firmware_py.guard.core import GuardCore
from firmware_py.records import ArmState, Command, CommandReply, DeviceHeartbeat, GuardState, Mode
from tests.machine.test_parts import least as least  # the folder of the least machine
from tests.monitor.generator import Run

KIT = config.load(config.SHIPPED / "kit")[0]


def replies(run: Run) -> list[CommandReply]:
    return [record for record in run.said if isinstance(record, CommandReply)]


@pytest.fixture(scope="module")
def quiet() -> Run:
    """The kit after eight quiet seconds."""
    run = Run(KIT)
    run.seconds(8.0)
    return run


def test_a_quiet_machine_has_no_alarm_and_its_permit(quiet: Run) -> None:
    assert quiet.alarms() == set()
    state = report.guard_state(quiet.guard.stages, quiet.now_ns)
    assert state.run_permit
    assert not state.trip_request
    assert state.arm_state == ArmState.DISARMED
    assert state.mode == Mode.MONITOR
    assert state.monitor_only.startswith("no [actuator]")
    assert state.authority_reasons[0].startswith("monitor only: no [actuator]")
    assert state.peak_to_peak_um[0] == pytest.approx(18, abs=3)
    assert state.other_peak_to_peak_um["nde"][1] == pytest.approx(18, abs=3)
    assert state.speed_rad_s == pytest.approx(314.16, rel=1e-3)


def test_no_figure_of_a_stand_in_is_told(quiet: Run) -> None:
    state = report.guard_state(quiet.guard.stages, quiet.now_ns)
    assert (
        state.load_estimate_N, state.clearance_low_um, state.clearance_high_um,
        state.target_clearance_um, state.target_pressure_bar, state.clearance_actual_um,
    ) == (0.0,) * 6  # fmt: skip


def test_the_heartbeat_goes_out_and_never_a_command(quiet: Run) -> None:
    sent = [quiet.node.codec.decode(frame) for frame in quiet.node.heard]
    assert any(isinstance(message, DeviceHeartbeat) and message.run_permit for message in sent)
    assert not any(isinstance(message, Command) for message in sent)


@pytest.mark.parametrize("ask", [
    ("arm", None, None), ("mode", None, 1), ("mode", None, 2), ("set_clearance", 60.0, None),
    ("set_pressure", 1.0, None), ("announce", None, None),
])  # fmt: skip
def test_what_would_move_something_is_refused_with_the_reason(
    ask: tuple[str, float | None, int | None],
) -> None:
    run = Run(KIT)
    run.seconds(0.1)
    run.device.command(*ask)
    run.seconds(0.02)
    (reply,) = replies(run)
    assert not reply.accepted
    assert reply.reasons[0].startswith("monitor only: no [actuator]: nothing can be commanded")


def test_monitor_mode_disarm_and_reset_are_taken() -> None:
    run = Run(KIT)
    run.seconds(0.1)
    for ask in (("mode", None, 0), ("disarm",), ("reset",)):
        run.device.command(*ask)  # type: ignore[arg-type]
    run.seconds(0.02)
    assert [reply.accepted for reply in replies(run)] == [True] * 3


def test_a_vibration_of_the_second_bearing_trips_there(tmp_path: Path) -> None:
    run = Run(KIT)
    run.seconds(1.0)
    run.node.orbits["nde"].forward_um = 70.0
    run.seconds(3.0)
    assert {"nde_x_danger", "nde_y_danger"} <= set(run.guard.tripped)
    state = report.guard_state(run.guard.stages, run.now_ns)
    assert state.trip_request
    assert not state.run_permit
    assert not any(name.startswith("disp_") for name in run.alarms())
    again = Run(KIT, latched=run.guard.tripped)  # the trip outlives the guard
    again.seconds(0.5)
    assert set(again.guard.tripped) == set(run.guard.tripped)
    again.device.command("reset")
    again.seconds(0.5)
    assert again.guard.tripped == []


def test_a_danger_that_is_counting_outlives_the_guard() -> None:
    run = Run(KIT)
    run.seconds(1.0)
    run.node.orbits["nde"].forward_um = 70.0
    run.seconds(0.6)
    timers = run.guard.timers
    assert {"nde_x_danger", "nde_y_danger"} <= set(timers)
    again = GuardCore(KIT, run.node.codec, 1, timers=timers)
    assert again.timers == timers


def test_a_broken_cable_at_the_second_bearing_is_named_and_trips_nothing() -> None:
    run = Run(KIT)
    run.seconds(1.0)
    run.node.dead.add("nde_y")
    run.seconds(2.0)
    assert "nde_y_not_ok" in run.alarms()
    assert run.guard.tripped == []
    state = report.guard_state(run.guard.stages, run.now_ns)
    assert state.channel_causes == {"nde_y": "open"}
    assert "nde_y_not_ok" in run.events


@pytest.mark.parametrize("name", ["de", "nde"])
def test_an_orbit_against_the_rotation_is_told_of_its_bearing(name: str) -> None:
    run = Run(KIT)
    run.seconds(1.0)
    orbit = run.node.orbits[name]
    orbit.forward_um, orbit.backward_um = 0.0, 25.0
    run.seconds(5.0)
    pair = {"de": "disp_pair_backward", "nde": "nde_pair_backward"}[name]
    assert run.alarms() == {pair}


def test_a_shaft_outside_the_drawing_is_implausible() -> None:
    run = Run(KIT)
    run.node.orbits["nde"].mean_um = 0 - 225j
    run.seconds(5.0)
    assert "nde_pair_outside" in run.alarms()
    assert not any("pair" in name and not name.startswith("nde") for name in run.alarms())


def test_too_fast_trips_and_a_lost_mark_is_told() -> None:
    run = Run(KIT)
    run.node.speed_rpm = 9000.0
    run.seconds(1.0)
    while run.node.speed_rpm < 10_200:
        run.node.speed_rpm += 20.0
        run.seconds(0.02)
    run.seconds(1.0)
    assert "speed_high" in run.guard.tripped


def test_metrics_tell_every_bearing_and_no_envelope(quiet: Run) -> None:
    guard = report.guard_state(quiet.guard.stages, quiet.now_ns)
    told = render(gate_state(guard), None).decode()
    assert 'orbitd_peak_to_peak_um{probe="nde_x"}' in told
    assert "orbitd_trip_request 0.0" in told
    assert "clearance" not in told


def gate_state(guard: GuardState) -> DeviceState:
    return DeviceState(
        site="lab", rig="kit", instance="default", version="0", now_ns=0, unix_ns=0, rooms={},
        guard=guard, reading=None, diagnosis=None, forecast=None, advice=None, brain=None,
        commission=None, normal="", alarms=[], recording="", counters={},
    )  # fmt: skip


def least_config(folder: Path) -> Config:
    return config.load(folder)[0]


def test_the_least_machine_is_protected_without_a_clearance(least: Path) -> None:
    run = Run(least_config(least))
    run.seconds(4.0)
    assert run.alarms() == set()
    assert run.guard.stages.protection.set_points_um(float("inf")) == (60.0, 90.0)
    run.node.orbits[""].forward_um = 50.0
    run.seconds(3.0)
    assert set(run.guard.tripped) == {"disp_x_danger", "disp_y_danger"}


def test_a_snapshot_goes_on_where_it_was() -> None:
    run = Run(KIT)
    run.node.orbits["nde"].forward_um = 70.0
    run.seconds(3.0)
    snapshot = run.guard.snapshot(1, run.now_ns)
    other = Run(KIT)
    other.guard.restore(snapshot)
    assert other.guard.tripped == run.guard.tripped


def with_oil(least: Path) -> Config:
    """The least machine with a thermometer in the outlet, and limits for it and no more."""
    machine, device = least / "machine.toml", least / "device.toml"
    machine.write_text(machine.read_text() + '\n[[reading]]\nname = "oil_outlet"\n')
    limits = "[limits]\noil_outlet_high_alert_C = 60.0\noil_outlet_high_danger_C = 70.0\n"
    device.write_text(device.read_text().replace("[limits]\n", limits))
    return config.load(least)[0]


def test_a_reading_with_limits_is_protected_without_a_lubricant(least: Path) -> None:
    run = Run(with_oil(least))
    run.node.readings["oil_outlet"] = 50.0
    run.seconds(2.0)
    assert run.alarms() == set()
    while run.node.readings["oil_outlet"] < 75.0:
        run.node.readings["oil_outlet"] += 0.5
        run.seconds(0.1)
    run.seconds(2.0)
    assert run.guard.tripped == ["oil_outlet_high_danger"]


def test_a_reading_that_is_lost_is_told_and_trips_nothing(least: Path) -> None:
    run = Run(with_oil(least))
    run.node.readings["oil_outlet"] = 50.0
    run.seconds(1.0)
    run.node.readings["oil_outlet"] = 300.0
    run.seconds(3.0)
    assert run.alarms() == {"oil_outlet_not_ok"}
    assert run.guard.tripped == []
