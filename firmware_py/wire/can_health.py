"""What is wrong with a CAN bus that is there: from SocketCAN's error frames and from sends that
fail.

Error classes: ``linux/can/error.h``.  A condition ends by the controller's word, by a sign that it
cannot stand any more, or after :data:`HOLD_NS` without another sign of it.
"""

from __future__ import annotations

import errno
from typing import Final

HOLD_NS: Final = 2_000_000_000
"""A controller repeats its error frames many times a second while their cause lasts."""

TX_TIMEOUT, CONTROLLER, PROTOCOL, TRANSCEIVER, NO_ACK, BUS_OFF, BUS_ERROR, RESTARTED = (
    0x001,
    0x004,
    0x008,
    0x010,
    0x020,
    0x040,
    0x080,
    0x100,
)
RX_OVERFLOW, TX_OVERFLOW, WARNING, PASSIVE, ACTIVE = 0x01, 0x02, 0x0C, 0x30, 0x40

TEXTS: Final = {
    "bus_off": "the CAN controller is bus-off (too many transmit errors); check cable, termination "
    "(2 x 120 ohm) "
    "and bit rates, then: ip link set CHANNEL type can restart-ms 100",
    "error_passive": "the CAN controller is error-passive; check cable, termination, bit rates and "
    "the other nodes",
    "error_warning": "the CAN controller counts many errors (warning level); check cable and "
    "termination",
    "no_ack": "nobody on the CAN bus acknowledges; check that the node is powered, connected and "
    "at the same bit rates",
    "transceiver": "the CAN transceiver reports a fault; check cable and supply",
    "protocol_error": "CAN bus errors (bit, stuff, form or CRC); check cable, termination and bit "
    "rates",
    "tx_timeout": "the CAN controller could not send in time; check that the node is connected",
    "controller_overrun": "the CAN controller lost frames (its buffer ran over); lower the load of "
    "this machine",
    "queue_full": "the send queue of the CAN interface is full (ENOBUFS), frames leave too slowly "
    "or not at all; check "
    "cable and node, else: ip link set CHANNEL txqueuelen 1000",
}
"""Cause and next step of each condition, worst first: the order in which they are told."""

_BY_CLASS: Final = (
    (TX_TIMEOUT, "tx_timeout"),
    (PROTOCOL | BUS_ERROR, "protocol_error"),
    (TRANSCEIVER, "transceiver"),
    (NO_ACK, "no_ack"),
    (BUS_OFF, "bus_off"),
)
_QUEUE_FULL: Final = (errno.ENOBUFS, errno.EAGAIN)


class CanHealth:
    """Conditions of the bus that stand now; ``counters`` (the link's) counts their beginnings."""

    def __init__(self, counters: dict[str, int] | None = None) -> None:
        self.counters = {} if counters is None else counters
        self.counters |= dict.fromkeys(TEXTS, 0)
        self._seen_ns: dict[str, int] = {}

    @property
    def text(self) -> str:
        """The worst condition with its next step, the others by name; empty when the bus is
        well."""
        standing = [name for name in TEXTS if name in self._seen_ns]
        others = f" (also: {', '.join(standing[1:])})" if len(standing) > 1 else ""
        return TEXTS[standing[0]] + others if standing else ""

    @property
    def bus_off(self) -> bool:
        """Whether the controller takes no part in the bus."""
        return "bus_off" in self._seen_ns

    def error_frame(self, classes: int, data: bytes, now_ns: int) -> None:
        """Take in an error frame: its identifier's ``classes`` and its ``data``."""
        for bits, name in _BY_CLASS:
            if classes & bits:
                self._begin(name, now_ns)
        if classes & CONTROLLER and len(data) > 1:
            self._controller(data[1], now_ns)
        if classes & RESTARTED:
            self._seen_ns.clear()

    def frame(self) -> None:
        """A good frame came: the controller takes part."""
        self._seen_ns.pop("bus_off", None)

    def refused(self, code: int | None, now_ns: int) -> None:
        """The interface did not take a frame."""
        if code in _QUEUE_FULL:
            self._begin("queue_full", now_ns)

    def step(self, now_ns: int) -> None:
        """Forget what has not been seen for long; bus-off ends by a sign alone."""
        over = [
            name
            for name, seen_ns in self._seen_ns.items()
            if name != "bus_off" and now_ns - seen_ns > HOLD_NS
        ]
        for name in over:
            del self._seen_ns[name]

    def reset(self) -> None:
        """The bus was opened anew."""
        self._seen_ns.clear()

    def _controller(self, status: int, now_ns: int) -> None:
        if status & (RX_OVERFLOW | TX_OVERFLOW):
            self._begin("controller_overrun", now_ns)
        if status & PASSIVE:
            self._begin("error_passive", now_ns)
        elif status & WARNING:
            self._begin("error_warning", now_ns)
            self._seen_ns.pop("error_passive", None)
        if status & ACTIVE:
            for name in ("error_passive", "error_warning", "bus_off"):
                self._seen_ns.pop(name, None)

    def _begin(self, name: str, now_ns: int) -> None:
        self.counters[name] += name not in self._seen_ns
        self._seen_ns[name] = now_ns
