"""The whole rig in software with an ill actuator or node: which alarm, and when."""

import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.guard.core import GuardCore
from firmware_py.records import CommandRequest, Cycle, Event, RawFrame
from firmware_py.wire.link import codec_for
from sim_hil.faults import ACTUATOR_FAULTS, NODE_FAULTS, UnknownFault, check_fault
from sim_hil.rig import Rig, node_limits
from sim_hil.rigs import load_rig

MS = 1_000_000
ARM_MS, FAULT_MS, MOVE_MS = 1500, 3500, 4000


def played(
    fault: str, severity: float, seconds: float, *, arms: bool = True
) -> list[tuple[float, Event]]:
    """Events with their time after the move to 90 um (manual), which follows the fault by half a
    second."""
    config = load(SHIPPED / "bench.toml")[0]
    drawing, codec = load_rig("bench"), codec_for(config)
    rig = Rig(drawing, codec, node_limits(drawing, config), 3)
    core, now_ns, out, events = (
        GuardCore(config, codec, 77),
        10**12,
        list[RawFrame](),
        list[tuple[float, Event]](),
    )
    for k in range(MOVE_MS + round(seconds * 1000)):
        now_ns += MS
        commands: list[CommandRequest] = []
        if k == ARM_MS and arms:
            commands = [
                CommandRequest(1, "mode", mode=1),
                CommandRequest(2, "arm"),
                CommandRequest(3, "set_clearance", 60.0),
            ]
        if k == FAULT_MS and fault:
            rig.inject(fault, severity)
        if k == MOVE_MS and arms:
            commands = [CommandRequest(4, "set_clearance", 90.0)]
        frames = rig.step(now_ns, out)
        decision = core.step(Cycle(k, now_ns, frames, None, commands, True, True, True))
        out = decision.frames_out
        events += [(1e-3 * (k - MOVE_MS), event) for event in decision.events]
    return events


@pytest.mark.parametrize(
    ("fault", "severity", "alarm", "within_s"),
    [
        ("actuator_stuck", 1.0, "clearance_not_following", 3.0),
        ("actuator_runaway", 1.0, "clearance_not_following", 3.0),
        ("actuator_slow", 0.5, "clearance_not_following", 2.0),
        ("actuator_slow", 0.8, "clearance_not_following", 2.0),
        ("actuator_offset", 0.5, "clearance_not_following", 3.0),
        ("actuator_reversed", 1.0, "clearance_not_following", 3.0),
        ("pressure_lost", 1.0, "pressure_not_following", 3.0),
        ("pressure_lost", 0.5, "pressure_not_following", 3.0),
        ("node_refuses", 1.0, "node_not_following", 1.5),
        ("node_refuses", 1.0, "node_refuses", 1.5),
    ],
)
def test_each_fault_is_its_alarm_in_time(
    fault: str, severity: float, alarm: str, within_s: float
) -> None:
    told = [t for t, event in played(fault, severity, within_s) if event.name == alarm]
    assert told
    assert told[0] <= within_s


def test_a_runaway_is_told_while_disarmed() -> None:
    names = [event.name for _, event in played("actuator_runaway", 0.3, 2.5, arms=False)]
    assert "clearance_not_following" in names


def test_a_healthy_rig_moves_without_a_word() -> None:
    names = {event.name for _, event in played("", 0.0, 3.0)}
    assert not [
        name for name in names if "not_following" in name or name.startswith(("node_", "two_"))
    ]


@pytest.mark.parametrize("fault", [*ACTUATOR_FAULTS, *NODE_FAULTS])
def test_severities_outside_their_range_are_refused(fault: str) -> None:
    check_fault(fault, 1.0)
    with pytest.raises(UnknownFault, match=r"outside 0 \.\. 1"):
        check_fault(fault, 1.5)
