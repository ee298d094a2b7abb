"""The guard's own socket for ``disarm``: what it obeys, what it refuses, and who waits for whom."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from firmware_py.records import CommandReply, CommandRequest, EventAck, PlannedRamp, decode, encode
from firmware_py.wire import disarm_socket
from firmware_py.wire.disarm_socket import (
    ASKING_MAX,
    CALLERS_PER_CYCLE,
    PERIOD_NS,
    REQUEST_LIMIT,
    SILENT_NS,
    SOCKET,
    WAITING_MAX,
    DisarmSocket,
)
from firmware_py.wire.peer_socket import PeerBusyError

MS = 1_000_000
WELL = encode(CommandRequest(0, "disarm", id="7f3a"))


@pytest.fixture
def room(tmp_path: Path) -> Iterator[DisarmSocket]:
    made = DisarmSocket(tmp_path / SOCKET)
    yield made
    made.close()


def caller(folder: Path, *packets: bytes) -> socket.socket:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sock.connect(str(folder / SOCKET))
    sock.settimeout(5)
    for packet in packets:
        sock.send(packet)
    return sock


def test_a_disarm_is_put_with_its_user_and_answered_with_its_id(room, tmp_path) -> None:
    with caller(tmp_path, WELL) as sock:
        request = room.poll(0)
        assert request == CommandRequest(-1, "disarm", origin=f"user {os.getuid()}", id="7f3a")
        assert not room.answer(CommandReply(1, True, [])), "the gate's"
        assert room.answer(CommandReply(-1, True, []))
        assert decode(sock.recv(4096)) == CommandReply(-1, True, [], "7f3a")
        assert sock.recv(4096) == b"", "one connection is one wish"
    assert room.poll(10 * MS) is None


@pytest.mark.parametrize("packet", [
    encode(CommandRequest(0, "arm", id="7f3a")),
    encode(CommandRequest(0, "disarm")),
    encode(CommandRequest(0, "disarm", id="7f3a\n")),
    encode(CommandRequest(0, "disarm", id="x" * 65)),
    encode(CommandRequest(0, "disarm", 1.0, id="7f3a")),
    encode(CommandRequest(0, "disarm", mode=2, id="7f3a")),
    encode(CommandRequest(0, "disarm", action="start", id="7f3a")),
    encode(CommandRequest(0, "disarm", ramp=PlannedRamp(1, 2, 3, 4), id="7f3a")),
    encode(EventAck(1)),
    b"\xff",
    b"x" * (REQUEST_LIMIT.record_bytes + 1),
    b"x" * 100_000,
])  # fmt: skip
def test_anything_else_executes_nothing_and_is_told_why(room, tmp_path, packet) -> None:
    with caller(tmp_path, packet) as sock:
        assert room.poll(0) is None
        assert room.poll(PERIOD_NS) is None
        reply = decode(sock.recv(4096))
    assert not reply.accepted
    assert "takes 'disarm' with an id" in reply.reasons[0]
    assert room.counters["disarm_refused"] == 1


def test_all_who_ask_within_a_period_are_one_request(room, tmp_path) -> None:
    asked = [
        caller(tmp_path, encode(CommandRequest(0, "disarm", id=str(k)))) for k in range(WAITING_MAX)
    ]
    requests = []
    for k in range(PERIOD_NS // MS + 1):
        if request := room.poll(k * MS):
            requests.append(request.seq)
            room.answer(CommandReply(request.seq, True, []))
    assert requests == [-1, -2]
    assert [decode(sock.recv(4096)).id for sock in asked] == [str(k) for k in range(WAITING_MAX)]
    assert room.counters["disarm_asked"] == WAITING_MAX


def test_the_work_of_a_poll_is_bounded_and_the_silent_keep_nobody_out(room, tmp_path) -> None:
    silent = []
    for k in range(3 * WAITING_MAX // CALLERS_PER_CYCLE):
        silent += [caller(tmp_path) for _ in range(CALLERS_PER_CYCLE)]
        room.poll(k * MS)
        assert len(room._waiting) <= WAITING_MAX
    assert room.counters["disarm_crowded_out"] == 2 * WAITING_MAX
    with caller(tmp_path, WELL):
        assert room.poll(100 * MS).id == "7f3a"
        room.answer(CommandReply(-1, True, []))
    assert room.poll(SILENT_NS + 100 * MS) is None
    assert room.counters["disarm_silent"] >= WAITING_MAX - 1
    assert not room._waiting
    for sock in silent:
        sock.close()


def test_nobody_is_let_in_while_as_many_wait_as_one_request_serves(room, tmp_path) -> None:
    room._due_ns = 1000 * MS
    asked = []
    for k in range(ASKING_MAX):
        asked += [
            caller(tmp_path, WELL) for _ in range(CALLERS_PER_CYCLE if k < ASKING_MAX // 2 else 0)
        ]
        assert room.poll(k * MS) is None
    asked.append(caller(tmp_path, WELL))
    room.poll(500 * MS)
    assert (len(room._asking), len(room._waiting)) == (ASKING_MAX, 0)
    for sock in asked:
        sock.close()


def test_a_caller_who_leaves_costs_nothing(room, tmp_path) -> None:
    caller(tmp_path, WELL).close()
    caller(tmp_path).close()
    request = room.poll(0)
    room.answer(CommandReply(request.seq, True, []))
    assert room.counters["disarm_lost_caller"] == 1
    assert room.poll(PERIOD_NS) is None


def test_a_second_guard_does_not_take_the_socket(room, tmp_path) -> None:
    with pytest.raises(PeerBusyError):
        DisarmSocket(tmp_path / SOCKET)


def test_a_removed_socket_comes_back(room, tmp_path) -> None:
    room.poll(0)
    (tmp_path / SOCKET).unlink()
    room.poll(2000 * MS)
    with caller(tmp_path, WELL):
        assert room.poll(2001 * MS) is not None


# ------------------------------------------------------------------ the caller's end


class Served:
    """A room that is served a thousand times a second."""

    def __init__(self, room: DisarmSocket) -> None:
        self.requests: list[CommandRequest] = []
        self._room, self._stop = room, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(0.001):
            request = self._room.poll(time.monotonic_ns())
            if request:
                self.requests.append(request)
                self._room.answer(CommandReply(request.seq, True, []))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def served(room) -> Iterator[Served]:
    made = Served(room)
    yield made
    made.close()


def test_who_asks_is_answered(served, tmp_path) -> None:
    assert disarm_socket.ask(tmp_path, "mine", 2.0) == CommandReply(-1, True, [], "mine")
    assert [request.id for request in served.requests] == ["mine"]


def test_without_a_guard_there_is_no_answer_and_no_wait(tmp_path) -> None:
    began = time.monotonic()
    assert disarm_socket.ask(tmp_path, "mine", 2.0) is None
    DisarmSocket(tmp_path / SOCKET).close()
    assert disarm_socket.ask(tmp_path, "mine", 2.0) is None
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(tmp_path / SOCKET))
    assert disarm_socket.ask(tmp_path, "mine", 2.0) is None
    assert time.monotonic() - began < 0.5


def test_a_silent_guard_ends_the_wait(room, tmp_path) -> None:
    began = time.monotonic()
    assert disarm_socket.ask(tmp_path, "mine", 0.6) is None
    assert 0.5 < time.monotonic() - began < 1.5


def test_a_stranger_is_asked_nothing(room, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(disarm_socket, "foreign_server", lambda sock, path: "a stranger")
    assert disarm_socket.ask(tmp_path, "mine", 1.0) is None
    assert room.poll(0) is None


@pytest.mark.parametrize("answer", [b"\xff", encode(EventAck(1))])
def test_an_answer_in_another_tongue_is_none(tmp_path, answer) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(str(tmp_path / SOCKET))
        listener.listen()

        def serve() -> None:
            with listener.accept()[0] as sock:
                sock.recv(4096)
                sock.send(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        assert disarm_socket.ask(tmp_path, "mine", 2.0) is None
        thread.join()


def silent_crowd(folder: Path, stop: threading.Event) -> None:
    held: list[socket.socket] = []
    while not stop.is_set():
        held = [*held[-50:], caller(folder)]


def junk(folder: Path, stop: threading.Event) -> None:
    while not stop.is_set():
        caller(folder, b"\xff").close()


@pytest.mark.parametrize("flood", [silent_crowd, junk])
def test_a_crowd_at_the_socket_holds_nobody_up(
    served, tmp_path, flood: Callable[[Path, threading.Event], None]
) -> None:
    stop = threading.Event()
    thread = threading.Thread(target=flood, args=(tmp_path, stop))
    thread.start()
    try:
        time.sleep(0.1)
        for k in range(20):
            assert disarm_socket.ask(tmp_path, f"id{k}", 2.0).id == f"id{k}"
    finally:
        stop.set()
        thread.join()
