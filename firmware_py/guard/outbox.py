"""Events stay here until the gate says that it has stored them."""

from __future__ import annotations

from collections import deque
from typing import Final

from firmware_py.records import Event

CAPACITY: Final = 1000


class Outbox:
    """Unacknowledged events, oldest first; when full the oldest is lost, counted in ``dropped``."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._waiting: deque[Event] = deque(maxlen=capacity)
        self.dropped = 0

    def put(self, event: Event) -> None:
        """Keep ``event`` until it is acknowledged."""
        self.dropped += len(self._waiting) == self._waiting.maxlen
        self._waiting.append(event)

    def acknowledge(self, seq: int) -> None:
        """The gate has every event up to and including ``seq``."""
        while self._waiting and self._waiting[0].seq <= seq:
            self._waiting.popleft()

    def waiting(self) -> list[Event]:
        """What a gate that has just come must be told again."""
        return list(self._waiting)
