"""The guard as a process: started, killed, started again, told to stop."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_py.clock import Clock
from firmware_py.guard import loop
from firmware_py.notify import Notifier
from firmware_py.records import CommandReply, CommandRequest, GuardState
from firmware_py.wire.peers import PeerClient
from tests.first_schema import BENCH

ROOT = Path(__file__).resolve().parents[2]


def config_file(folder: Path) -> Path:
    """The shipped configuration on a serial port that is not there: no hub is started."""
    path = folder / "rig.toml"
    text = BENCH
    assert 'link = "can"' in text
    path.write_text(
        text.replace('link = "can"', f'link = "serial"\nserial_port = "{folder}/absent"', 1)
    )
    return path


class Process:
    """A guard that may be killed, and a gate that asks it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.config = config_file(folder)
        self.runtime = folder / "rt"
        self.child: subprocess.Popen[bytes] | None = None

    def start(self) -> GuardState:
        """Start it and wait for what it first says of itself."""
        command = [
            sys.executable,
            "-m",
            "firmware_py",
            "guard",
            "--rig",
            str(self.config),
            "--runtime-dir",
            str(self.runtime),
        ]
        self.child = subprocess.Popen(command, cwd=ROOT)
        return self.ask(None)

    def ask(self, verb: str | None) -> GuardState:
        """Put one request (None: none) and wait for a state that is no older."""
        gate = PeerClient(self.runtime / "guard.sock", "gate")
        try:
            answered, sent, end = verb is None, False, time.monotonic() + 60
            while time.monotonic() < end:
                for record in gate.poll(time.monotonic_ns()):
                    answered = answered or isinstance(record, CommandReply)
                    if isinstance(record, GuardState) and answered:
                        return record
                if verb and gate.connected and not sent:
                    sent = gate.send(CommandRequest(1, verb))
                assert self.child is not None
                assert self.child.poll() is None, "the guard ended"
                time.sleep(0.01)
            raise AssertionError("the guard said nothing")
        finally:
            gate.close()

    def end(self, sig: signal.Signals) -> int:
        """Send ``sig`` and wait for the end."""
        assert self.child is not None
        self.child.send_signal(sig)
        return self.child.wait(20)


@pytest.fixture
def process(tmp_path: Path) -> Iterator[Process]:
    made = Process(tmp_path)
    yield made
    if made.child is not None and made.child.poll() is None:
        made.child.kill()
        made.child.wait()


def withheld_for(state: GuardState) -> list[str]:
    assert not state.run_permit
    return [text.partition(":")[0] for text in state.permit_reasons]


def test_two_kills_bar_the_permit_until_a_person_has_looked_and_a_stop_is_no_kill(
    process: Process,
) -> None:
    assert withheld_for(process.start()) == ["unseen"]
    process.end(signal.SIGKILL)
    assert withheld_for(process.start()) == ["unseen"]
    process.end(signal.SIGKILL)
    assert withheld_for(process.start()) == ["restarts", "unseen"]
    process.end(signal.SIGKILL)
    assert withheld_for(process.start()) == ["restarts", "unseen"], "it stands over a further one"
    assert withheld_for(process.ask("reset")) == ["unseen"]
    assert process.end(signal.SIGTERM) == 0
    assert withheld_for(process.start()) == ["unseen"]
    assert process.end(signal.SIGINT) == 0
    assert json.loads((process.runtime / "starts.json").read_text())["running"] is False


def test_a_person_disarms_without_a_gate(process: Process) -> None:
    process.start()
    command = [sys.executable, "-m", "firmware_py", "disarm", "--runtime-dir", str(process.runtime)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stdout, done.stderr) == (0, "disarm: accepted\n", "")


@pytest.mark.parametrize("data", [b"", b"\0" * 24, b"[7]"])
def test_a_trip_file_that_nobody_can_read_stands_latched_and_the_guard_protects(
    process: Process, data: bytes
) -> None:
    process.runtime.mkdir()
    (process.runtime / "trips.json").write_bytes(data)
    state = process.start()
    assert "trip_file_unreadable" in [alarm.name for alarm in state.alarms if alarm.latched]
    assert withheld_for(state) == ["tripped", "unseen"]
    assert not state.trip_request
    process.end(signal.SIGKILL)
    assert "trip_file_unreadable" in [alarm.name for alarm in process.start().alarms], (
        "until somebody resets it"
    )
    assert "trip_file_unreadable" not in [alarm.name for alarm in process.ask("reset").alarms]
    assert process.end(signal.SIGTERM) == 0
    assert json.loads((process.runtime / "trips.json").read_text()) == []


# ----------------------------------------------------------- the same in this process, step by step


def test_main_notes_its_start_after_it_can_be_told_to_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    did: list[str] = []
    build = loop.build

    def watched(*arguments: object) -> loop.Guard:
        did.append(
            "told to stop" if signal.getsignal(signal.SIGTERM) not in before.values() else "deaf"
        )
        os.kill(os.getpid(), signal.SIGTERM)
        return build(*arguments)  # type: ignore[arg-type]

    def stand_in(guard: loop.Guard, clock: Clock, notifier: Notifier, running: object) -> None:
        did.append(f"running {running()}")  # type: ignore[operator]

    monkeypatch.setattr(loop, "build", watched)
    monkeypatch.setattr(loop, "run", stand_in)
    monkeypatch.setattr(loop, "real_time", lambda: did.append("real time"))
    monkeypatch.setattr(loop, "_first_in_line", lambda: None)
    runtime = tmp_path / "rt"
    runtime.mkdir()
    (runtime / "starts.json").write_text("junk")
    try:
        assert loop.main(["--rig", str(config_file(tmp_path)), "--runtime-dir", str(runtime)]) == 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert did == ["told to stop", "real time", "running False"]
    assert json.loads((runtime / "starts.json").read_text())["running"] is False


@pytest.mark.parametrize("allowed", [True, False])
def test_the_loop_is_first_in_line_where_that_is_allowed(
    monkeypatch: pytest.MonkeyPatch, allowed: bool
) -> None:
    asked: list[object] = []

    def schedule(*arguments: object) -> None:
        asked.append(arguments[1])
        if not allowed:
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    for name in ("collect", "freeze", "disable"):
        monkeypatch.setattr(gc, name, lambda name=name: asked.append(name))
    loop.real_time()
    assert asked == [os.SCHED_FIFO, "collect", "freeze", "disable"]
