"""A standing condition: an alarm while it holds, one event when it begins and one when it ends."""

from __future__ import annotations

import msgspec

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.records import Alarm, Severity


class ConditionState(msgspec.Struct):
    """Whether the condition holds, and since when."""

    standing: bool = False
    since_ns: int = 0
    text: str = ""


class Condition:
    """One named condition of the device itself (not a limit with delay and hysteresis).

    Parameters
    ----------
    name
        Name of the alarm and of the event at its beginning.
    over
        Name of the event at its end.
    severity
        How much it asks of a person.
    """

    def __init__(self, name: str, over: str, severity: Severity = Severity.FAULT) -> None:
        self._name, self._over, self._severity = name, over, severity
        self.state = ConditionState()

    def step(self, holds: bool, text: str, now_ns: int) -> list[Notice]:
        """Judge one cycle; ``text`` is what a person reads when it begins, and while it stands."""
        s = self.state
        if holds:
            s.text = text
        if holds == s.standing:
            return []
        s.standing = holds
        if not holds:
            lasted_s = (now_ns - s.since_ns) * 1e-9
            return [
                Notice(Severity.INFO, self._over, f"{self._name} is over after {lasted_s:.1f} s")
            ]
        s.since_ns = now_ns
        return [Notice(self._severity, self._name, text)]

    def standing(self) -> list[Alarm]:
        """The alarm while the condition holds."""
        s = self.state
        if not s.standing:
            return []
        return [
            Alarm(self._name, int(self._severity), s.since_ns, 0.0, 0.0, latched=False, text=s.text)
        ]
