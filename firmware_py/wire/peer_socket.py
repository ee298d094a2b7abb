"""Unix ``SOCK_SEQPACKET`` sockets underneath the processes: one packet is one record, nothing ever
blocks."""

from __future__ import annotations

import errno
import socket
from collections import Counter
from typing import Final, NamedTuple

from firmware_py.decoding import UNDECODABLE
from firmware_py.errors import OrbitdError
from firmware_py.records import PeerRecord, decode, encode

MAX_RECORD_BYTES: Final = 128 * 1024
"""A larger record is refused at both ends: it would fill half of a default socket buffer."""

SOCKET_BUFFER_BYTES: Final = 4 * 1024 * 1024
"""Asked for; the kernel grants up to ``net.core.wmem_max`` (212 kB by default, some 250 blocks)."""


class Limit(NamedTuple):
    """What one peer may put in per poll; the rest waits in the kernel."""

    records: int
    record_bytes: int


ANY_PEER: Final = Limit(records=256, record_bytes=MAX_RECORD_BYTES)
NEWCOMER: Final = Limit(records=1, record_bytes=1024)
"""Who has not said who it is may say just that."""

MAX_WAITING: Final = 8

_GONE: Final = (errno.EPIPE, errno.ECONNRESET, errno.ENOTCONN)


class PeerError(OrbitdError):
    """A process's socket cannot be set up."""


class PeerBusyError(PeerError):
    """Another living process owns the socket."""


class Peer:
    """One connected socket: records in, records out, every loss counted under ``<what>_<role>``."""

    def __init__(
        self,
        sock: socket.socket,
        counters: Counter[str],
        role: str = "newcomer",
        limit: Limit = ANY_PEER,
    ) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_BYTES)
        self.sock = sock
        self.role = role
        self.alive = True
        self.heard = False
        self._counters = counters
        self.admit(role, limit)

    def admit(self, role: str, limit: Limit) -> None:
        """From now on it plays ``role`` and may put in so much."""
        self.role, self._limit = role, limit
        self._buffer = memoryview(bytearray(limit.record_bytes))

    def receive(self) -> list[PeerRecord]:
        """What is waiting, up to the peer's limit; ``alive`` turns False at the end of the
        connection."""
        records: list[PeerRecord] = []
        for _ in range(self._limit.records):
            try:
                size = self.sock.recv_into(self._buffer, 0, socket.MSG_TRUNC)
            except BlockingIOError:
                break
            except OSError:
                size = 0
            if size == 0:
                self.alive = False
                break
            self.heard = True
            record = self._decode(size)
            if record is not None:
                records.append(record)
        return records

    def _decode(self, size: int) -> PeerRecord | None:
        if size > self._limit.record_bytes:
            self._counters[f"oversized_{self.role}"] += 1
            return None
        try:
            return decode(bytes(self._buffer[:size]))
        except UNDECODABLE:
            self._counters[f"malformed_{self.role}"] += 1
            return None

    def send(self, record: PeerRecord) -> bool:
        """Hand ``record`` to the kernel; False: it is lost, and counted."""
        data = encode(record)
        if len(data) > MAX_RECORD_BYTES:
            self._counters[f"oversized_{self.role}"] += 1
            return False
        try:
            self.sock.send(data)
            return True
        except OSError as error:
            self.alive = error.errno not in _GONE
            oversized = error.errno == errno.EMSGSIZE
            self._counters[f"{'oversized' if oversized else 'lost'}_{self.role}"] += 1
            return False
