"""python-can interface ``orbitd_hub``: a CAN FD bus between processes of one machine, without root.

    can.Bus(interface="orbitd_hub", channel="orbitd0", fd=True)

The first bus of a channel starts the hub (:mod:`firmware_py.wire.hub`).  The hub's death looks like
an unplugged adapter: ``recv`` and ``send`` raise :class:`can.CanOperationError`.
"""

from __future__ import annotations

import errno
import re
import select
from pathlib import Path
from typing import Any

from firmware_py.wire.hub import (
    BIT_RATE_SWITCH,
    ERROR_FRAME,
    ERROR_STATE,
    EXTENDED,
    FD,
    HEADER,
    MAX_PACKET,
    OWN,
    REMOTE,
)
from firmware_py.wire.hub_connect import bus_directory, connect
from firmware_py.wire.python_can import can


class OrbitdHubBus(can.BusABC):
    """One node on the hub's bus.

    Parameters
    ----------
    channel
        Name of the bus: letters, digits, ``_ . -``, at most 80.
    can_filters, receive_own_messages
        As everywhere in python-can.
    directory
        Where the hubs' sockets lie; default ``$ORBITD_BUS_DIR``, else ``/tmp/orbitd-<uid>/bus``.
    timeout_s
        How long to wait for a hub that is only starting; 0 tries once.

    Attributes
    ----------
    lost : int
        Frames that the hub could not keep for this node, as of the last one received.

    Raises
    ------
    can.CanInitializationError
        The channel's name is not usable, the directory belongs to someone else, or no hub came up.
    """

    def __init__(
        self,
        channel: str = "orbitd0",
        can_filters: Any = None,
        *,
        receive_own_messages: bool = False,
        directory: str | Path | None = None,
        timeout_s: float = 5.0,
        fd: bool = True,
        **kwargs: object,
    ) -> None:
        if not re.fullmatch(r"[\w.-]{1,80}", channel, re.ASCII):
            raise can.CanInitializationError(
                f"channel {channel!r}: use 1 to 80 of letters, digits, _ . -"
            )
        self._own = OWN if receive_own_messages else 0
        self._socket = connect(bus_directory(directory) / f"{channel}.sock", timeout_s)
        self._buffer = bytearray(MAX_PACKET)
        self._view = memoryview(self._buffer)
        self.lost = 0
        self.channel_info = f"orbitd_hub {channel}"
        self._can_protocol = can.CanProtocol.CAN_FD
        super().__init__(channel, can_filters, **kwargs)

    def fileno(self) -> int:
        """Descriptor for select and epoll; -1 after :meth:`shutdown`."""
        return self._socket.fileno()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Give ``msg`` to the hub; never blocks, whatever ``timeout`` says.

        Raises
        ------
        can.CanOperationError
            The hub is behind (``EAGAIN``) or has gone.
        ValueError
            The message is not a valid CAN or CAN FD frame.
        """
        msg._check()
        header = HEADER.pack(0, msg.arbitration_id, 0, _flags(msg) | self._own, len(msg.data))
        try:
            self._socket.send(header + msg.data)
        except BlockingIOError as error:
            raise can.CanOperationError(
                "the hub is behind: frame not sent", errno.EAGAIN
            ) from error
        except OSError as error:
            raise can.CanOperationError(f"hub lost: {error.strerror}", error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        size = self._read()
        if size < 0 and timeout != 0:
            select.select([self._socket], [], [], timeout)
            size = self._read()
        return (self._message(size) if size >= 0 else None), False

    def _read(self) -> int:
        """Bytes of the packet now in the buffer, -1 when none waits."""
        try:
            size = self._socket.recv_into(self._buffer)
        except BlockingIOError:
            return -1
        except OSError as error:
            raise can.CanOperationError(f"hub lost: {error.strerror}", error.errno) from error
        if size < HEADER.size:
            raise can.CanOperationError("hub lost: it closed the connection", errno.ECONNRESET)
        return size

    def _message(self, size: int) -> can.Message:
        timestamp_ns, arbitration_id, self.lost, flags, length = HEADER.unpack_from(self._buffer)
        return can.Message(
            timestamp=timestamp_ns * 1e-9,
            arbitration_id=arbitration_id,
            is_extended_id=bool(flags & EXTENDED),
            is_fd=bool(flags & FD),
            bitrate_switch=bool(flags & BIT_RATE_SWITCH),
            error_state_indicator=bool(flags & ERROR_STATE),
            is_error_frame=bool(flags & ERROR_FRAME),
            is_remote_frame=bool(flags & REMOTE),
            is_rx=not flags & OWN,
            dlc=length,
            data=self._buffer[HEADER.size : size],
        )

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._socket.close()


def _flags(msg: can.Message) -> int:
    return (
        msg.is_extended_id * EXTENDED
        | msg.is_fd * FD
        | msg.bitrate_switch * BIT_RATE_SWITCH
        | msg.error_state_indicator * ERROR_STATE
        | msg.is_error_frame * ERROR_FRAME
        | msg.is_remote_frame * REMOTE
    )
