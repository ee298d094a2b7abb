"""All four processes in real time, the gate killed in mid-flight, and its recording replayed."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from firmware_py.gate.client import Client
from firmware_py.gate.session import SessionError
from firmware_py.recording import TOPICS, Recording
from firmware_py.records import CommandReply, CycleRecord
from firmware_py.replay.command import replay
from firmware_py.routing import ROUTES_OF, Stage
from tests.first_schema import BENCH

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_a_live_recording_of_a_killed_gate_replays_bit_by_bit(tmp_path):
    text = BENCH.replace('"orbitd0"', f'"replay{time.monotonic_ns()}"')
    (tmp_path / "bench.toml").write_text(text)
    options = ["--rig", str(tmp_path / "bench.toml"), "--runtime-dir", str(tmp_path)]

    def start(*words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "firmware_py", *words, *options],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    processes = [
        start("gate", "--record", str(tmp_path / "recordings")),
        start("hil"),
        start("guard"),
        start("brain"),
    ]
    try:
        wait_for_diagnoses(tmp_path)
        processes[0].kill()
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait(20)
    report = replay(next((tmp_path / "recordings").glob("*.mcap")))
    assert report.ok, report
    assert report.interrupted
    assert report.decisions.cycles > 1000
    assert report.diagnoses is not None
    assert report.diagnoses.exact
    assert report.diagnoses.compared > 10
    assert report.brain is not None
    assert report.brain.compared["ag/advice"] > 30, report.brain
    assert report.brain.compared["pa/forecast"] > 10
    assert report.brain.steps_set_aside == 0, "from its first snapshot on, sent to a new recorder"
    assert report.brain.records_lost == 0
    check_order(Recording(next((tmp_path / "recordings").glob("*.mcap"))))


def check_order(recording: Recording) -> None:
    """What came of each cycle of the guard was sent in the order of the routing table."""
    order = [TOPICS[route.kind].name for route in ROUTES_OF[Stage.GUARD]]
    heard: list[str] = []
    for message in recording.messages():
        if message.topic in order and message.topic != TOPICS[CommandReply].name:
            heard.append(message.topic)
        if message.topic == TOPICS[CycleRecord].name:
            assert heard == sorted(heard, key=order.index)
            heard.clear()


def wait_for_diagnoses(runtime: Path) -> None:
    """Until the brain has spoken twenty times."""
    for _ in range(600):
        time.sleep(0.1)
        try:
            with Client(runtime, "orbitd/lab/bench") as client:
                diagnosis = client.status().diagnosis
        except SessionError:
            continue
        if diagnosis is not None and diagnosis.seq >= 20:
            return
    raise AssertionError("the brain never spoke")
