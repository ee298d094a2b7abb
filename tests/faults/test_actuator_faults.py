"""The whole rig in software with an ill actuator or node: which alarm, and when."""

from copy import deepcopy
from functools import cache

import pytest

from firmware_py.config import SHIPPED, load
from firmware_py.guard.core import GuardCore
from firmware_py.records import CommandRequest, Cycle, Event, RawFrame
from firmware_py.wire.link import codec_for
from sim_hil.faults import ACTUATOR_FAULTS, NODE_FAULTS, UnknownFault, check_fault
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.rigs import load_rig

MS = 1_000_000
ARM_MS, FAULT_MS, MOVE_MS = 1500, 3500, 4000


class Played:
    """Rig and guard core against each other, a millisecond a step."""

    def __init__(self) -> None:
        config = load(SHIPPED / "bench")[0]
        drawing, codec = load_rig("bench"), codec_for(config)
        self.rig = Rig(drawing, codec, node_limits(drawing, config), 3)
        self.core = GuardCore(config, codec, 77)
        self.out: list[RawFrame] = []
        self.events: list[tuple[float, Event]] = []
        """With their time after the move to 90 um, s."""
        self.steps = 0

    def until(self, end: int, *asked: CommandRequest, alarm: str = "") -> None:
        """Step to ``end``, or to ``alarm``; what is asked comes with the first step."""
        commands = list(asked)
        while self.steps < end and not (alarm and alarm in self.told()):
            now_ns = 10**12 + (self.steps + 1) * MS
            frames = self.rig.step(now_ns, self.out)
            decision = self.core.step(
                Cycle(self.steps, now_ns, frames, None, commands, True, True, True)
            )
            self.out, commands = decision.frames_out, []
            self.events += [(1e-3 * (self.steps - MOVE_MS), event) for event in decision.events]
            self.steps += 1

    def told(self) -> list[str]:
        """Names of the events so far."""
        return [event.name for _, event in self.events]


@cache
def _at_60_um(arms: bool) -> Played:
    """Armed (or not) and, if so, moved to 60 um by hand, up to where a fault begins."""
    made = Played()
    made.until(ARM_MS)
    asked = (
        CommandRequest(1, "mode", mode=1),
        CommandRequest(2, "arm"),
        CommandRequest(3, "set_clearance", 60.0),
    )
    made.until(FAULT_MS, *(asked if arms else ()))
    return made


@cache
def played(
    fault: str, severity: float, seconds: float, *, arms: bool = True, alarm: str = ""
) -> list[tuple[float, Event]]:
    """Events, until ``alarm``, with their time after the move to 90 um (manual), which follows the
    fault by half a second."""
    made = deepcopy(_at_60_um(arms))
    if fault:
        made.rig.inject(fault, severity)
    made.until(MOVE_MS)
    made.until(
        MOVE_MS + round(seconds * 1000),
        *([CommandRequest(4, "set_clearance", 90.0)] if arms else ()),
        alarm=alarm,
    )
    return made.events


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
    events = played(fault, severity, within_s, alarm=alarm)
    told = [t for t, event in events if event.name == alarm]
    assert told
    assert told[0] <= within_s


def test_a_runaway_is_told_while_disarmed() -> None:
    alarm = "clearance_not_following"
    events = played("actuator_runaway", 0.3, 2.5, arms=False, alarm=alarm)
    assert alarm in [event.name for _, event in events]


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
