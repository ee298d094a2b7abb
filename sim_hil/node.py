"""The actuator node's duties, as ``deploy/NODE.md`` states them, on decoded messages and the node's
own ticks.

A tick is the node's clock in microseconds, here without wrapping; only the echo of a command is
compared modulo 2^32.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_py.records import Command, DeviceHeartbeat, NodeMode, NodeState, Rejected, WireMessage

SESSION_ALIVE_US: Final = 1_000_000
_TICKS: Final = 1 << 32
_COUNTERS: Final = 1 << 16
_CHECK_REASONS: Final = ("length", "crc")


@dataclass(frozen=True)
class NodeLimits:
    """What the node was built with; boot values are the safe values."""

    boot_clearance_um: float
    boot_pressure_bar: float
    clearance_um: tuple[float, float]
    pressure_bar: tuple[float, float]
    time_to_live_ms: int
    rate_um_s: float


class Node:
    """Who is followed, where the targets are, and what was refused."""

    def __init__(self, limits: NodeLimits) -> None:
        self.limits = limits
        self.clearance_um = limits.boot_clearance_um
        self.pressure_bar = limits.boot_pressure_bar
        self.mode = NodeMode.SAFE
        self.session = 0
        self.counter = 0
        self.refused = {"stale": 0, "check": 0, "session": 0, "range": 0}
        self._heard_us: int | None = None
        self._obeyed_us: int | None = None

    def receive(self, messages: list[WireMessage | Rejected], tick_us: int) -> None:
        """Everything that waits, at once; only the newest intact command is judged."""
        newest: Command | None = None
        for message in messages:
            if isinstance(message, Rejected):
                self.refused["check"] += message.reason in _CHECK_REASONS
            elif isinstance(message, Command):
                newest = message
            elif isinstance(message, DeviceHeartbeat) and message.session == self.session:
                self._heard_us = tick_us
        if newest is not None:
            reason = self._refusal(newest, tick_us)
            if reason is None:
                self._obey(newest, tick_us)
            else:
                self.refused[reason] += 1

    def expire(self, tick_us: int) -> None:
        """Fall back to the boot values when no command was obeyed for the time to live."""
        if (
            self._obeyed_us is None
            or tick_us - self._obeyed_us > self.limits.time_to_live_ms * 1000
        ):
            self.mode = NodeMode.SAFE
            self.clearance_um = self.limits.boot_clearance_um
            self.pressure_bar = self.limits.boot_pressure_bar

    def state(self, counter: int, tick_us: int, at_target: bool) -> NodeState:
        """The node's own account."""
        return NodeState(
            counter=counter, tick_us=tick_us % _TICKS, mode=int(self.mode), session=self.session,
            command_counter=self.counter, target_clearance_um=self.clearance_um,
            target_pressure_bar=self.pressure_bar, at_target=at_target,
            **{f"refused_{reason}": count % _COUNTERS for reason, count in self.refused.items()},
        )  # fmt: skip

    def _refusal(self, command: Command, tick_us: int) -> str | None:
        """Name of the first rule that ``command`` breaks."""
        limits = self.limits
        alive = self._heard_us is not None and tick_us - self._heard_us <= SESSION_ALIVE_US
        if command.session != self.session and alive:
            return "session"
        same = command.session == self.session and self._obeyed_us is not None
        if same and not 1 <= (command.counter - self.counter) % _COUNTERS < _COUNTERS // 2:
            return "check"
        if (tick_us - command.echo_tick_us) % _TICKS > limits.time_to_live_ms * 1000:
            return "stale"
        if not (
            limits.clearance_um[0] <= command.clearance_um <= limits.clearance_um[1]
            and limits.pressure_bar[0] <= command.pressure_bar <= limits.pressure_bar[1]
        ):
            return "range"
        return None

    def _obey(self, command: Command, tick_us: int) -> None:
        self.session, self.counter = command.session, command.counter
        self.clearance_um, self.pressure_bar = command.clearance_um, command.pressure_bar
        self.mode = NodeMode.FOLLOWING
        self._heard_us = self._obeyed_us = tick_us
