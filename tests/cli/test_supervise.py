"""A process that dies is named with its last words, restarted with a growing pause, and not when
its input is wrong."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from firmware_py.supervise import (
    GOOD_LIFE_S,
    GOOD_START_S,
    PAUSE_MAX_S,
    Program,
    Supervisor,
    last_words,
)
from tests.first_schema import BENCH


def crashing(tmp_path: Path, code: str) -> Program:
    return Program("room", (sys.executable, "-c", code), tmp_path / "log" / "room.log")


def next_death(supervisor: Supervisor, now_s: float):
    for _ in range(2000):
        if exits := supervisor.poll(now_s):
            return exits[0]
        time.sleep(0.005)
    raise AssertionError("it never died")


def test_a_crashing_process_pauses_twice_as_long_each_time_up_to_a_limit(tmp_path):
    supervisor, now_s, pauses = Supervisor(), time.monotonic(), []
    supervisor.start(crashing(tmp_path, "raise SystemExit('no film today')"))
    for _ in range(9):
        died = next_death(supervisor, now_s)
        pauses.append(died.restart_in_s)
        now_s += died.restart_in_s
    assert pauses[:4] == [0.1, 0.2, 0.4, 0.8]
    assert pauses[-1] == PAUSE_MAX_S
    assert died.last_words == ("no film today",)
    supervisor.stop()


@pytest.mark.parametrize(
    ("lived_s", "sig", "pause_s"),
    [
        (GOOD_LIFE_S, signal.SIGSEGV, 0.1),
        (GOOD_START_S, signal.SIGSEGV, 0.2),
        (GOOD_START_S, signal.SIGKILL, 0.1),
        (1.0, signal.SIGKILL, 0.2),
    ],
)
def test_a_good_life_or_a_hand_from_outside_starts_the_pauses_anew(tmp_path, lived_s, sig, pause_s):
    supervisor, start_s = Supervisor(), time.monotonic()
    supervisor.start(crashing(tmp_path, "import time; time.sleep(60)"))
    for at_s in (start_s + 1.0, start_s + 2.0 + lived_s):
        supervisor.kill("room", sig)
        died = next_death(supervisor, at_s)
        supervisor.poll(at_s + died.restart_in_s)
        if at_s == start_s + 1.0:
            supervisor._children["room"].started_s = start_s + 2.0
    assert died.restart_in_s == pause_s
    assert died.cause == f"by {sig.name}"
    supervisor.stop()


def test_wrong_input_is_not_tried_again(tmp_path):
    supervisor = Supervisor()
    supervisor.start(crashing(tmp_path, "raise SystemExit(2)"))
    died = next_death(supervisor, 0.0)
    assert (died.restart_in_s, died.cause) == (None, "with exit code 2")
    assert supervisor.poll(1e12) == []
    supervisor.stop()


def test_last_words_are_those_of_this_life_whatever_bytes_they_are(tmp_path):
    log = tmp_path / "log"
    assert last_words(log, 0) == ()
    log.write_bytes(b"earlier life\n" + b"\xff\x00 odd\n\nlast\n")
    assert last_words(log, 13) == ("\ufffd\x00 odd", "last")
    log.write_bytes(b"x" * 100_000)
    assert len(last_words(log, 0)[0]) == 4096


def test_run_stops_at_wrong_input_with_the_process_own_message(tmp_path):
    # A configuration that `run` reads and the guard refuses: its safe value is none.
    text = BENCH
    broken = tmp_path / "rig.toml"
    broken.write_text(
        "\n".join(
            "safe_radial_clearance_um = 100.0" if line.startswith("safe_radial_clear") else line
            for line in text.splitlines()
        )
    )
    runtime = tmp_path / "rt"
    result = subprocess.run(
        [
            sys.executable,
            "-m",
            "firmware_py",
            "run",
            "--rig",
            str(broken),
            "--runtime-dir",
            str(runtime),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=Path(__file__).parents[2],
    )
    assert result.returncode == 2, result.stderr
    assert "safe" in result.stderr
    assert "Traceback" not in result.stderr
