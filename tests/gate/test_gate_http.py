"""The page's server: whole answers, named refusals, and nobody who holds it up."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from firmware_py.gate.http import CONNECTIONS_MAX, HEAD_LIMIT_BYTES, IDLE_NS, HttpServer, respond

BODY = bytes(range(256)) * 8192
CONTENT = {"/": ("text/html", b"page"), "/large": ("application/octet-stream", BODY)}


class Served:
    """A server on a clock of its own."""

    def __init__(self) -> None:
        self.server = HttpServer(0, CONTENT)
        self.now_ns = 0

    def connect(self, data: bytes = b"") -> socket.socket:
        sock = socket.create_connection(("127.0.0.1", self.server.port), 5)
        sock.sendall(data)
        return sock

    def step(self, n: int = 1, passes_ns: int = 10_000_000) -> None:
        for _ in range(n):
            self.now_ns += passes_ns
            self.server.step(self.now_ns)

    def answer(self, sock: socket.socket) -> bytes:
        """All that comes until the server closes."""
        sock.settimeout(0.01)
        found = b""
        for _ in range(1000):
            self.step()
            try:
                data = sock.recv(1 << 20)
            except TimeoutError:
                continue
            except ConnectionResetError:
                return found
            if not data:
                return found
            found += data
        raise AssertionError("never closed")


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.server.close()


@pytest.mark.parametrize(
    ("request_", "status", "body"),
    [
        (b"GET / HTTP/1.1\r\nHost: a\r\n\r\n", b"200", b"page"),
        (b"GET /?x=1 HTTP/1.0\n\n", b"200", b"page"),
        (b"HEAD / HTTP/1.1\r\n\r\n", b"200", b""),
        (b"GET /../etc/passwd HTTP/1.1\r\n\r\n", b"404", None),
        (b"POST / HTTP/1.1\r\n\r\n", b"501", None),
        (b"\xff\xfe\r\n\r\n", b"400", None),
        (b"GET  HTTP/1.1\r\n\r\n", b"400", None),
        (b"GET / HTTP/2.0\r\n\r\n", b"400", None),
        (b"x" * (HEAD_LIMIT_BYTES + 1), b"431", None),
    ],
)
def test_every_request_gets_one_answer(served, request_, status, body):
    with served.connect(request_) as sock:
        head, _, found = served.answer(sock).partition(b"\r\n\r\n")
    assert head.split()[1] == status
    assert b"default-src 'self'" in head
    if body is not None:
        assert found == body
    assert served.server.counters["http_answered" if status == b"200" else "http_refused"] == 1


def test_a_large_body_arrives_whole_while_others_are_served(served):
    with (
        served.connect(b"GET /large HTTP/1.1\r\n\r\n") as slow,
        served.connect(b"GET / HTTP/1.1\r\n\r\n") as quick,
    ):
        served.step(3)
        assert served.answer(quick).endswith(b"page")
        assert served.answer(slow).endswith(BODY)


def test_a_request_in_pieces_is_waited_for_but_not_for_ever(served):
    with served.connect(b"GET / HT") as patient, served.connect(b"GET") as idle:
        served.step(3)
        patient.sendall(b"TP/1.1\r\n\r\n")
        assert served.answer(patient).endswith(b"page")
        served.step(1, IDLE_NS)
        assert served.answer(idle) == b""
    assert served.server.counters["http_dropped"] == 1


def test_a_crowd_that_asks_nothing_shuts_nobody_out(served):
    crowd = []
    for _ in range(CONNECTIONS_MAX + 10):
        crowd.append(served.connect())
        served.step()
    with served.connect(b"GET / HTTP/1.1\r\n\r\n") as late:
        assert served.answer(late).endswith(b"page")
    assert served.server.counters["http_dropped"] >= 10
    for sock in crowd:
        sock.close()
    served.step(50)
    assert not served.server._connections


def test_any_head_has_an_answer_without_a_server():
    assert bytes(respond(b"", {})[1]).startswith(b"HTTP/1.1 400")
