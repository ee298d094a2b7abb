"""Whom a node follows: the rules of ``deploy/NODE.md``, 5, for commands of any kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from firmware_py.records import Command, DriveCommand

SESSION_ALIVE_US = 1_000_000
TICKS = 1 << 32
COUNTERS = 1 << 16

C = TypeVar("C", Command, DriveCommand)


class Follower(Generic[C]):
    """Session, counter and refusals of one kind of command.

    Parameters
    ----------
    time_to_live_ms
        Age from which a command is refused, and silence after which it has expired.
    in_range
        Whether the actuator can do what a command asks.
    """

    def __init__(self, time_to_live_ms: int, in_range: Callable[[C], bool]) -> None:
        self.session = 0
        self.counter = 0
        self.refused = {"stale": 0, "check": 0, "session": 0, "range": 0}
        self._limit_us = time_to_live_ms * 1000
        self._in_range: Callable[[C], bool] = in_range
        self._heard_us: int | None = None
        self._executed_us: int | None = None

    def hear(self, session: int, tick_us: int) -> None:
        """An intact heartbeat."""
        if session == self.session:
            self._heard_us = tick_us

    def judge(self, command: C, tick_us: int) -> bool:
        """Whether the newest intact command is to be executed; a refused one is counted."""
        reason = self._refusal(command, tick_us)
        if reason is not None:
            self.refused[reason] += 1
            return False
        self.session, self.counter = command.session, command.counter
        self._heard_us = self._executed_us = tick_us
        return True

    def expired(self, tick_us: int) -> bool:
        """Whether no command was executed for the time to live."""
        return self._executed_us is None or tick_us - self._executed_us > self._limit_us

    def _refusal(self, command: C, tick_us: int) -> str | None:
        """Name of the first rule that ``command`` breaks."""
        alive = self._heard_us is not None and tick_us - self._heard_us <= SESSION_ALIVE_US
        if command.session != self.session and alive:
            return "session"
        same = command.session == self.session and self._executed_us is not None
        if same and not 1 <= (command.counter - self.counter) % COUNTERS < COUNTERS // 2:
            return "check"
        if (tick_us - command.echo_tick_us) % TICKS > self._limit_us:
            return "stale"
        return None if self._in_range(command) else "range"
