"""Imports in the background, and the way back, tried in processes of their own."""

import gc
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py import background, cli

REPORT = """
import json, os, sys, threading
from firmware_py import background, cli
def now():
    return [[os.sched_getscheduler(t), sorted(os.sched_getaffinity(t)),
             os.getpriority(os.PRIO_PROCESS, t)]
            for t in sorted(map(int, os.listdir("/proc/self/task")))]
{before}
first = now()
background.lower()
held = threading.Event()
threading.Thread(target=held.wait, daemon=True).start()
low = now()
background.restore()
print(json.dumps([first, low, now()]))
"""
ROOT = Path(__file__).resolve().parents[2]


def report(before: str = "") -> list[list[list[object]]]:
    done = subprocess.run(
        [sys.executable, "-c", REPORT.replace("{before}", before)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    found: list[list[list[object]]] = json.loads(done.stdout)
    return found


def test_the_start_is_in_the_background_and_every_thread_comes_back() -> None:
    (first,), low, back = report()
    assert len(low) == len(back) == 2
    cpus = os.sched_getaffinity(0)
    for policy, where, _ in low:
        assert policy == os.SCHED_BATCH
        assert where == sorted(cpus - {max(cpus)} if len(cpus) > 1 else cpus)
    assert back == [first, first]


IN_A_SESSION = """
import os
from firmware_py import background
found = [background.session_nice()]
background.lower()
found.append(background.session_nice())
background.restore()
print([*found, background.session_nice()])
"""


@pytest.mark.skipif(background.session_nice() is None, reason="no autogroups in this kernel")
@pytest.mark.parametrize("leader", [True, False])
def test_a_session_of_its_own_is_in_the_background_as_a_whole(leader: bool) -> None:
    """Sessions are weighed before processes: inside its own, nice alone changes nothing."""
    done = subprocess.run(
        [sys.executable, "-c", IN_A_SESSION],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        start_new_session=leader,
    )
    before, low, back = json.loads(done.stdout)
    assert back == before
    assert low == (min(before + background.NICE, 19) if leader else before)


def test_one_processor_is_not_left() -> None:
    (first,), low, back = report("os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})")
    assert [entry[1] for entry in low] == [first[1]] * 2
    assert back == [first, first]


def test_where_nice_has_no_way_back_it_is_not_gone() -> None:
    _, low, back = report("background.may_return = lambda: False")
    assert (
        {entry[2] for entry in low}
        == {entry[2] for entry in back}
        == {os.getpriority(os.PRIO_PROCESS, 0)}
    )


def test_where_the_system_denies_it_all_nothing_happens() -> None:
    denied = (
        "def deny(*_): raise PermissionError(1, 'denied')\n"
        "os.sched_setscheduler = os.sched_setaffinity = deny\nbackground.may_return = lambda: False"
    )
    first, low, back = report(denied)
    assert low == back == first * 2


@pytest.mark.parametrize("denied", [False, True])
def test_the_way_back_is_tried_in_a_child(monkeypatch: pytest.MonkeyPatch, denied: bool) -> None:
    def nice(step: int) -> int:
        if denied and step < 0:
            raise PermissionError(1, "denied")
        return 0

    monkeypatch.setattr(background.os, "nice", nice)
    assert background.may_return() is not denied


@pytest.mark.parametrize("process", ["guard", "brain", "gate"])
def test_a_command_that_ends_leaves_its_caller_as_it_was(process: str) -> None:
    def mine() -> list[object]:
        return [
            os.sched_getscheduler(0),
            os.sched_getaffinity(0),
            os.getpriority(os.PRIO_PROCESS, 0),
            gc.isenabled(),
        ]

    before = mine()
    assert cli.main([process, "--no-such-option"]) == 2
    assert mine() == before
