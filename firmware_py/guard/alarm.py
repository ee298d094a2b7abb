"""One alarm: a limit with delay, hysteresis and, for danger, a latch (API 670)."""

from __future__ import annotations

import msgspec

from firmware_py.records import Alarm, Severity

QUIET_NS = -1


class Notice(msgspec.Struct, frozen=True):
    """Something to tell: the core numbers and dates it into an :class:`~firmware_py.records.Event`."""

    severity: Severity
    name: str
    text: str
    value: float = 0.0
    limit: float = 0.0


class AlarmState(msgspec.Struct):
    """Where an alarm stands; ``exceeded_ns`` is when the limit was first passed without a return."""

    name: str
    severity: int
    latching: bool
    exceeded_ns: int = QUIET_NS
    standing: bool = False
    since_ns: int = 0
    value: float = 0.0
    limit: float = 0.0

    def judge(self, value: float, limit: float, t_ns: int, *, delay_ns: int, hysteresis: float, complete: bool) -> bool:
        """Hold ``value`` against ``limit`` at ``t_ns``; True when the alarm begins to stand.

        A value over an incomplete turn can be too small, never too large: it may raise, not clear.
        """
        self.value, self.limit = value, limit
        if value > limit:
            if self.exceeded_ns == QUIET_NS:
                self.exceeded_ns = t_ns
        elif complete and value <= limit * (1.0 - hysteresis):
            self.exceeded_ns = QUIET_NS
            self.standing = self.standing and self.latching
        if self.standing or self.exceeded_ns == QUIET_NS or t_ns - self.exceeded_ns < delay_ns:
            return False
        self.standing, self.since_ns = True, t_ns
        return True

    def defeat(self) -> None:
        """The channel is not OK: nothing more can be said (a latched alarm stays)."""
        self.exceeded_ns = QUIET_NS
        self.standing = self.standing and self.latching

    def reset(self) -> bool:
        """Clear the latch unless the limit is exceeded now; True when nothing stands any more."""
        if self.exceeded_ns == QUIET_NS:
            self.standing = False
        return not self.standing

    def record(self) -> Alarm:
        """The alarm as it is published."""
        return Alarm(self.name, self.severity, self.since_ns, self.value, self.limit, self.latching)
