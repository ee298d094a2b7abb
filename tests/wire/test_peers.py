"""The rooms' sockets with real processes: slow, dead, foreign and babbling peers."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_py.records import (
    Block,
    CommandRequest,
    Event,
    EventAck,
    Hello,
    PeerRecord,
    Snapshot,
    encode,
)
from firmware_py.wire.peer_socket import MAX_RECORD_BYTES, PeerBusyError, PeerError
from firmware_py.wire.peers import (
    HELLO_WITHIN_NS,
    RECONNECT_AFTER_NS,
    PeerClient,
    PeerServer,
    runtime_dir,
)

ROOT = Path(__file__).resolve().parents[2]
BLOCK = Block(
    seq=1,
    t_acq_ns=1,
    period_ns=200_000,
    tick_us=0,
    sample_period_us=200,
    quality=0,
    channel_ok=255,
    speed_rad_s=314.0,
    turn_count=3,
    mark_ticks_us=[17],
    samples=bytes(480),
)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PeerServer]:
    room = PeerServer(tmp_path / "guard.sock", {"brain": None, "gate": None})
    yield room
    room.close()


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for another process; the limit only ends a broken run."""
    for _ in range(2000):
        if condition():
            return
        time.sleep(0.005)
    pytest.fail(f"never happened: {what}")


def joined(server: PeerServer, role: str) -> PeerClient:
    client = PeerClient(server.path, role)
    client.poll(0)
    server.poll(0)
    server.poll(0)
    return client


def raw_peer(server: PeerServer, *packets: bytes) -> socket.socket:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sock.connect(str(server.path))
    for packet in packets:
        sock.send(packet)
    server.poll(0)
    server.poll(0)
    return sock


def process(server: PeerServer, role: str, body: str) -> subprocess.Popen[bytes]:
    """A peer in a process of its own: ``client`` is connected when ``body`` runs."""
    source = f"""
import time
from pathlib import Path
from firmware_py.records import *
from firmware_py.wire.peers import PeerClient
client = PeerClient(Path({str(server.path)!r}), {role!r})
client.poll(0)
""" + textwrap.dedent(body)
    peer = subprocess.Popen(
        [sys.executable, "-c", source], env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    until(lambda: server.poll(0) == [] and server.connected(role), f"{role} connects")
    return peer


def hello(role: str = "brain") -> bytes:
    return encode(Hello(role=role, pid=1))


def test_records_cross_both_ways(server: PeerServer) -> None:
    client = joined(server, "brain")
    assert server.connected("brain")
    assert client.connected
    assert server.send("brain", BLOCK)
    assert client.poll(1) == [BLOCK]
    wish = CommandRequest(seq=4, verb="arm")
    assert client.send(wish)
    assert server.poll(2) == [("brain", wish)]
    assert not server.send("gate", BLOCK)
    client.close()


def test_socket_is_for_owner_and_group_only(server: PeerServer) -> None:
    assert server.path.stat().st_mode & 0o777 == 0o660


def test_slow_reader_loses_its_own_records_only(server: PeerServer) -> None:
    slow = process(server, "brain", "time.sleep(60)")
    gate = joined(server, "gate")
    os.kill(slow.pid, signal.SIGSTOP)
    delivered = 0
    sent = 0
    for seq in range(20_000):
        sent += server.send("brain", BLOCK)
        assert server.send("gate", EventAck(seq=seq))
        delivered += len(gate.poll(0))
    assert delivered == 20_000
    assert server.counters["lost_brain"] == 20_000 - sent > 0
    assert server.counters["lost_gate"] == 0
    os.kill(slow.pid, signal.SIGKILL)
    slow.wait()
    gate.close()


def test_killed_peer_is_replaced(server: PeerServer) -> None:
    first = process(server, "brain", "time.sleep(60)")
    first.kill()
    first.wait()
    second = process(server, "brain", "client.send(EventAck(seq=7)); time.sleep(60)")
    until(lambda: ("brain", EventAck(seq=7)) in server.poll(0), "the second brain is heard")
    assert server.counters["left_brain"] == 1
    assert server.counters["connected_brain"] == 2
    second.kill()
    second.wait()


def test_sending_to_a_peer_that_has_gone_frees_its_place(server: PeerServer) -> None:
    joined(server, "brain").close()
    assert not server.send("brain", BLOCK)
    assert not server.connected("brain")
    assert server.counters["lost_brain"] == 1


def test_second_peer_of_a_role_is_refused(server: PeerServer) -> None:
    first = joined(server, "brain")
    second = joined(server, "brain")
    assert server.counters["refused_second"] == 1
    assert second.poll(1) == []
    assert not second.connected
    assert server.send("brain", BLOCK)
    assert first.poll(1) == [BLOCK]
    first.close()


def test_unknown_role_is_refused(server: PeerServer) -> None:
    joined(server, "janitor").close()
    assert server.counters["refused_role"] == 1


def test_wrong_user_is_refused(tmp_path: Path) -> None:
    room = PeerServer(tmp_path / "guard.sock", {"brain": os.getuid() + 1})
    joined(room, "brain").close()
    assert room.counters["refused_uid"] == 1
    assert not room.connected("brain")
    room.close()


@pytest.mark.parametrize(
    "packet", [b"\xff" * 40, encode(EventAck(seq=1)), b""], ids=["garbage", "other", "empty"]
)
def test_first_packet_must_be_hello(server: PeerServer, packet: bytes) -> None:
    raw_peer(server, packet).close()
    assert server.counters["refused_hello"] == 1


def test_silent_newcomer_is_refused_after_one_second(server: PeerServer) -> None:
    silent = raw_peer(server)
    server.poll(HELLO_WITHIN_NS - 1)
    assert server.counters["refused_hello"] == 0
    server.poll(HELLO_WITHIN_NS)
    assert server.counters["refused_hello"] == 1
    assert silent.recv(10) == b""
    silent.close()


def test_crowd_of_newcomers_is_bounded(server: PeerServer) -> None:
    crowd = [raw_peer(server) for _ in range(12)]
    assert server.counters["refused_crowd"] == 4
    for sock in crowd:
        sock.close()


def test_a_crowd_without_a_word_keeps_no_peer_out(server: PeerServer) -> None:
    crowd = [raw_peer(server) for _ in range(30)]
    client = PeerClient(server.path, "gate")
    client.poll(0)
    server.poll(0)
    crowd += [raw_peer(server) for _ in range(3)]
    server.poll(0)
    assert server.connected("gate")
    client.close()
    for sock in crowd:
        sock.close()


def test_garbage_is_counted_and_survived(server: PeerServer) -> None:
    peer = raw_peer(server, hello())
    peer.send(b"\xc1 not a record")
    peer.send(encode(EventAck(seq=3)))
    assert server.poll(0) == [("brain", EventAck(seq=3))]
    assert server.counters["malformed_brain"] == 1
    peer.close()


def test_endless_nesting_is_counted_and_survived(server: PeerServer) -> None:
    peer = raw_peer(server, hello())
    bomb = encode(EventAck(seq=1))
    peer.send(bytes([bomb[0] + 1]) + bomb[1:] + b"\xa1x" + b"\x91" * 100_000 + b"\x01")
    assert server.poll(0) == []
    assert server.counters["malformed_brain"] == 1
    assert server.connected("brain")
    peer.close()


@given(data=st.binary(min_size=1, max_size=300))
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200, deadline=None
)
def test_any_bytes_are_a_record_or_counted(server: PeerServer, data: bytes) -> None:
    peer = raw_peer(server, hello())
    before = server.counters["malformed_brain"]
    peer.send(data)
    assert len(server.poll(0)) + server.counters["malformed_brain"] - before == 1
    peer.close()
    server.poll(0)


def test_oversized_is_refused_at_both_ends(server: PeerServer) -> None:
    client = joined(server, "brain")
    huge = Snapshot(seq=1, now_ns=0, state=bytes(MAX_RECORD_BYTES))
    assert not server.send("brain", huge)
    assert server.counters["oversized_brain"] == 1
    assert not client.send(huge)
    assert client.counters["oversized_brain"] == 1
    client.close()
    server.poll(0)
    peer = raw_peer(server, hello())
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 * MAX_RECORD_BYTES)
    peer.send(encode(huge))
    peer.send(encode(EventAck(seq=9)))
    assert server.poll(0) == [("brain", EventAck(seq=9))]
    assert server.counters["oversized_brain"] == 2
    peer.close()


def test_largest_record_passes(server: PeerServer) -> None:
    client = joined(server, "brain")
    large = Snapshot(seq=1, now_ns=0, state=bytes(MAX_RECORD_BYTES - 100))
    assert server.send("brain", large)
    assert client.poll(0) == [large]
    client.close()


def test_one_poll_takes_a_bounded_number(server: PeerServer) -> None:
    peer = raw_peer(server, hello())
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4_000_000)
    for seq in range(300):
        peer.send(encode(EventAck(seq=seq)))
    assert [len(server.poll(0)), len(server.poll(0))] == [256, 44]
    peer.close()


def test_client_comes_back_after_the_server(tmp_path: Path) -> None:
    path = tmp_path / "guard.sock"
    client = PeerClient(path, "gate")
    assert client.poll(0) == []
    assert not client.connected
    server = PeerServer(path, {"gate": None})
    client.poll(RECONNECT_AFTER_NS - 1)
    assert not client.connected
    client.poll(RECONNECT_AFTER_NS)
    assert client.connected
    server.close()
    client.poll(RECONNECT_AFTER_NS + 1)
    assert not client.connected
    assert client.counters["left"] == 1
    server = PeerServer(path, {"gate": None})
    client.poll(2 * RECONNECT_AFTER_NS)
    server.poll(0)
    server.poll(0)
    assert server.connected("gate")
    client.close()
    server.close()


def test_socket_left_by_a_killed_server_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "guard.sock"
    source = (
        "import time; from pathlib import Path; from firmware_py.wire.peers import PeerServer\n"
        f"server = PeerServer(Path({str(path)!r}), {{}}); print('up', flush=True); time.sleep(60)"
    )
    first = subprocess.Popen(
        [sys.executable, "-c", source],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
    )
    assert first.stdout
    assert first.stdout.readline() == b"up\n"
    with pytest.raises(PeerBusyError, match="served by another process"):
        PeerServer(path, {})
    first.kill()
    first.wait()
    first.stdout.close()
    PeerServer(path, {}).close()


def test_too_long_path_is_named(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    with pytest.raises(PeerError, match="107 bytes"):
        PeerServer(deep / "guard.sock", {})


def test_socket_path_that_is_a_directory_is_named(tmp_path: Path) -> None:
    (tmp_path / "guard.sock").mkdir()
    with pytest.raises(PeerError, match="check the runtime directory"):
        PeerServer(tmp_path / "guard.sock", {})


def test_runtime_directory_is_made_or_refused(tmp_path: Path) -> None:
    assert runtime_dir("a", tmp_path / "base").is_dir()
    assert runtime_dir("a", tmp_path / "base") == tmp_path / "base" / "a"
    (tmp_path / "base").chmod(0o777)
    with pytest.raises(PeerError, match="everybody may put sockets there"):
        runtime_dir("b", tmp_path / "base")
    (tmp_path / "file").write_text("")
    with pytest.raises(PeerError, match="RUNTIME_DIRECTORY"):
        runtime_dir("b", tmp_path / "file")


def test_records_of_every_size_keep_their_borders(server: PeerServer) -> None:
    client = joined(server, "gate")
    events: list[PeerRecord] = [
        Event(seq=n, t_ns=n, severity=0, name="x" * n, text="") for n in range(0, 4000, 97)
    ]
    assert all(server.send("gate", event) for event in events)
    assert client.poll(0) == events
    client.close()
