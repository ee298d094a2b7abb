"""``sd_notify`` on a socket: readiness, watchdog and status for systemd, never blocking.

Protocol: sd_notify(3). Without an address every call does nothing, so the loops call it
unconditionally.
"""

from __future__ import annotations

import os
import socket


class Notifier:
    """Sends state lines to the service manager.

    Parameters
    ----------
    address
        Value of ``NOTIFY_SOCKET`` (a path, or ``@name`` for an abstract socket); None or empty:
        silent.
    """

    def __init__(self, address: str | None) -> None:
        self.lost = 0
        self._socket: socket.socket | None = None
        if address:
            name = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
            self._address = name

    def ready(self) -> None:
        """The process works and may be depended on."""
        self._send("READY=1")

    def watchdog(self) -> None:
        """One more good cycle."""
        self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """One line for ``systemctl status``."""
        self._send(f"STATUS={text}")

    def stopping(self) -> None:
        """A clean stop has begun."""
        self._send("STOPPING=1")

    def _send(self, line: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(line.encode(), self._address)
        except OSError:
            self.lost += 1


def from_environment() -> Notifier:
    """The notifier that the service manager asked for; read once, by a process's ``main``."""
    return Notifier(os.environ.get("NOTIFY_SOCKET"))
