"""CanLink: a CAN FD bus that may come and go, through python-can (Unix hub or SocketCAN)."""

from __future__ import annotations

import errno
import logging
import os
import socket
import time
from collections.abc import Callable
from typing import Final

from firmware_py.records import RawFrame
from firmware_py.wire.arrival import ArrivalStamps
from firmware_py.wire.can_health import CanHealth
from firmware_py.wire.hub_bus import OrbitdHubBus
from firmware_py.wire.python_can import can

BATCH: Final = 32
"""Frames in one call, four times what the bus can carry in a millisecond; the rest waits in the
kernel."""

RETRY_NS: Final = 500_000_000
START_WAIT_S: Final = 5.0
RECEIVE_BUFFER_BYTES: Final = 4 << 20
EXTENDED_ID: Final = 1 << 31
"""Set in ``RawFrame.frame_id`` of a 29-bit identifier, so that it never passes for an 11-bit
one."""

_ADVICE: Final = {
    errno.ENODEV: "plug the adapter in or correct bus.channel",
    errno.ENETDOWN: "bring the interface up: ip link set CHANNEL up",
    errno.EAFNOSUPPORT: "load the kernel modules can and can_raw, or set bus.interface = "
    '"orbitd_hub"',
}

OpenBus = Callable[[float], can.BusABC]
"""Opens a bus; is told how many seconds it may wait; raises ``can.CanError`` or ``OSError``."""


def bus_opener(interface: str, channel: str) -> OpenBus:
    """How to open ``channel`` of ``interface`` (``orbitd_hub`` or ``socketcan``)."""
    if interface == "socketcan":
        return lambda wait_s: _open_socketcan(channel)
    return lambda wait_s: OrbitdHubBus(channel, timeout_s=wait_s)


def _open_socketcan(channel: str) -> can.BusABC:
    logging.getLogger("can.interfaces.socketcan").setLevel(
        logging.CRITICAL
    )  # ``fault`` says it once
    bus = can.Bus(channel, interface="socketcan", fd=True, ignore_config=True)
    with socket.socket(fileno=os.dup(bus.fileno())) as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    return bus


class CanLink:
    """The ``Link`` of :mod:`firmware_py.wire.link` on a CAN bus.

    Frames are stamped with the time at which the kernel (or the hub) took them, on the clock of
    ``now_ns``, or with the moment of reading where that cannot be believed
    (:mod:`firmware_py.wire.arrival`; counted in ``stamps_refused``).  A bus that fails is closed,
    named in ``fault``, and tried again every 0.5 s.
    """

    def __init__(self, open_bus: OpenBus) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = None
        self._retry_ns = 0
        self._hub_lost = 0
        self._stamps = ArrivalStamps()
        self._absent = ""
        self._now_ns = 0
        self.counters = {
            "frames_in": 0,
            "frames_out": 0,
            "send_failed": 0,
            "error_frames": 0,
            "queue_overflow": 0,
            "link_lost": 0,
            "stamps_refused": 0,
        }
        self.health = CanHealth(self.counters)
        self._open(START_WAIT_S)

    @property
    def up(self) -> bool:
        """False while the bus is away, and while the controller takes no part in it (bus-off)."""
        return self._bus is not None and not self.health.bus_off

    @property
    def fault(self) -> str:
        """Why the bus is away, or what is wrong with it; empty while it is well."""
        return self._absent or self.health.text

    def fileno(self) -> int:
        """Descriptor that polls readable with a frame, -1 while the bus is away."""
        return self._bus.fileno() if self._bus else -1

    def receive(self, now_ns: int) -> list[RawFrame]:
        """Everything waiting, at most 32 frames; never blocks, never raises for a lost bus."""
        frames: list[RawFrame] = []
        was_up = self._bus is not None
        self._now_ns = now_ns
        self.health.step(now_ns)
        bus = self._bus or self._reopen(now_ns)
        if bus is not None:
            try:
                self._drain(bus, now_ns, frames)
            except can.CanError as error:
                self.close()
                self._absent = _explain(error, error.error_code)
                self.counters["link_lost"] += was_up
        if frames:
            self.health.frame()
        self.counters["frames_in"] += len(frames)
        return frames

    def _drain(self, bus: can.BusABC, now_ns: int, frames: list[RawFrame]) -> None:
        """Append what waits."""
        stamps = self._stamps
        stamps.read(now_ns, time.time_ns())
        for _ in range(BATCH):
            message = bus.recv(0)
            if message is None:
                stamps.emptied()
                break
            if message.is_error_frame or message.is_remote_frame:
                self.counters["error_frames"] += 1
                if message.is_error_frame:
                    self.health.error_frame(message.arbitration_id, bytes(message.data), now_ns)
                continue
            frame_id = message.arbitration_id | (EXTENDED_ID if message.is_extended_id else 0)
            frames.append(
                RawFrame(stamps.arrival_ns(message.timestamp), frame_id, bytes(message.data))
            )
        self.counters["stamps_refused"] = stamps.refused
        if isinstance(bus, OrbitdHubBus):
            self.counters["queue_overflow"] += (bus.lost - self._hub_lost) & 0xFFFFFFFF
            self._hub_lost = bus.lost

    def _open(self, wait_s: float) -> can.BusABC | None:
        try:
            self._bus = self._open_bus(wait_s)
        except can.CanError as error:
            self._absent = _explain(error, error.error_code)
            return None
        except OSError as error:
            self._absent = _explain(error, error.errno)
            return None
        self._absent = ""
        self._hub_lost = 0
        self.health.reset()
        self._stamps.forget()
        return self._bus

    def _reopen(self, now_ns: int) -> can.BusABC | None:
        if now_ns < self._retry_ns:
            return None
        self._retry_ns = now_ns + RETRY_NS
        return self._open(0.0)

    def send(self, frame: RawFrame) -> bool:
        """True when the bus took the frame; a refused one is counted in ``send_failed``."""
        try:
            if self._bus is None:
                raise can.CanOperationError("link down")
            self._bus.send(
                can.Message(
                    arbitration_id=frame.frame_id,
                    is_extended_id=False,
                    is_fd=True,
                    bitrate_switch=True,
                    data=frame.data,
                ),
                timeout=0,
            )
        except can.CanError as error:
            self.counters["send_failed"] += 1
            self.health.refused(error.error_code, self._now_ns)
            return False
        self.counters["frames_out"] += 1
        return True

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None


def _explain(error: Exception, code: int | None) -> str:
    """What failed and what to do about it."""
    advice = _ADVICE.get(code or 0)
    return f"{error}; {advice}" if advice else str(error)
