"""A small HTTP/1.1 server for a loop: it never blocks, starts no thread, and does bounded work in
each step.

It answers GET and HEAD with what was rendered before; everything else is refused.  One request a
connection.
"""

from __future__ import annotations

import contextlib
import re
import socket
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Final

CONNECTIONS_MAX: Final = 32
"""Open at once; a newcomer beyond takes the place of the oldest, so that idle ones shut nobody
out."""

ACCEPTS_PER_STEP: Final = 8
"""At a hundred steps a second this is the greatest rate of requests."""

HEAD_LIMIT_BYTES: Final = 8192
SEND_BYTES: Final = 256 * 1024
IDLE_NS: Final = 5_000_000_000
_REQUEST: Final = re.compile(rb"([A-Z]{1,16}) ([!-~]{1,2048}) HTTP/1\.[01]\r?\n")

Content = Mapping[str, tuple[str, bytes]]
"""Media type and body by path."""


@dataclass
class _Connection:
    sock: socket.socket
    since_ns: int
    head: bytes = b""
    answer: memoryview | None = None


class HttpServer:
    """Serves ``content`` on a port of the loopback, one :meth:`step` at a time.

    Raises
    ------
    OSError
        The port is taken.

    Notes
    -----
    ``counters``: ``http_answered``, ``http_refused`` (answered with an error), ``http_dropped``
    (gone, idle or crowded out before the answer).
    """

    def __init__(self, port: int, content: Content) -> None:
        self.counters: Counter[str] = Counter()
        self._content = content
        self._listener = socket.create_server(("127.0.0.1", port), backlog=CONNECTIONS_MAX)
        self._listener.setblocking(False)
        self._connections: list[_Connection] = []
        self.port: int = self._listener.getsockname()[1]

    def step(self, now_ns: int) -> None:
        """Accept, read, answer; nothing waits."""
        for _ in range(ACCEPTS_PER_STEP):
            try:
                sock, _ = self._listener.accept()
            except OSError:
                break
            sock.setblocking(False)
            self._connections.append(_Connection(sock, now_ns))
        for connection in self._connections[: max(0, len(self._connections) - CONNECTIONS_MAX)]:
            self._end(connection, "http_dropped")
        for connection in list(self._connections):
            self._serve(connection, now_ns)

    def close(self) -> None:
        """Close every socket."""
        for connection in self._connections:
            connection.sock.close()
        self._listener.close()

    def _serve(self, connection: _Connection, now_ns: int) -> None:
        try:
            if connection.answer is None:
                self._read(connection)
            if connection.answer is not None:
                sent = connection.sock.send(connection.answer[:SEND_BYTES])
                connection.answer = connection.answer[sent:]
                if not connection.answer:
                    self._end(connection)
                    return
        except BlockingIOError:
            pass
        except OSError:
            self._end(connection, "http_dropped")
            return
        if now_ns - connection.since_ns > IDLE_NS:
            self._end(connection, "http_dropped")

    def _read(self, connection: _Connection) -> None:
        data = connection.sock.recv(HEAD_LIMIT_BYTES + 1 - len(connection.head))
        connection.head += data
        if not data:
            raise ConnectionResetError
        if (
            b"\r\n\r\n" in connection.head
            or b"\n\n" in connection.head
            or len(connection.head) > HEAD_LIMIT_BYTES
        ):
            status, connection.answer = respond(connection.head, self._content)
            self.counters["http_answered" if status == HTTPStatus.OK else "http_refused"] += 1

    def _end(self, connection: _Connection, count: str = "") -> None:
        if count:
            self.counters[count] += 1
        with contextlib.suppress(OSError):
            connection.sock.shutdown(
                socket.SHUT_WR
            )  # what is still unread must not reset what was sent
        connection.sock.close()
        self._connections.remove(connection)


def respond(head: bytes, content: Content) -> tuple[HTTPStatus, memoryview]:
    """Status and whole answer to the request that ``head`` begins; total: any bytes get one."""
    request = _REQUEST.match(head)
    if len(head) > HEAD_LIMIT_BYTES:
        return _answer(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
    if request is None:
        return _answer(HTTPStatus.BAD_REQUEST)
    method, target = request.group(1), request.group(2).decode("ascii")
    if method not in (b"GET", b"HEAD"):
        return _answer(HTTPStatus.NOT_IMPLEMENTED)
    found = content.get(target.partition("?")[0])
    return (
        _answer(HTTPStatus.OK, *found, bare=method == b"HEAD")
        if found
        else _answer(HTTPStatus.NOT_FOUND)
    )


def _answer(
    status: HTTPStatus,
    kind: str = "text/plain; charset=utf-8",
    body: bytes = b"",
    *,
    bare: bool = False,
) -> tuple[HTTPStatus, memoryview]:
    body = body or f"{status.value} {status.phrase}\n".encode()
    head = (
        f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: {kind}\r\nContent-Length: "
        f"{len(body)}\r\n"
        "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n"
        "Content-Security-Policy: default-src 'self' 'unsafe-inline'\r\nConnection: close\r\n\r\n"
    ).encode()
    return status, memoryview(head if bare else head + body)
