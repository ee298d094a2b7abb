"""A listening Unix socket that says by a lock who owns it, and comes back when a cleaner removes
it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
from collections import Counter
from pathlib import Path
from typing import Final

from firmware_py.wire.peer_socket import MAX_WAITING, PeerBusyError, PeerError

INSTANCE_MODE: Final = 0o750
"""The group may come in and connect, not put sockets there."""

SOCKET_MODE: Final = 0o660
SOCKET_PATH_BYTES: Final = 107
LOOK_EVERY_NS: Final = 1_000_000_000
"""How often a server looks whether its socket still lies where clients look for it."""

TOUCH_EVERY_NS: Final = 3_600_000_000_000
"""Cleaners of /tmp go by age; a socket is never written to, so its age is renewed by hand."""


class Listener:
    """Listens at ``path`` as long as it lives; ``<path>.lock`` beside it says who owns it.

    Raises
    ------
    PeerBusyError
        Another process serves ``path``.
    PeerError
        The path is too long or cannot be bound.

    Notes
    -----
    Counts in ``counters``: ``listened_again`` and ``listen_failed`` after the socket was removed.
    """

    def __init__(self, path: Path, counters: Counter[str]) -> None:
        self._path = path
        self._counters = counters
        self._lock = own(path)
        self._look_ns = self._touch_ns = 0
        try:
            self._socket = listen(path)
        except PeerError:
            os.close(self._lock)
            raise
        self._inode = _inode(path)

    def fileno(self) -> int:
        """Readable when somebody waits for :meth:`accept`; another one after :meth:`look` said
        so."""
        return self._socket.fileno()

    def accept(self) -> socket.socket | None:
        """The next connection that waits, None when there is none."""
        try:
            return self._socket.accept()[0]
        except OSError:
            return None

    def look(self, now_ns: int) -> bool:
        """Once a second: listen again when somebody removed or replaced socket, lock or folder.

        Returns
        -------
        Whether the socket is another one now; connections that were accepted stay.
        """
        if now_ns < self._look_ns:
            return False
        self._look_ns = now_ns + LOOK_EVERY_NS
        path = self._path
        if held(lock_of(path), self._lock) and _inode(path) == self._inode:
            if now_ns >= self._touch_ns:
                self._touch_ns = now_ns + TOUCH_EVERY_NS
                with contextlib.suppress(OSError):
                    os.utime(path)
                    os.utime(lock_of(path))
            return False
        try:
            path.parent.mkdir(mode=INSTANCE_MODE, exist_ok=True)
            lock = self._lock if held(lock_of(path), self._lock) else own(path)
            listening = listen(path)
        except (OSError, PeerError):
            self._counters["listen_failed"] += 1
            return False
        if lock != self._lock:
            os.close(self._lock)
        self._socket.close()
        self._lock, self._socket, self._inode = lock, listening, _inode(path)
        self._counters["listened_again"] += 1
        return True

    def close(self) -> None:
        """Stop listening and remove the path, if it is still this one's."""
        self._socket.close()
        if _inode(self._path) == self._inode:
            self._path.unlink(missing_ok=True)
        os.close(self._lock)


def held(path: Path, descriptor: int) -> bool:
    """Whether ``path`` still names the file behind ``descriptor``: nobody removed or replaced
    it."""
    try:
        there, ours = path.lstat(), os.fstat(descriptor)
    except OSError:
        return False
    return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)


def lock_of(path: Path) -> Path:
    """The lock file that says who owns the socket ``path``."""
    return path.with_name(path.name + ".lock")


def own(path: Path) -> int:
    """File descriptor of the lock that says this process owns ``path``; the kernel frees it at
    death."""
    lock_path = lock_of(path)
    try:
        lock = os.open(lock_path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, SOCKET_MODE)
    except OSError as error:
        raise PeerError(
            f"{lock_path}: {error.strerror}; give a runtime directory that this user may write"
        ) from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(lock)
        raise PeerBusyError(
            f"{path}: served by another process; stop it or choose another instance"
        ) from error
    return lock


def listen(path: Path) -> socket.socket:
    """Listening socket at ``path``; the caller owns the lock, so a path found there is left
    over."""
    if len(os.fsencode(path)) > SOCKET_PATH_BYTES:
        raise PeerError(
            f"{path}: longer than the {SOCKET_PATH_BYTES} bytes of a Unix socket path; "
            "choose a shorter runtime directory or instance name"
        )
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        path.unlink(missing_ok=True)
        listener.bind(str(path))
        path.chmod(SOCKET_MODE)
    except OSError as error:
        listener.close()
        raise PeerError(f"{path}: {error.strerror}; check the runtime directory") from error
    listener.listen(MAX_WAITING)
    listener.setblocking(False)
    return listener


def _inode(path: Path) -> tuple[int, int] | None:
    """What ``path`` names, None when nothing."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_dev, found.st_ino
