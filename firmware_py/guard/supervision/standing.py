"""One supervised condition: when it stands, since when, and the two figures of its text."""

from __future__ import annotations

import msgspec

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.tally import BAD, counted
from firmware_py.records import Alarm, Severity


class Supervised(msgspec.Struct):
    """A condition that stands or not; ``since_ns`` is when it last began."""

    name: str
    standing: bool = False
    since_ns: int = 0
    value: float = 0.0
    limit: float = 0.0
    latched: bool = False
    text: str = ""

    def begin(self, now_ns: int, text: str, value: float = 0.0, limit: float = 0.0) -> Notice:
        """It stands from now on."""
        self.standing, self.since_ns, self.value, self.limit = True, now_ns, value, limit
        self.text = text
        return Notice(Severity.FAULT, self.name, text, value, limit)

    def end(self, now_ns: int) -> Notice:
        """It no longer stands."""
        self.standing = False
        lasted_s = (now_ns - self.since_ns) * 1e-9
        return Notice(
            Severity.INFO, f"{self.name}_ended", f"{self.name} stood for {lasted_s:.1f} s"
        )

    def record(self) -> Alarm:
        """The alarm as it is published."""
        return Alarm(
            self.name,
            int(Severity.FAULT),
            self.since_ns,
            self.value,
            self.limit,
            self.latched,
            self.text,
        )


class Confirmation(msgspec.Struct, array_like=True):
    """How much of what was reported lately says the same, and when the first of it came."""

    level: int = 0
    first_ns: int = 0

    def again(self, now_ns: int, reports: int, lasting_ns: int) -> bool:
        """One more report; True once there are enough over enough time."""
        if not self.level:
            self.first_ns = now_ns
        self.level = counted(self.level, True, 1, reports)
        return self.level >= BAD * reports and now_ns - self.first_ns >= lasting_ns

    def against(self, reports: int) -> None:
        """A report has said otherwise: one alone does not outweigh one that was there before."""
        self.level = counted(self.level, False, 1, reports)

    def clear(self) -> None:
        """Begin anew."""
        self.level = 0
