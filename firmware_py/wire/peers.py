"""The links between guard, brain and gate: ``SOCK_SEQPACKET`` Unix sockets that never block.

One packet is one record (:func:`firmware_py.records.encode`).  A process that others talk to owns a
:class:`PeerServer`; the others hold a :class:`PeerClient` each, which comes back by itself.  One
peer per role: the first packet of a peer is a :class:`~firmware_py.records.Hello`, and the kernel
vouches for its user.  A reader that is too slow loses its own records, counted; nobody waits for
it.
"""

from __future__ import annotations

import os
import re
import select
import socket
import stat
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from firmware_py.machine.values import NAME_PATTERN, WORDS
from firmware_py.records import Hello, PeerRecord
from firmware_py.wire.folders import foreign_server, peer_uid, unsafe
from firmware_py.wire.listener import INSTANCE_MODE, Listener
from firmware_py.wire.peer_socket import (
    ANY_PEER,
    MAX_WAITING,
    NEWCOMER,
    Limit,
    Peer,
    PeerError,
)

HELLO_WITHIN_NS: Final = 1_000_000_000
RECONNECT_AFTER_NS: Final = 200_000_000


def runtime_dir(instance: str, base: Path) -> Path:
    """Runtime directory of ``instance``: made when absent, refused when a foreign user could own
    the sockets.

    Raises
    ------
    PeerError
        ``instance`` is no name, the folder cannot be made, or :func:`checked_dir` refuses it.
    """
    if not re.search(NAME_PATTERN, instance):
        raise PeerError(f"instance {instance[:40]!r}: use {WORDS[NAME_PATTERN]}")
    path = base / instance
    try:
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        path.mkdir(mode=INSTANCE_MODE, exist_ok=True)
    except OSError as error:
        raise _refused(path, error.strerror or str(error)) from error
    return checked_dir(path)


def checked_dir(path: Path) -> Path:
    """``path``, when neither it nor a folder on the way to it lets others put sockets there.

    Raises
    ------
    PeerError
        One of them does.
    """
    if (
        path.is_dir()
        and path.stat().st_uid == os.geteuid() != 0
        and path.stat().st_mode & stat.S_IWGRP
    ):
        path.chmod(INSTANCE_MODE)  # as earlier releases made it
    if reason := unsafe(path):
        raise _refused(path, reason)
    return path


def _refused(path: Path, cause: str) -> PeerError:
    return PeerError(
        f"runtime directory {path}: {cause}; remove what is there or set RUNTIME_DIRECTORY to "
        "a directory of your own"
    )


class PeerServer:
    """The listening end.

    Parameters
    ----------
    path
        Socket path; its directory exists.  ``<path>.lock`` beside it says who owns it.
    allowed
        Roles that may connect, each with the user id that it must have; None is the server's own.
    limits
        What a role may put in per :meth:`poll`, where that is less than a socket holds.

    Raises
    ------
    PeerBusyError
        Another process serves ``path``.
    PeerError
        The path is too long or cannot be bound.

    Notes
    -----
    ``counters`` (by role): ``lost_``, ``oversized_``, ``malformed_``, ``connected_``, ``left_``;
    refused newcomers: ``refused_role``, ``refused_uid``, ``refused_second``, ``refused_hello``,
    ``refused_crowd``; ``listened_again`` and ``listen_failed`` after the socket was removed.
    """

    def __init__(
        self,
        path: Path,
        allowed: Mapping[str, int | None],
        limits: Mapping[str, Limit] | None = None,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._limits = limits or {}
        self._allowed = {
            role: os.geteuid() if uid is None else uid for role, uid in allowed.items()
        }
        self.path = path
        self._listener = Listener(path, self.counters)
        self._peers: dict[str, Peer] = {}
        self._newcomers: dict[int, tuple[Peer, int]] = {}
        self._by_fd: dict[int, Peer] = {}
        self._epoll = select.epoll()
        self._epoll.register(self._listener, select.EPOLLIN)

    def fileno(self) -> int:
        """Readable when :meth:`poll` has something to do."""
        return self._epoll.fileno()

    def poll(self, now_ns: int) -> list[tuple[str, PeerRecord]]:
        """What is waiting, up to each peer's limit, with its sender's role; also admits and
        dismisses peers."""
        received: list[tuple[str, PeerRecord]] = []
        if self._listener.look(now_ns):
            self._epoll.register(self._listener, select.EPOLLIN)
        ready = [fd for fd, _ in self._epoll.poll(0, 16)]
        # Peers before newcomers: who replaces a dead peer must find its place free.
        for peer in [self._by_fd[fd] for fd in ready if fd in self._by_fd]:
            received += [(peer.role, record) for record in peer.receive()]
            if not peer.alive:
                self._leave(peer)
        if self._newcomers:
            self._question(now_ns)
        if self._listener.fileno() in ready:
            self._accept(now_ns)
        return received

    def send(self, role: str, record: PeerRecord) -> bool:
        """Send to ``role`` without waiting.

        Returns
        -------
        False when nobody plays the role, or when the peer's queue is full (then counted
        ``lost_<role>``).
        """
        peer = self._peers.get(role)
        if peer is None:
            return False
        sent = peer.send(record)
        if not peer.alive:
            self._leave(peer)
        return sent

    def connected(self, role: str) -> bool:
        """Whether a peer plays ``role`` now."""
        return role in self._peers

    def close(self) -> None:
        """Close every socket and remove the path."""
        for peer in [*self._peers.values(), *(peer for peer, _ in self._newcomers.values())]:
            peer.sock.close()
        self._epoll.close()
        self._listener.close()

    def _accept(self, now_ns: int) -> None:
        """Let waiting connections in; they have one second to say who they are."""
        for _ in range(MAX_WAITING):  # who connects in an endless loop must not keep us here
            sock = self._listener.accept()
            if sock is None:
                return
            if len(self._newcomers) >= MAX_WAITING:
                self._dismiss_oldest()
            peer = Peer(sock, self.counters, limit=NEWCOMER)
            self._newcomers[sock.fileno()] = (peer, now_ns)
            self._epoll.register(sock, select.EPOLLIN)

    def _dismiss_oldest(self) -> None:
        """Make place among those that wait: who crowds it without a word must not keep a peer
        out."""
        fd, (oldest, _) = next(iter(self._newcomers.items()))
        del self._newcomers[fd]
        self._epoll.unregister(fd)
        oldest.sock.close()
        self.counters["refused_crowd"] += 1

    def _question(self, now_ns: int) -> None:
        """Read the first packet of each newcomer: admit it to its role, or refuse it."""
        for fd, (peer, since_ns) in list(self._newcomers.items()):
            first = peer.receive()
            if peer.alive and not peer.heard and now_ns - since_ns < HELLO_WITHIN_NS:
                continue
            del self._newcomers[fd]
            refusal = self._refusal(first[0] if first else None, peer.sock)
            if refusal is None and isinstance(first[0], Hello):
                self._admit(peer, first[0].role)
            else:
                self.counters[f"refused_{refusal}"] += 1
                self._epoll.unregister(fd)
                peer.sock.close()

    def _refusal(self, first: PeerRecord | None, sock: socket.socket) -> str | None:
        if not isinstance(first, Hello):
            return "hello"
        if first.role not in self._allowed:
            return "role"
        if peer_uid(sock) != self._allowed[first.role]:
            return "uid"
        return "second" if first.role in self._peers else None

    def _admit(self, peer: Peer, role: str) -> None:
        peer.admit(role, self._limits.get(role, ANY_PEER))
        self._peers[role] = peer
        self._by_fd[peer.sock.fileno()] = peer
        self.counters[f"connected_{role}"] += 1

    def _leave(self, peer: Peer) -> None:
        self._epoll.unregister(peer.sock)
        del self._by_fd[peer.sock.fileno()]
        del self._peers[peer.role]
        self.counters[f"left_{peer.role}"] += 1
        peer.sock.close()


class PeerClient:
    """The calling end: connects, says who it is, and comes back by itself when the server was away.

    The server must be this user's or root's (:func:`firmware_py.wire.folders.foreign_server`), or
    ``server_uid``. ``counters``: ``lost_<role>``, ``oversized_<role>``, ``malformed_<role>``,
    ``connected``, ``left``, ``refused_server``.
    """

    def __init__(self, path: Path, role: str, server_uid: int | None = None) -> None:
        self._server_uid = server_uid
        self.counters: Counter[str] = Counter()
        self.path = path
        self._role = role
        self._peer: Peer | None = None
        self._next_try_ns: int | None = None

    @property
    def connected(self) -> bool:
        """Whether the server has taken the connection (it may still refuse the role and close)."""
        return self._peer is not None

    def fileno(self) -> int:
        """Readable when a record waits; -1 while not connected."""
        return self._peer.sock.fileno() if self._peer else -1

    def poll(self, now_ns: int) -> list[PeerRecord]:
        """Every record that is waiting; also tries to connect, at most once in 0.2 s."""
        if self._peer is None:
            self._connect(now_ns)
        if self._peer is None:
            return []
        records = self._peer.receive()
        self._drop_if_dead()
        return records

    def send(self, record: PeerRecord) -> bool:
        """Send without waiting; False when not connected, or when the server's queue is full
        (counted)."""
        if self._peer is None:
            return False
        sent = self._peer.send(record)
        self._drop_if_dead()
        return sent

    def close(self) -> None:
        """Close the connection."""
        if self._peer:
            self._peer.sock.close()
            self._peer = None

    def _connect(self, now_ns: int) -> None:
        if self._next_try_ns is not None and now_ns < self._next_try_ns:
            return
        self._next_try_ns = now_ns + RECONNECT_AFTER_NS
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        peer = Peer(sock, self.counters, self._role)
        try:
            sock.connect(str(self.path))
        except OSError:
            sock.close()
            return
        if foreign_server(sock, self.path, self._server_uid):
            self.counters["refused_server"] += 1
            sock.close()
        elif peer.send(Hello(role=self._role, pid=os.getpid())):
            self._peer = peer
            self.counters["connected"] += 1
        else:
            sock.close()

    def _drop_if_dead(self) -> None:
        if self._peer and not self._peer.alive:
            self.close()
            self.counters["left"] += 1
