"""What the guard says on the wire: heartbeat and command, on time, each with its own counter."""

from __future__ import annotations

from typing import Final, Protocol

import msgspec

from firmware_py.config import Config
from firmware_py.guard.envelope.target import Target
from firmware_py.records import Command, DeviceHeartbeat, RawFrame, Rejected, WireMessage

HEARTBEAT_PERIOD_NS: Final = 50_000_000
HURRY_GAP_NS: Final = 5_000_000
"""A request may bring a message forward to so long after the one before: requests must not fill the
bus."""


class GuardCodec(Protocol):
    """Both halves of a link's codec."""

    def decode(self, frame: RawFrame) -> WireMessage | Rejected:
        """The record in ``frame``."""

    def encode(self, message: WireMessage, now_ns: int = 0) -> RawFrame:
        """The frame that carries ``message``."""


class SpeakerState(msgspec.Struct):
    """Counters of the two messages, and when each is due next."""

    heartbeat_counter: int = 0
    command_counter: int = 0
    heartbeat_due_ns: int = 0
    command_due_ns: int = 0
    heartbeat_sent_ns: int = 0
    command_sent_ns: int = 0


class Speaker:
    """Encodes heartbeats every 50 ms and commands every ``actuator.command_period_ms``.

    Parameters
    ----------
    config
        Command period.
    codec
        Encoder of the configured link.
    session
        Nonce of this run of the device.
    """

    def __init__(self, config: Config, codec: GuardCodec, session: int) -> None:
        self._codec = codec
        self._session = session
        self._command_period_ns = config.machine.actuator.command_period_ms * 1_000_000
        self.state = SpeakerState()

    def hurry(self, *, urgent: bool) -> None:
        """Something has changed: say everything now when ``urgent``, else as soon as requests
        may."""
        s, gap_ns = self.state, 0 if urgent else HURRY_GAP_NS
        s.heartbeat_due_ns = min(s.heartbeat_due_ns, s.heartbeat_sent_ns + gap_ns)
        s.command_due_ns = min(s.command_due_ns, s.command_sent_ns + gap_ns)

    def heartbeat(
        self, now_ns: int, mode: int, arm_state: int, run_permit: bool, trip_request: bool
    ) -> list[RawFrame]:
        """The heartbeat, when it is due."""
        s = self.state
        if now_ns < s.heartbeat_due_ns:
            return []
        s.heartbeat_sent_ns = now_ns
        s.heartbeat_due_ns = _next(s.heartbeat_due_ns, HEARTBEAT_PERIOD_NS, now_ns)
        s.heartbeat_counter = (s.heartbeat_counter + 1) & 0xFFFF
        message = DeviceHeartbeat(
            s.heartbeat_counter, self._session, mode, arm_state, run_permit, trip_request
        )
        return [self._codec.encode(message, now_ns)]

    def command_due(self, now_ns: int) -> bool:
        """Whether :meth:`command` would speak."""
        return now_ns >= self.state.command_due_ns

    def command(self, now_ns: int, target: Target, echo_tick_us: int) -> list[RawFrame]:
        """The command, when it is due."""
        s = self.state
        if not self.command_due(now_ns):
            return []
        s.command_sent_ns = now_ns
        s.command_due_ns = _next(s.command_due_ns, self._command_period_ns, now_ns)
        s.command_counter = (s.command_counter + 1) & 0xFFFF
        message = Command(
            s.command_counter, self._session, echo_tick_us, target.clearance_um, target.pressure_bar
        )
        return [self._codec.encode(message, now_ns)]


def _next(due_ns: int, period_ns: int, now_ns: int) -> int:
    """The next point of the grid; a new grid when this one was missed."""
    following = due_ns + period_ns
    return following if following > now_ns else now_ns + period_ns
