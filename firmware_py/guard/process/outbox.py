"""Events stay here until the gate says that it has stored them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import Final

from firmware_py.records import Event

CAPACITY: Final = 1000


class Outbox:
    """Unacknowledged events, oldest first; when full the oldest is lost, counted in ``dropped``.

    They leave in their order, each only after those before it: an acknowledgement covers all up to
    its number.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._waiting: deque[Event] = deque(maxlen=capacity)
        self._sent = 0
        self.dropped = 0

    def put(self, event: Event) -> None:
        """Keep ``event`` until it is acknowledged."""
        if len(self._waiting) == self._waiting.maxlen:
            self.dropped += 1
            self._sent = max(0, self._sent - 1)
        self._waiting.append(event)

    def acknowledge(self, seq: int) -> None:
        """The gate has every event up to and including ``seq``."""
        while self._waiting and self._waiting[0].seq <= seq:
            self._waiting.popleft()
            self._sent = max(0, self._sent - 1)

    def again(self) -> None:
        """The gate has just come: it must be told everything once more."""
        self._sent = 0

    def tell(self, send: Callable[[Event], bool], limit: int) -> None:
        """Send at most ``limit`` of those that were not sent yet; one that was not taken is tried
        again."""
        for event in list(islice(self._waiting, self._sent, self._sent + limit)):
            if not send(event):
                return
            self._sent += 1

    def waiting(self) -> list[Event]:
        """Those that are not acknowledged."""
        return list(self._waiting)
