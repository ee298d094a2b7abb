"""The gate as a process: start, refusals, page and metrics, clean stop."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from firmware_py import config
from firmware_py.gate.client import Client
from firmware_py.recording import Recording
from firmware_py.wire.peers import PeerServer
from tests.first_schema import BENCH

ROOT = Path(__file__).resolve().parents[2]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Process:
    def __init__(self, folder: Path, *extra: str) -> None:
        self.port = free_port()
        text = BENCH + f"\n[metrics]\nport = {self.port}\n"
        (folder / "bench.toml").write_text(text)
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "firmware_py",
                "gate",
                "--rig",
                str(folder / "bench.toml"),
                "--runtime-dir",
                str(folder),
                "--record",
                str(folder / "recordings"),
                *extra,
            ],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
        )

    def get(self, path: str) -> bytes:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=5) as answer:
            body: bytes = answer.read()
            return body


@pytest.fixture
def gate(tmp_path: Path) -> Iterator[Process]:
    made = Process(tmp_path)
    yield made
    made.process.kill()
    made.process.communicate()


def eventually(attempt):
    for _ in range(600):
        try:
            found = attempt()
        except (OSError, urllib.error.URLError):
            found = None
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError("never came")


def test_the_gate_serves_then_stops_cleanly(gate, tmp_path, make_state):
    guard = PeerServer(tmp_path / "guard.sock", {"gate": None})
    eventually(lambda: guard.poll(time.monotonic_ns()) or guard.connected("gate"))
    guard.send("gate", make_state())

    live = eventually(lambda: gate.get("/live.json"))
    assert msgspec.json.decode(live)["state"]["rooms"]["gate"]
    text = eventually(
        lambda: (
            (t := gate.get("/metrics").decode()) and "orbitd_clearance_actual_um 59.0" in t and t
        )
    )
    assert 'orbitd_room_up{room="gate"} 1.0' in text
    assert 'orbitd_count{name="frames_in",room="guard"} 5.0' in text
    page = gate.get("/").decode()
    assert "http" not in page.replace("http-equiv", ""), "the page loads nothing from elsewhere"
    with pytest.raises(urllib.error.HTTPError, match="404"):
        gate.get("/etc/passwd")
    with pytest.raises(urllib.error.HTTPError, match="501"):
        urllib.request.urlopen(
            urllib.request.Request(f"http://127.0.0.1:{gate.port}/", data=b"x"), timeout=5
        )
    with Client(tmp_path, "orbitd/lab/bench") as client:
        assert client.status().recording.endswith(".mcap")

    gate.process.send_signal(signal.SIGTERM)
    assert gate.process.wait(20) == 0
    recording = Recording(next((tmp_path / "recordings").glob("*.mcap")))
    topics = {message.topic for message in recording.messages()}
    assert {"sd/state", "clock"} <= topics
    assert not recording.interrupted
    read_back = msgspec.json.decode(recording.metadata["config"], type=config.Config)
    assert read_back.metrics.port == gate.port
    guard.close()


def test_a_second_gate_of_the_same_instance_is_refused_by_name(gate, tmp_path):
    eventually(lambda: gate.get("/live.json"))
    second = Process(tmp_path)
    _, error = second.process.communicate(timeout=30)
    assert second.process.returncode != 0
    assert "Traceback" not in error
    assert "gate.sock" in error
    assert gate.process.poll() is None
    with Client(tmp_path, "orbitd/lab/bench") as client:
        assert client.status().rooms["gate"]
