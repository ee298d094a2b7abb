"""An event is a change: what comes again and again is told once, with a count.

Each name may be told :data:`BURST` times in a row and then once in :data:`EVERY_NS`; what is held
back is told with the number of times that it happened.  Danger is never held back: its alarms latch
and cannot flutter.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import msgspec

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.records import Severity

BURST: Final = 3
"""A person sees that something comes back, and what it was between."""

EVERY_NS: Final = 10_000_000_000
"""A source that flutters for a minute gives nine events, whatever its rate."""

COMMANDS_BURST: Final = 20
"""Of each verb: every act of a person is told, a program in a loop is not."""

NAMES_MAX: Final = 256
"""Names that are remembered: more than there are kinds of notices."""


class EventAllowance(msgspec.Struct):
    """One name: how many tellings are free, since when, and what is held back."""

    most: int = BURST
    free: int = BURST
    since_ns: int = 0
    waiting: Notice | None = None
    count: int = 0


class EventLimit:
    """Lets notices through, or holds them back and counts them; ``state`` is by name."""

    def __init__(self) -> None:
        self.state: dict[str, EventAllowance] = {}

    def step(self, notices: Iterable[Notice], now_ns: int) -> list[tuple[Notice, int]]:
        """What is to be told now, each with how often it happened since it was last told."""
        told: list[tuple[Notice, int]] = []
        for notice in notices:
            if notice.severity == Severity.DANGER:
                told.append((notice, 1))
                continue
            known = self._known(notice, now_ns)
            known.waiting, known.count = notice, known.count + 1
        for known in self.state.values():
            gained = min(known.most - known.free, (now_ns - known.since_ns) // EVERY_NS)
            if gained > 0:
                known.free, known.since_ns = known.free + gained, known.since_ns + gained * EVERY_NS
            if known.waiting is not None and known.free > 0:
                if known.free == known.most:
                    known.since_ns = now_ns
                known.free -= 1
                told.append((known.waiting, known.count))
                known.waiting, known.count = None, 0
        return told

    def _known(self, notice: Notice, now_ns: int) -> EventAllowance:
        """Where ``notice`` stands; a command by its verb, which its text begins with."""
        command = notice.name == "command"
        place = f"command {notice.text.partition(' ')[0]}" if command else notice.name
        if place not in self.state:
            if len(self.state) >= NAMES_MAX:
                del self.state[next(iter(self.state))]
            most = COMMANDS_BURST if command else BURST
            self.state[place] = EventAllowance(most, most, now_ns)
        return self.state[place]
