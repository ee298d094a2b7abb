"""How a bus finds the hub of its channel, and starts it when it is the first."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from firmware_py.wire import hub
from firmware_py.wire.folders import foreign_server, unsafe
from firmware_py.wire.python_can import can

DIRECTORY_VARIABLE: Final = "ORBITD_BUS_DIR"
WELCOME_WAIT_S: Final = 0.05
"""A hub that runs answers at once; only one that hangs takes longer."""


def bus_directory(given: str | Path | None) -> Path:
    """The directory of the hubs' sockets, made when it is not there."""
    chosen = given or os.environ.get(DIRECTORY_VARIABLE)
    directory = Path(chosen or f"/tmp/orbitd-{os.geteuid()}/bus")
    try:
        directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        cause = f"{directory}: {error.strerror}; set {DIRECTORY_VARIABLE} to a folder of yours"
        raise can.CanInitializationError(cause) from error
    if reason := unsafe(directory):
        raise can.CanInitializationError(f"{reason}; set {DIRECTORY_VARIABLE} to a folder of yours")
    return directory


def connect(path: Path, timeout_s: float) -> socket.socket:
    """A connection that the hub at ``path`` has welcomed; the hub is started when it does not
    run."""
    deadline = time.monotonic() + timeout_s
    while True:
        try:
            connection = _try_connect(path)
        except OSError as error:
            raise can.CanInitializationError(
                f"{path}: {error.strerror or error}", error.errno
            ) from error
        if connection:
            return connection
        if time.monotonic() >= deadline:
            raise can.CanInitializationError(
                f"no hub at {path} after {timeout_s:g} s", errno.ENOTCONN
            )
        time.sleep(0.005)


def _try_connect(path: Path) -> socket.socket | None:
    """A connection to a running hub; else starts one, unless somebody is at it, and returns
    None."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    dialled = _dial(connection, path)
    if dialled and (reason := foreign_server(connection, path)):
        connection.close()
        raise PermissionError(errno.EPERM, reason)
    if dialled and _welcomed(connection):
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, hub.SOCKET_BUFFER_BYTES)
        return connection
    connection.close()
    return None


def _dial(connection: socket.socket, path: Path) -> bool:
    """True when connected; False when a hub is only starting, be it by us."""
    with hub.lock_path_of(path).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            connection.connect(str(path))
        except BlockingIOError:
            return False
        except (FileNotFoundError, ConnectionRefusedError):
            _start_hub(path, lock.fileno())
            return False
    return True


def _welcomed(connection: socket.socket) -> bool:
    """True when the hub has taken the connection: from then on it hears every frame."""
    connection.settimeout(WELCOME_WAIT_S)
    try:
        return bool(connection.recv(hub.MAX_PACKET))
    except (TimeoutError, ConnectionError):
        return False


def _start_hub(path: Path, lock: int) -> None:
    """Start the hub detached; it inherits the lock and frees it once it listens.

    The shell makes it a child of init, so that whoever came first need not wait for its end.
    """
    command = [sys.executable, "-IS", hub.__file__, str(path), str(lock)]
    subprocess.run(
        ["/bin/sh", "-c", '"$@" &', "sh", *command],
        pass_fds=[lock],
        start_new_session=True,
        check=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
