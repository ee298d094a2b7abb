"""A null-modem cable in software: two pseudo terminals, what goes into one comes out of the other.

``python -m firmware_py.wire.pty_cable DIRECTORY`` lays it between ``DIRECTORY/device`` and
``DIRECTORY/rig`` and holds it until it is stopped; its end looks like an unplugged adapter on both
sides. An end that nobody reads loses bytes, as a UART does.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import tty
from pathlib import Path
from types import FrameType
from typing import Final

QUEUE_BYTES: Final = 64 * 1024
"""Bytes that wait for one reader, a quarter of a second at 3 Mbaud; newer ones are lost."""

CHUNK_BYTES: Final = 4096


def ends(directory: Path) -> tuple[Path, Path]:
    """Paths of the device's and the rig's port; they exist while the cable is laid."""
    return directory / "device", directory / "rig"


class _End:
    """One pseudo terminal: the master that the cable holds, the path that a program opens."""

    def __init__(self, path: Path) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        # The slave stays open: a terminal that nobody holds would answer the master with EIO.
        self.slave = slave
        self.outgoing = b""
        self.path = path

    def show(self) -> None:
        """Put the path where programs look for the port."""
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self.slave))

    def read(self) -> bytes:
        try:
            return os.read(self.master, CHUNK_BYTES)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        """Pass on ``data``; what the terminal does not take waits, what exceeds the queue is
        lost."""
        waiting = (self.outgoing + data)[:QUEUE_BYTES]
        try:
            self.outgoing = waiting[os.write(self.master, waiting) :]
        except BlockingIOError:
            self.outgoing = waiting

    def close(self) -> None:
        self.path.unlink(missing_ok=True)
        os.close(self.slave)
        os.close(self.master)


def carry(left: _End, right: _End) -> None:
    """Copy both ways until the process is told to stop."""
    poll = select.poll()
    others = {left.master: (left, right), right.master: (right, left)}
    while True:
        for end in (left, right):
            poll.register(end.master, select.POLLIN | (select.POLLOUT if end.outgoing else 0))
        for fd, events in poll.poll():
            source, target = others[fd]
            if events & select.POLLIN:
                target.write(source.read())
            if events & select.POLLOUT:
                source.write(b"")


def _stop(number: int, frame: FrameType | None) -> None:
    raise SystemExit(0)


def main(argv: list[str]) -> int:
    """Lay the cable in the directory ``argv[0]``."""
    if len(argv) != 1 or not Path(argv[0]).is_dir():
        print(
            "usage: python -m firmware_py.wire.pty_cable DIRECTORY (an existing one)",
            file=sys.stderr,
        )
        return 2
    signal.signal(signal.SIGTERM, _stop)
    signal.signal(signal.SIGINT, _stop)
    device, rig = (_End(path) for path in ends(Path(argv[0])))
    try:  # covers the paths from the first moment: whoever sees them may stop the cable
        device.show()
        rig.show()
        carry(device, rig)
    finally:
        device.close()
        rig.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
