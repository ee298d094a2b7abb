"""The short form of the random machines: three kinds that `check` calls good, and what the judge
sees."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_py import launch
from firmware_py.config import ConfigError
from firmware_py.config.source import Fault
from firmware_py.records import ArmState, Command, GuardState
from sim_hil.rigs import load_rig

from . import machines
from .config_cases import written
from .machine_cases import machine_case

SLOW_AND_MOVING, LONG, FAST = 6, 11, 32
"""Machines of seed 0: one below 720 rpm, one that is monitor only, one at 23 000 rpm.

The first lost its mark to a moving clearance, the last tripped on a build that was worse balanced
than the machine declares."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[machines.Loop, list[str]]]:
    """Each machine after its run, and what was wrong with it."""
    found = {}
    for i in (SLOW_AND_MOVING, LONG, FAST):
        path = written(machine_case(0, i), tmp_path_factory.mktemp("machine"))
        loop = machines.Loop(launch.verified(path)[0], load_rig(path), i)
        found[i] = loop, loop.judged()
    return found


@pytest.mark.timeout(120)
@pytest.mark.parametrize("i", [SLOW_AND_MOVING, LONG, FAST])
def test_what_check_calls_good_runs_in_the_closed_loop(
    i: int, flown: dict[int, tuple[machines.Loop, list[str]]]
) -> None:
    loop, wrong = flown[i]
    assert wrong == []
    states = [record for record in loop.told if isinstance(record, GuardState)]
    assert not [alarm.name for state in states for alarm in state.alarms]
    if i == LONG:
        assert loop.only
        assert loop.commands == []
    else:
        assert states[-1].arm_state == ArmState.ARMED
        assert loop.refused == []
        assert len({command.clearance_um for _, command in loop.commands}) > 5


def test_most_machines_are_called_good_and_the_rest_is_refused_by_name(tmp_path: Path) -> None:
    faults, refused = list[Fault](), 0
    for i in range(20):
        try:
            launch.verified(written(machine_case(1, i), tmp_path / str(i)))
        except ConfigError as error:
            faults += error.faults
            refused += 1
    assert refused <= 8
    assert all(fault.cause and fault.next_step for fault in faults)


def test_a_command_outside_the_envelope_is_seen(
    flown: dict[int, tuple[machines.Loop, list[str]]],
) -> None:
    loop, _ = flown[FAST]
    wide = loop.config.machine.bearing.radial_clearance_max_um + 1.0
    now_ns, command = loop.commands[-1]
    loop.commands.append((now_ns, Command(0, 0, 0, wide, command.pressure_bar)))
    found = loop._inside()
    loop.commands.pop()
    assert "outside the actuator's range" in found[0]
    assert "outside the envelope" in found[1]
