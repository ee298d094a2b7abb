"""SerialLink: MAVLink 2 packets over a serial port or pseudo terminal that may come and go."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
from typing import Final

import serial

from firmware_py.records import RawFrame
from firmware_py.wire.mav_packet import Framer

BATCH: Final = 32
"""Packets in one call, four times what the fastest port carries in a millisecond."""

READ_BYTES: Final = 2048
"""In one call: more than 12 Mbit/s carry in a millisecond, for bytes that are no packets cost up to
0.6 us each."""

RETRY_NS: Final = 500_000_000
QUIET_NS: Final = 1_000_000_000
"""A node sends hundreds of packets a second; a port without one for so long is named in
``fault``."""

_ADVICE: Final = {
    errno.ENOENT: "no such port; plug the adapter in or correct bus.serial_port",
    errno.EACCES: "permission denied; add this user to the port's group (dialout)",
    errno.EBUSY: "busy; stop the program that has it or choose another bus.serial_port",
    errno.EAGAIN: "busy; stop the program that has it or choose another bus.serial_port",
}


class SerialLink:
    """The ``Link`` of :mod:`firmware_py.wire.link` on a serial port.

    The port is taken for this process alone.  A port that fails is closed, named in ``fault``, and
    tried again every 0.5 s.

    Parameters
    ----------
    port
        Path of the device, e.g. ``/dev/ttyUSB0``.
    baud
        Bits per second (ten to a byte); a pseudo terminal ignores it.

    Notes
    -----
    ``counters``: ``frames_in``, ``frames_out``, ``send_failed`` (the output queue was full or the
    port away), ``bytes_skipped`` (bytes outside intact packets), ``crc_failed``, ``link_lost``.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._path = port
        self._baud = baud
        self._port: serial.Serial | None = None
        self._poll = select.poll()
        self._framer = Framer()
        self._unsent = b""
        self._retry_ns = 0
        self._absent = ""
        self._now_ns = self._data_ns = self._packet_ns = -1
        self.counters = {
            "frames_in": 0,
            "frames_out": 0,
            "send_failed": 0,
            "bytes_skipped": 0,
            "crc_failed": 0,
            "link_lost": 0,
        }
        self._open()

    @property
    def up(self) -> bool:
        """False while the port is away."""
        return self._port is not None

    @property
    def fault(self) -> str:
        """Why the port is away, or what is wrong with what comes; empty while packets come."""
        if self._absent or self._now_ns - self._packet_ns < QUIET_NS:
            return self._absent
        if self._now_ns - self._data_ns < QUIET_NS:
            return (
                f"serial port {self._path}: bytes but no whole packet; set bus.serial_baud = "
                f"{self._baud} at both "
                "ends, and check the cable"
            )
        return (
            f"serial port {self._path}: no data; check that the node is powered, connected and "
            "sends"
        )

    def fileno(self) -> int:
        """Descriptor that polls readable with bytes, -1 while the port is away."""
        return self._port.fd if self._port else -1

    def receive(self, now_ns: int) -> list[RawFrame]:
        """Every whole packet waiting, at most 32, stamped ``now_ns``; never blocks or raises."""
        if self._port is None and now_ns >= self._retry_ns:
            self._retry_ns = now_ns + RETRY_NS
            self._open()
        data = self._read()
        packets = self._framer.feed(data, BATCH)
        self._flush()
        self._now_ns = now_ns
        if data or self._data_ns < 0 or not self.up:
            self._data_ns = now_ns
        if packets or self._packet_ns < 0 or not self.up:
            self._packet_ns = now_ns
        self.counters["frames_in"] += len(packets)
        self.counters["bytes_skipped"] = self._framer.skipped_bytes
        self.counters["crc_failed"] = self._framer.crc_failed
        return [RawFrame(now_ns, message_id, packet) for message_id, packet in packets]

    def send(self, frame: RawFrame) -> bool:
        """True when the packet was taken whole; a refused one is counted in ``send_failed``.

        Of a packet that fits the kernel's queue only in part, the rest goes out first next time.
        """
        self._flush()
        written = 0 if self._unsent else self._write(frame.data)
        if not written:
            self.counters["send_failed"] += 1
            return False
        self._unsent = frame.data[written:]
        self.counters["frames_out"] += 1
        return True

    def close(self) -> None:
        """Give the port back."""
        if self._port is not None:
            self._poll.unregister(self._port.fd)
            self._port.close()
            self._port = None
            self._framer.reset()

    def _open(self) -> None:
        try:
            port = serial.Serial(self._path, self._baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            self._absent = f"serial port {self._path}: {_advice(error)}"
            return
        # USB adapters hold input back for 16 ms unless told; a port without the setting says
        # ValueError.
        with contextlib.suppress(ValueError):
            port.set_low_latency_mode(True)
        self._port = port
        self._unsent = b""
        self._poll.register(port.fd, select.POLLIN)
        self._absent = ""

    def _read(self) -> bytes:
        """Bytes that wait, unless a call's worth of packets waits already."""
        if (
            self._port is None
            or self._framer.waiting_bytes >= READ_BYTES
            or not (events := self._poll.poll(0))
        ):
            return b""
        chunk = self._read_chunk(self._port.fd) if events[0][1] & select.POLLIN else b""
        if not chunk:
            self._drop("unplugged")
        return chunk

    def _read_chunk(self, fd: int) -> bytes:
        try:
            return os.read(fd, READ_BYTES)
        except OSError:
            return b""

    def _flush(self) -> None:
        """Push out the rest of a packet that the kernel took in part."""
        if self._unsent:
            self._unsent = self._unsent[self._write(self._unsent) :]

    def _write(self, data: bytes) -> int:
        """How many bytes the kernel took."""
        if self._port is None:
            return 0
        try:
            return os.write(self._port.fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            self._drop(error.strerror or str(error))
            return 0

    def _drop(self, cause: str) -> None:
        self.close()
        self._absent = f"serial port {self._path}: {cause}; plug the adapter in again"
        self.counters["link_lost"] += 1


def _advice(error: Exception) -> str:
    """Cause and next step of a port that does not open."""
    known = _ADVICE.get(getattr(error, "errno", None) or 0)
    return known or f"{error}; check bus.serial_port and bus.serial_baud"
