"""The actuator node's duties, as ``deploy/NODE.md`` states them, on decoded messages and the node's
own ticks.

A tick is the node's clock in microseconds, here without wrapping; only the echo of a command is
compared modulo 2^32.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_py.records import Command, DeviceHeartbeat, NodeMode, NodeState, Rejected, WireMessage
from sim_hil.hil.follower import COUNTERS, TICKS, Follower

_CHECK_REASONS: Final = ("length", "crc")


@dataclass(frozen=True)
class NodeLimits:
    """What the node was built with; boot values are the retreat values."""

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
        self.follower: Follower[Command] = Follower(limits.time_to_live_ms, self._in_range)

    @property
    def session(self) -> int:
        """Session that is followed; 0: none yet."""
        return self.follower.session

    @property
    def refused(self) -> dict[str, int]:
        """Refused commands by rule."""
        return self.follower.refused

    def receive(self, messages: list[WireMessage | Rejected], tick_us: int) -> None:
        """Everything that waits, at once; only the newest intact command is judged."""
        newest: Command | None = None
        for message in messages:
            if isinstance(message, Rejected):
                self.refused["check"] += message.reason in _CHECK_REASONS
            elif isinstance(message, Command):
                newest = message
            elif isinstance(message, DeviceHeartbeat):
                self.follower.hear(message.session, tick_us)
        if newest is not None and self.follower.judge(newest, tick_us):
            self.clearance_um, self.pressure_bar = newest.clearance_um, newest.pressure_bar
            self.mode = NodeMode.FOLLOWING

    def expire(self, tick_us: int) -> None:
        """Fall back to the boot values when no command was obeyed for the time to live."""
        if self.follower.expired(tick_us):
            self.mode = NodeMode.SAFE
            self.clearance_um = self.limits.boot_clearance_um
            self.pressure_bar = self.limits.boot_pressure_bar

    def state(self, counter: int, tick_us: int, at_target: bool) -> NodeState:
        """The node's own account."""
        return NodeState(
            counter=counter, tick_us=tick_us % TICKS, mode=int(self.mode), session=self.session,
            command_counter=self.follower.counter, target_clearance_um=self.clearance_um,
            target_pressure_bar=self.pressure_bar, at_target=at_target,
            **{f"refused_{reason}": count % COUNTERS for reason, count in self.refused.items()},
        )  # fmt: skip

    def _in_range(self, command: Command) -> bool:
        """Whether both targets lie in the actuator's own range."""
        limits = self.limits
        return (
            limits.clearance_um[0] <= command.clearance_um <= limits.clearance_um[1]
            and limits.pressure_bar[0] <= command.pressure_bar <= limits.pressure_bar[1]
        )
