"""What the device loses at present: counters of losses that still grow, as one standing alarm."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from firmware_py.records import Alarm, Severity

HOLD_NS: Final = 10_000_000_000
"""A loss counts as going on for this long after its counter last grew."""

_LOSS: Final = re.compile(
    r"(room_)?(lost|oversized|malformed)_(guard|brain|gate)|link_queue_overflow|link_send_failed"
    r"|events_dropped"
    r"|trip_file_failures|recorder_(lost|dropped)\w*|station_lost|replies_dropped_\w+"
)


class Losses:
    """Watches counters by name, those of guard and gate together."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._grew_ns: dict[str, int] = {}
        self._since_ns = 0

    def step(self, counters: Mapping[str, int], now_ns: int) -> None:
        """Take in all counters; call it about once a second."""
        losses = {name: count for name, count in counters.items() if _LOSS.fullmatch(name)}
        for name, count in losses.items():
            if name in self._last and count > self._last[name]:
                if not self._grew_ns:
                    self._since_ns = now_ns
                self._grew_ns[name] = now_ns
        self._last = losses
        self._grew_ns = {
            name: t_ns for name, t_ns in self._grew_ns.items() if now_ns - t_ns < HOLD_NS
        }

    def standing(self) -> list[Alarm]:
        """One alarm that names every counter that grows; empty when nothing is lost."""
        if not self._grew_ns:
            return []
        named = ", ".join(f"{name} = {self._last.get(name, 0)}" for name in sorted(self._grew_ns))
        text = (
            f"records or frames are lost: {named}; this machine or its bus is overloaded: end "
            "what else runs on it, look at processor load and bus load"
        )
        return [
            Alarm(
                "queue_losses",
                Severity.ALERT,
                self._since_ns,
                float(len(self._grew_ns)),
                0.0,
                False,
                text,
            )
        ]
