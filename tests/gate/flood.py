"""How long a local ``disarm`` takes while another client asks for everything at its greatest rate.

    python -m tests.gate.flood [--input NAME] [--commands 20]

A real gate process, a guard's end of its socket that answers as the guard does, one flooding
process, one that disarms.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import zenoh

from firmware_py import config
from firmware_py.gate import session
from firmware_py.gate.client import Client
from firmware_py.records import (
    ArmState,
    Block,
    CommandReply,
    CommandRequest,
    Event,
    GuardState,
    Mode,
)
from firmware_py.wire import mav_dialect as mav
from firmware_py.wire.rooms import RoomServer

ROOT = Path(__file__).resolve().parents[2]
PREFIX = "orbitd/lab/bench"
QUERIES = {
    name: f"{PREFIX}/{name}"
    for name in ("state", "event", "config", "models", "sd/alarms", "cmd/arm", "cmd/disarm")
}
QUERIES |= {"everything": "orbitd/**", "since": f"{PREFIX}/event?since=3;as=msgpack"}
INPUTS = ("none", *QUERIES, "page", "metrics", "mavlink")
STATE = GuardState(
    seq=1,
    t_ns=1,
    mode=Mode.AUTO,
    arm_state=ArmState.ARMED,
    authority=True,
    authority_reasons=[],
    speed_rad_s=314.0,
    load_estimate_N=100.0,
    clearance_low_um=45.0,
    clearance_high_um=90.0,
    target_clearance_um=60.0,
    target_pressure_bar=1.0,
    clearance_actual_um=59.0,
    peak_to_peak_um=(12.0, 13.0),
    run_permit=True,
    trip_request=False,
    node_following=True,
    alarms=[],
    counters={f"counter_{n}": n for n in range(60)},
)


def flood(name: str, runtime: str, http_port: int, station_port: int) -> None:
    """Ask for ``name`` as fast as one process can, until killed."""
    if name in ("page", "metrics"):
        path = b"/" if name == "page" else b"/metrics"
        while True:
            with (
                contextlib.suppress(OSError),
                socket.create_connection(("127.0.0.1", http_port), 5) as sock,
            ):
                sock.sendall(b"GET " + path + b" HTTP/1.1\r\n\r\n")
                while sock.recv(65536):
                    pass
    if name == "mavlink":
        maker = mav.MAVLink(None, srcSystem=255, srcComponent=190)
        packet = bytes(maker.param_request_list_encode(1, 1).pack(maker)) * 20
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", station_port))
            _, device = sock.recvfrom(2048)
            while True:
                sock.sendto(packet, device)
    conf = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [session.endpoint(Path(runtime))],
        "scouting/multicast/enabled": False,
    }.items():
        conf.insert_json5(key, json.dumps(value))
    with zenoh.open(conf) as opened:
        number = 0
        while True:
            number += 1
            opened.get(
                QUERIES[name], lambda reply: None, payload=b'{"id": "%d"}' % number, timeout=1.0
            )


class Guard:
    """The guard's end: blocks and states at their rates, an answer to each command at once."""

    def __init__(self, runtime: Path) -> None:
        self._server = RoomServer(runtime / "guard.sock", {"gate": None})
        self._stop = threading.Event()
        self.heard: list[tuple[float, str]] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        events = [
            Event(seq, seq, 0, f"e{seq}", "an event of some length, as they are told to people" * 3)
            for seq in range(1000)
        ]
        told, cycle = False, 0
        while not self._stop.wait(0.006):
            cycle += 1
            now_ns = time.monotonic_ns()
            for _, record in self._server.poll(now_ns):
                if isinstance(record, CommandRequest):
                    self.heard.append((time.monotonic(), record.id))
                    self._server.send("gate", CommandReply(record.seq, True, []))
            if self._server.connected("gate") and not told:
                told = True
                for event in events:
                    self._server.send("gate", event)
            self._server.send(
                "gate", Block(cycle, now_ns, 200_000, 0, 200, 0, 255, 314.0, cycle, [], bytes(480))
            )
            if cycle % 16 == 0:
                self._server.send("gate", STATE)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._server.close()


@contextlib.contextmanager
def device(folder: Path) -> Iterator[tuple[int, int]]:
    """A gate process and the guard's end; its HTTP port and the ground station's."""
    ports = []
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            probe.bind(("127.0.0.1", 0))
            ports.append(probe.getsockname()[1])
    text = (config.SHIPPED / "bench.toml").read_text() + f"\n[metrics]\nport = {ports[0]}\n"
    (folder / "bench.toml").write_text(text)
    guard = Guard(folder)
    gate = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "firmware_py",
            "gate",
            "--config",
            str(folder / "bench.toml"),
            "--runtime-dir",
            str(folder),
            "--record",
            str(folder / "recordings"),
            "--ground-station",
            str(ports[1]),
        ],
        cwd=ROOT,
    )
    try:
        end_s = time.monotonic() + 60
        while not (folder / session.SOCKET).exists() and time.monotonic() < end_s:
            time.sleep(0.05)
        time.sleep(0.5)
        yield ports[0], ports[1]
        assert gate.poll() is None, "the gate ended"
    finally:
        gate.send_signal(signal.SIGTERM)
        gate.wait(20)
        guard.close()


def measure(name: str, folder: Path, ports: tuple[int, int], commands: int) -> list[float]:
    """Seconds that each of ``commands`` disarms took from question to answer."""
    flooding = None
    if name != "none":
        flooding = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "tests.gate.flood",
                "--flood",
                name,
                str(folder),
                str(ports[0]),
                str(ports[1]),
            ],
            cwd=ROOT,
        )
    try:
        took = []
        with Client(folder, PREFIX) as client:
            time.sleep(1.5 if flooding else 0.2)
            for _ in range(commands):
                start = time.monotonic()
                assert client.ask("disarm").accepted
                took.append(time.monotonic() - start)
                time.sleep(0.02)
        return took
    finally:
        if flooding:
            flooding.kill()
            flooding.wait()


def main() -> None:
    if sys.argv[1:2] == ["--flood"]:
        flood(sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))
        return
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--input", choices=INPUTS, action="append")
    parser.add_argument("--commands", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.chmod(folder, 0o700)
        with device(folder) as ports:
            for each in options.input or INPUTS:
                took = sorted(measure(each, folder, ports, options.commands))
                median, worst = 1e3 * took[len(took) // 2], 1e3 * took[-1]
                print(f"{each:<12} median {median:6.1f} ms, worst {worst:6.1f} ms", flush=True)


if __name__ == "__main__":
    main()
