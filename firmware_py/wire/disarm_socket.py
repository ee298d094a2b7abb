"""The short way of a local ``disarm``: a socket of the guard's own, past gate, Zenoh and every
queue of theirs.

One connection is one request: :class:`~firmware_py.records.CommandRequest` in (verb ``disarm``, an
id, nothing else), :class:`~firmware_py.records.CommandReply` out, closed.  Who may write to the
socket may disarm; the kernel holds to its mode (owner and group), as on the gate's socket, and
names the user, whom the event of the command then names as well.  All other commands, and all from
the network, take the way through the gate.
"""

from __future__ import annotations

import contextlib
import re
import socket
import struct
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from firmware_py.decoding import UNDECODABLE
from firmware_py.records import REQUEST_ID, CommandReply, CommandRequest, decode, encode
from firmware_py.wire.folders import foreign_server, peer_uid
from firmware_py.wire.listener import Listener
from firmware_py.wire.peer_socket import Limit, Peer

SOCKET: Final = "disarm.sock"
CALLERS_PER_CYCLE: Final = 2
"""Taken in by one :meth:`DisarmSocket.poll`; the others wait in the kernel's queue, which holds
eight, in their order."""

WAITING_MAX: Final = 8
"""Who has not said a word yet; one more takes the place of the oldest."""

ASKING_MAX: Final = 16
"""Callers that one request to the core serves; while so many wait, nobody is let in."""

PERIOD_NS: Final = 10_000_000
"""Between two requests to the core, whatever the rate of the callers."""

SILENT_NS: Final = 1_000_000_000
REQUEST_LIMIT: Final = Limit(records=1, record_bytes=512)
ANSWER_BYTES: Final = 4096
TRY_S: Final = 0.25
"""How long a caller waits for one answer before he asks anew."""


@dataclass
class _Caller:
    peer: Peer
    since_ns: int
    uid: int
    request_id: str = ""

    def end(self, reply: CommandReply | None = None) -> None:
        """Answer, if there is an answer, and close."""
        if reply is not None:
            self.peer.send(reply)
        self.peer.sock.close()


class DisarmSocket:
    """The guard's end; bounded work in each :meth:`poll`, whoever calls at whatever rate.

    Parameters
    ----------
    path
        Socket path; its directory exists.

    Raises
    ------
    PeerBusyError, PeerError
        As for :class:`~firmware_py.wire.listener.Listener`.

    Notes
    -----
    ``counters``: ``disarm_asked`` (requests that were executed), ``disarm_refused`` (packets that
    are no disarm), ``disarm_crowded_out`` and ``disarm_silent`` (closed before a word),
    ``disarm_malformed_caller``, ``disarm_oversized_caller``, ``disarm_lost_caller`` (answers that
    nobody took), ``disarm_listened_again``, ``disarm_listen_failed``.
    """

    def __init__(self, path: Path) -> None:
        self._counters: Counter[str] = Counter()
        self._of_sockets: Counter[str] = Counter()
        self._listener = Listener(path, self._of_sockets)
        self._waiting: list[_Caller] = []
        self._asking: list[_Caller] = []
        self._seq = 0
        self._due_ns = 0

    @property
    def counters(self) -> dict[str, int]:
        """Every count of the socket, by name."""
        return {
            **self._counters,
            **{f"disarm_{name}": count for name, count in self._of_sockets.items()},
        }

    def poll(self, now_ns: int) -> CommandRequest | None:
        """The request that serves all who have asked, None when there is none to put now.

        Its number is negative: the gate's are positive.
        """
        self._listener.look(now_ns)
        if len(self._asking) < ASKING_MAX:
            self._admit(now_ns)
            self._hear(now_ns)
        if not self._asking or now_ns < self._due_ns:
            return None
        self._due_ns = now_ns + PERIOD_NS
        self._seq -= 1
        first = self._asking[0]
        return CommandRequest(self._seq, "disarm", origin=f"user {first.uid}", id=first.request_id)

    def answer(self, reply: CommandReply) -> bool:
        """Hand ``reply`` to all whom it answers; False when it answers no request of this
        socket."""
        if reply.seq >= 0:
            return False
        self._counters["disarm_asked"] += len(self._asking)
        for caller in self._asking:
            caller.end(CommandReply(reply.seq, reply.accepted, reply.reasons, caller.request_id))
        self._asking.clear()
        return True

    def close(self) -> None:
        """Close every socket and remove the path."""
        for caller in [*self._waiting, *self._asking]:
            caller.end()
        self._listener.close()

    def _admit(self, now_ns: int) -> None:
        for _ in range(CALLERS_PER_CYCLE):
            sock = self._listener.accept()
            if sock is None:
                return
            if len(self._waiting) >= WAITING_MAX:
                self._waiting.pop(0).end()
                self._counters["disarm_crowded_out"] += 1
            peer = Peer(sock, self._of_sockets, "caller", REQUEST_LIMIT)
            self._waiting.append(_Caller(peer, now_ns, peer_uid(sock)))

    def _hear(self, now_ns: int) -> None:
        """Read the one packet of each caller who has sent it."""
        silent = []
        for caller in self._waiting:
            said = caller.peer.receive()
            if not said and caller.peer.alive and not caller.peer.heard:
                if now_ns - caller.since_ns < SILENT_NS:
                    silent.append(caller)
                    continue
                self._counters["disarm_silent"] += 1
                caller.end()
            elif said and isinstance(said[0], CommandRequest) and is_disarm(said[0]):
                caller.request_id = said[0].id
                self._asking.append(caller)
            else:
                self._counters["disarm_refused"] += 1
                caller.end(CommandReply(0, False, [ONLY_DISARM]) if caller.peer.alive else None)
        self._waiting = silent


ONLY_DISARM: Final = (
    f"{SOCKET} takes 'disarm' with an id of 1 to 64 printable characters and nothing else; "
    "put other commands to the gate"
)


def is_disarm(request: CommandRequest) -> bool:
    """Whether ``request`` is a plain ``disarm`` with an id."""
    plain = CommandRequest(request.seq, "disarm", origin=request.origin, id=request.id)
    return request == plain and re.search(REQUEST_ID, request.id) is not None


def ask(runtime: Path, request_id: str, within_s: float) -> CommandReply | None:
    """Disarm the device whose runtime directory is ``runtime``, without the gate.

    Parameters
    ----------
    wish_id
        Comes back in the answer.
    within_s
        How long to go on trying, in seconds.

    Returns
    -------
    The guard's answer; None when none came: no guard of this user, of root or of the socket's
    owner (:func:`~firmware_py.wire.folders.foreign_server`) serves the folder, or it is silent.
    """
    end_s = time.monotonic() + within_s
    while (left_s := end_s - time.monotonic()) > 0:
        try:
            reply = _try(runtime / SOCKET, request_id, min(left_s, TRY_S))
        except (FileNotFoundError, ConnectionRefusedError, PermissionError, ValueError):
            return None  # nobody listens there
        except OSError:
            continue  # crowded out, or no answer yet
        if reply is None or reply.id == request_id:
            return reply
    return None


def _try(path: Path, request_id: str, within_s: float) -> CommandReply | None:
    """One connection; None when the server is not to be trusted or does not speak our tongue."""
    with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)) as sock:
        # Blocking, with the kernel's own limits of time: it keeps those who wait in their order.
        limit = struct.pack("ll", int(within_s), int(within_s % 1 * 1e6))
        for option in (socket.SO_SNDTIMEO, socket.SO_RCVTIMEO):
            sock.setsockopt(socket.SOL_SOCKET, option, limit)
        sock.connect(str(path))
        if foreign_server(sock, path):
            return None
        sock.send(encode(CommandRequest(0, "disarm", id=request_id)))
        data = sock.recv(ANSWER_BYTES)
        if not data:
            raise ConnectionResetError
        try:
            reply = decode(data)
        except UNDECODABLE:
            return None
        return reply if isinstance(reply, CommandReply) else None
