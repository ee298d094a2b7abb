"""The hub: a CAN bus for processes of one machine, over Unix ``SOCK_SEQPACKET``.

    python hub.py SOCKET LOCK_FD        # started by the first bus that finds no hub (hub_bus.py)

Every client is a node on the bus from the welcome (one empty packet) on: what one sends, all others
receive, one packet per frame::

    timestamp_ns u64   wall clock at which the hub took the frame (0 from the client)
    arbitration_id u32
    lost u32           frames that THIS receiver has lost so far, because its queue was full
    flags u8           EXTENDED, FD, ... below
    length u8          bytes of data
    data

The hub never blocks a sender.  Each receiver has one bounded queue (the socket's buffer, then
``QUEUE_FRAMES`` here); when it is full that receiver loses the newest frame and its ``lost``
counts.

It imports nothing but the standard library, and ends by itself when its last client has been gone
for ``LINGER_S``.  The lock decides who may start a hub or remove its socket; a starting hub
inherits the lock and releases it once it listens, so nobody ever waits for a hub while holding it.
"""

from __future__ import annotations

import fcntl
import os
import select
import signal
import socket
import stat
import struct
import sys
import time
from collections import deque
from pathlib import Path
from typing import Final

HEADER: Final = struct.Struct("<QIIBB")
MAX_PACKET: Final = HEADER.size + 64
WELCOME: Final = bytes(HEADER.size)
LOST: Final = struct.Struct("<I")
LOST_OFFSET: Final = 12
FLAGS_OFFSET: Final = 16

QUEUE_FRAMES: Final = 4096
SOCKET_BUFFER_BYTES: Final = 1 << 20
BATCH: Final = 64
LINGER_S: Final = 3.0
LOOK_EVERY_S: Final = 1.0
"""How often the hub looks whether its socket still lies where newcomers look for it."""


# Bits of a packet's flags.
EXTENDED: Final = 1
FD: Final = 2
BIT_RATE_SWITCH: Final = 4
ERROR_STATE: Final = 8
ERROR_FRAME: Final = 16
REMOTE: Final = 32
OWN: Final = 128  # to the hub: send it back to me too; from the hub: you sent this


class HubClient:
    """One node on the bus and its queue."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_BYTES)
        self.sock = sock
        self.waiting: deque[bytes] = deque()
        self.lost = 0

    def deliver(self, packet: memoryview) -> bool:
        """Send or queue ``packet``, else count it as lost; True when the queue has just begun to
        fill."""
        LOST.pack_into(packet, LOST_OFFSET, self.lost & 0xFFFFFFFF)
        if not self.waiting:
            try:
                self.sock.send(packet)
                return False
            except BlockingIOError:
                pass
            except OSError:
                return False  # it has gone; its end of file removes it
        if len(self.waiting) >= QUEUE_FRAMES:
            self.lost += 1
            return False
        self.waiting.append(bytes(packet))
        return len(self.waiting) == 1

    def flush(self) -> bool:
        """Send what waits; True when nothing is left."""
        try:
            while self.waiting:
                self.sock.send(self.waiting[0])
                self.waiting.popleft()
        except BlockingIOError:
            return False
        except OSError:
            self.waiting.clear()
        return True


class Hub:
    """The bus itself: accepts clients and copies every frame to all others."""

    def __init__(self, listener: socket.socket, *, open_to_all: bool = False) -> None:
        self._listener = listener
        self._open = open_to_all
        self._clients: dict[int, HubClient] = {}
        self._epoll = select.epoll()
        self._epoll.register(listener, select.EPOLLIN)
        self._packet = bytearray(MAX_PACKET)
        self._view = memoryview(self._packet)

    def step(self, timeout_s: float) -> bool:
        """Wait for traffic and pass it on; True while there are clients."""
        for descriptor, events in self._epoll.poll(timeout_s):
            client = self._clients.get(descriptor)
            if client is None:
                self.accept()
                continue
            if events & select.EPOLLOUT and client.flush():
                self._epoll.modify(descriptor, select.EPOLLIN)
            if events & ~select.EPOLLOUT and not self._receive(client):
                self._remove(descriptor)
        return bool(self._clients)

    def accept(self) -> bool:
        """Take one waiting client, if there is one."""
        try:
            sock, _ = self._listener.accept()
        except OSError:
            return False
        if not self._welcome(sock):
            sock.close()
            return True
        self._clients[sock.fileno()] = HubClient(sock)
        self._epoll.register(sock, select.EPOLLIN)
        return True

    def _welcome(self, sock: socket.socket) -> bool:
        """Tell ``sock`` that it is on the bus; not a user for whom the folder was not made."""
        credentials = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        if not self._open and struct.unpack("3i", credentials)[1] not in (0, os.geteuid()):
            return False
        try:
            sock.send(WELCOME)
        except OSError:
            return False
        return True

    def listen(self, listener: socket.socket) -> None:
        """Take newcomers from ``listener`` from now on; who is on the bus stays."""
        self._epoll.unregister(self._listener)
        self._listener.close()
        self._listener = listener
        self._epoll.register(listener, select.EPOLLIN)

    def dismiss(self) -> None:
        """Send everybody away: another hub serves the channel, and they find it by themselves."""
        for descriptor in list(self._clients):
            self._remove(descriptor)

    def _receive(self, sender: HubClient) -> bool:
        """Pass on at most BATCH frames of ``sender``; False when it has left or sends what is no
        frame."""
        for _ in range(BATCH):
            try:
                size = sender.sock.recv_into(self._view)
            except BlockingIOError:
                return True
            except ConnectionResetError:
                continue  # it left without reading all; what it sent before still waits
            except OSError:
                return False
            if size < HEADER.size or size != HEADER.size + self._packet[HEADER.size - 1]:
                return False
            self._pass_on(sender, self._view[:size])
        return True

    def _pass_on(self, sender: HubClient, packet: memoryview) -> None:
        struct.pack_into("<Q", packet, 0, time.time_ns())
        echo = packet[FLAGS_OFFSET] & OWN
        packet[FLAGS_OFFSET] &= 0xFF ^ OWN
        for client in self._clients.values():
            if client is not sender and client.deliver(packet):
                self._epoll.modify(client.sock, select.EPOLLIN | select.EPOLLOUT)
        if echo:
            packet[FLAGS_OFFSET] |= OWN
            if sender.deliver(packet):
                self._epoll.modify(sender.sock, select.EPOLLIN | select.EPOLLOUT)

    def _remove(self, descriptor: int) -> None:
        self._epoll.unregister(descriptor)
        self._clients.pop(descriptor).sock.close()


def serve(path: Path, lock_path: Path, listener: socket.socket) -> None:
    """Run until nobody has been on the bus for ``LINGER_S``."""
    folder = path.parent.stat()
    shared = folder.st_uid == 0 and bool(
        folder.st_mode & stat.S_IWGRP
    )  # made by an administrator for a group
    hub = Hub(listener, open_to_all=shared)
    ours = _inode(path)
    last_client_s = looked_s = time.monotonic()
    while True:
        if time.monotonic() - looked_s > LOOK_EVERY_S:
            looked_s = time.monotonic()
            ours = _look(hub, path, lock_path, ours)
        if hub.step(LINGER_S / 4):
            last_client_s = time.monotonic()
        elif time.monotonic() - last_client_s > LINGER_S and _retire(hub, path, lock_path, ours):
            return


def _look(
    hub: Hub, path: Path, lock_path: Path, ours: tuple[int, int] | None
) -> tuple[int, int] | None:
    """Listen again when somebody removed the socket; give way when another hub has taken its
    place."""
    if ours is not None and _inode(path) == ours:
        return ours
    try:
        if not path.parent.exists():
            path.parent.mkdir()
            path.parent.chmod(0o700)  # whatever the umask
        with lock_path.open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _inode(path) is not None:
                hub.dismiss()
                return ours
            hub.listen(_listener(path))
    except OSError:
        return ours  # somebody holds the lock, or the folder cannot be made: look again later
    return _inode(path)


def _listener(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(str(path))
    listener.listen(64)
    listener.setblocking(False)
    return listener


def _inode(path: Path) -> tuple[int, int] | None:
    """What ``path`` names, None when nothing."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _retire(hub: Hub, path: Path, lock_path: Path, ours: tuple[int, int] | None) -> bool:
    """Remove the socket, unless someone is about to connect (they hold the lock) or just has."""
    try:
        with lock_path.open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if hub.accept():
                return False
            if _inode(path) == ours:
                path.unlink(missing_ok=True)
    except BlockingIOError:
        return False
    except FileNotFoundError:
        pass  # the whole directory has gone
    return True


def lock_path_of(path: Path) -> Path:
    """The lock that guards the hub's socket ``path``."""
    return path.with_suffix(".lock")


def main(arguments: list[str]) -> int:
    """Listen on ``arguments[0]``, release the inherited lock ``arguments[1]``, serve."""
    path, lock = Path(arguments[0]), int(arguments[1])
    # Whoever came first may be a real-time process on a core of its own; the hub is neither.
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    path.unlink(missing_ok=True)
    os.umask(0o117)
    listener = _listener(path)
    os.close(lock)
    serve(path, lock_path_of(path), listener)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
