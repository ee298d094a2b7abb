"""How long a local ``disarm`` takes while another client asks for everything at its greatest rate.

    python -m tests.gate.flood [--input NAME] [--commands 20]

A real gate process, a guard's end of its sockets that answers as the guard does, one flooding
process, one that disarms: on the guard's own socket, as ``orbitd disarm`` does, and for comparison
through the gate.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import zenoh

from firmware_py.gate import session
from firmware_py.gate.client import Client, NoAnswerError
from firmware_py.guard.loop import real_time
from firmware_py.guard.process.budget import PEER_LIMITS
from firmware_py.records import (
    ArmState,
    Block,
    CommandReply,
    CommandRequest,
    Event,
    GuardState,
    Hello,
    Mode,
    encode,
)
from firmware_py.wire import disarm_socket
from firmware_py.wire import mav_dialect as mav
from firmware_py.wire.disarm_socket import DisarmSocket
from firmware_py.wire.peers import PeerServer
from tests.first_schema import BENCH

ROOT = Path(__file__).resolve().parents[2]
PREFIX = "orbitd/lab/bench"
QUERIES = {
    name: f"{PREFIX}/{name}"
    for name in ("state", "event", "config", "models", "sd/alarms", "cmd/arm", "cmd/disarm")
}
QUERIES |= {"everything": "orbitd/**", "since": f"{PREFIX}/event?since=3;as=msgpack"}
ROOMS = {
    "disarm.sock": encode(CommandRequest(0, "disarm", id="flood")),
    "disarm.sock silent": b"",
    "disarm.sock junk": b"\xff" * 100,
    "guard.sock": encode(Hello("brain", 1)),
    "gate.sock": encode(Hello("guard", 1)),
}
"""First packet of each connection; the silent ones stay open."""

INPUTS = ("none", *QUERIES, "page", "metrics", "mavlink", *ROOMS)
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
    if name in ROOMS:
        crowd(Path(runtime) / name.partition(" ")[0], ROOMS[name])
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


def crowd(path: Path, packet: bytes) -> NoReturn:
    """Connect as fast as one process can, with one ``packet`` each."""
    held: list[socket.socket] = []
    while True:
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with contextlib.suppress(OSError):
            sock.connect(str(path))
            if packet:
                sock.send(packet)
        held = [*held[-50:], sock]


def guard(runtime: Path) -> NoReturn:
    """The guard's end: blocks and states at their rates, an answer to each command at once, as
    first in line for the processor as the guard is."""
    server = PeerServer(runtime / "guard.sock", {"gate": None}, PEER_LIMITS)
    room = DisarmSocket(runtime / disarm_socket.SOCKET)
    events = [
        Event(seq, seq, 0, f"e{seq}", "an event of some length, as they are told to people" * 3)
        for seq in range(1000)
    ]
    real_time()
    told, cycle = False, 0
    while True:
        time.sleep(0.001)
        cycle += 1
        now_ns = time.monotonic_ns()
        disarm = room.poll(now_ns)
        if disarm is not None:
            room.answer(CommandReply(disarm.seq, True, []))
        for _, record in server.poll(now_ns):
            if isinstance(record, CommandRequest):
                server.send("gate", CommandReply(record.seq, True, []))
        if server.connected("gate") and not told:
            told = True
            for event in events:
                server.send("gate", event)
        if cycle % 6:
            continue
        server.send(
            "gate", Block(cycle, now_ns, 200_000, 0, 200, 0, 255, 314.0, cycle, [], bytes(480))
        )
        if cycle % 96 == 0:
            server.send("gate", STATE)


@contextlib.contextmanager
def device(folder: Path) -> Iterator[tuple[int, int]]:
    """A gate process and the guard's end; its HTTP port and the ground station's."""
    ports = []
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            probe.bind(("127.0.0.1", 0))
            ports.append(probe.getsockname()[1])
    text = BENCH + f"\n[metrics]\nport = {ports[0]}\n"
    (folder / "bench.toml").write_text(text)
    (folder / disarm_socket.SOCKET).unlink(missing_ok=True)
    guarding = subprocess.Popen(
        [sys.executable, "-m", "tests.gate.flood", "--guard", str(folder)], cwd=ROOT
    )
    gate = subprocess.Popen(
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
            "--ground-station",
            str(ports[1]),
        ],
        cwd=ROOT,
    )
    try:
        end_s = time.monotonic() + 60
        sockets = [folder / session.SOCKET, folder / disarm_socket.SOCKET]
        while not all(path.exists() for path in sockets) and time.monotonic() < end_s:
            time.sleep(0.05)
        time.sleep(0.5)
        yield ports[0], ports[1]
        assert gate.poll() is None, "the gate ended"
        assert guarding.poll() is None, "the guard ended"
    finally:
        gate.send_signal(signal.SIGTERM)
        gate.wait(20)
        guarding.kill()
        guarding.wait()


@dataclass(frozen=True)
class Took:
    """Seconds that disarms took from question to answer, in rising order, and the longest stall of
    an empty loop beside them: what this machine itself withheld."""

    local_s: list[float]
    through_gate_s: list[float]
    stall_s: float


def measure(name: str, folder: Path, ports: tuple[int, int], commands: int) -> Took:
    """``commands`` disarms on either way, beside a flood on the input ``name``."""
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
    empty = subprocess.Popen(
        [sys.executable, "-m", "tests.gate.empty_loop"],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    try:
        local, through_gate = [], []
        with Client(folder, PREFIX) as client:
            time.sleep(1.5 if flooding else 0.2)
            for _ in range(commands):
                start_s = time.monotonic()
                reply = disarm_socket.ask(folder, uuid.uuid4().hex, 5.0)
                assert reply is not None
                assert reply.accepted
                local.append(time.monotonic() - start_s)
                start_s = time.monotonic()
                try:
                    assert client.ask("disarm").accepted
                    through_gate.append(time.monotonic() - start_s)
                except NoAnswerError:
                    through_gate.append(math.inf)
                time.sleep(0.02)
        return Took(sorted(local), sorted(through_gate), float(empty.communicate()[0]))
    finally:
        empty.kill()
        empty.wait()
        if flooding:
            flooding.kill()
            flooding.wait()


def main() -> None:
    if sys.argv[1:2] == ["--flood"]:
        flood(sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))
        return
    if sys.argv[1:2] == ["--guard"]:
        guard(Path(sys.argv[2]))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--input", choices=INPUTS, action="append")
    parser.add_argument("--commands", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.chmod(folder, 0o700)
        with device(folder) as ports:
            for each in options.input or INPUTS:
                took = measure(each, folder, ports, options.commands)
                ways = (("local", took.local_s), ("through the gate", took.through_gate_s))
                words = [
                    f"{way} {1e3 * each_s[len(each_s) // 2]:6.1f} / {1e3 * each_s[-1]:6.1f}"
                    for way, each_s in ways
                ]
                print(
                    f"{each:<19} median / worst, ms: {', '.join(words)}; an empty loop stalled "
                    f"for {1e3 * took.stall_s:.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
