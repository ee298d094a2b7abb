"""One alarm: a limit with delay, hysteresis and, for danger, a latch (vocabulary of API 670, 5th
ed.).

The delay counts only time that was judged: while the quality is bad (a gap, a channel that is not
OK, part of a turn below the limit) its timer holds.  A bad signal neither brings an alarm nearer
nor takes it away.
"""

from __future__ import annotations

import msgspec

from firmware_py.guard.alarms.tally import Tally
from firmware_py.records import Alarm, Severity

QUIET_NS = -1
"""Of :attr:`AlarmState.over_ns`: the limit is not exceeded."""


class Notice(msgspec.Struct, frozen=True):
    """Something to tell: the core numbers and dates it into an
    :class:`~firmware_py.records.Event`."""

    severity: Severity
    name: str
    text: str
    value: float = 0.0
    limit: float = 0.0


class AlarmState(msgspec.Struct):
    """Where an alarm stands.

    ``over_ns`` is how long the limit has been passed without a return, in judged time;
    ``judged_ns`` is the end of what was judged or held last.  ``kept`` is what is left of earlier
    times above the limit, for a limit whose times add up.
    """

    name: str
    severity: int
    latching: bool
    over_ns: int = QUIET_NS
    judged_ns: int = 0
    standing: bool = False
    since_ns: int = 0
    value: float = 0.0
    limit: float = 0.0
    kept: Tally = msgspec.field(default_factory=Tally)

    def judge(
        self,
        value: float,
        limit: float,
        t_ns: int,
        *,
        delay_ns: int,
        hysteresis: float,
        complete: bool,
        adds_up: bool = False,
    ) -> bool:
        """Hold ``value`` against ``limit`` at ``t_ns``; True when the alarm begins to stand.

        A value over an incomplete turn can be too small, never too large: it may raise, not clear,
        and below the limit it does not count.  With ``adds_up``, a return takes back only part of
        the time that went before (:mod:`firmware_py.guard.alarms.tally`).
        """
        passed_ns, self.judged_ns = max(0, t_ns - self.judged_ns), t_ns
        self.value, self.limit = value, limit
        if value > limit:
            self.over_ns = self._begun() if self.over_ns == QUIET_NS else self.over_ns + passed_ns
        elif not complete:
            return False
        elif value <= limit * (1.0 - hysteresis):
            if adds_up and (self.kept.level or self.over_ns > 0):  # else nothing is left or added
                self.kept.add(True, max(self.over_ns, 0), delay_ns)
                self.kept.add(False, passed_ns, delay_ns)
            self.over_ns = QUIET_NS
            self.standing = self.standing and self.latching
        elif self.over_ns != QUIET_NS:
            self.over_ns += passed_ns
        if self.standing or self.over_ns == QUIET_NS or self.over_ns < delay_ns:
            return False
        self.standing, self.since_ns = True, t_ns
        return True

    def _begun(self) -> int:
        """What a time above the limit begins with."""
        begun_ns = self.kept.amount
        self.kept.clear()
        return begun_ns

    def forget(self) -> None:
        """The limit does not matter now: no time above it is left."""
        self.over_ns = QUIET_NS
        self.kept.clear()

    def hold(self, t_ns: int) -> None:
        """Nothing can be said of the time up to ``t_ns``: the timer keeps what it has, the alarm
        stays as it is."""
        self.judged_ns = t_ns

    def reset(self) -> bool:
        """Clear the latch unless the limit was exceeded when last judged; True when nothing stands
        any more."""
        if self.over_ns == QUIET_NS:
            self.standing = False
            self.kept.clear()
        return not self.standing

    def record(self) -> Alarm:
        """The alarm as it is published."""
        return Alarm(self.name, self.severity, self.since_ns, self.value, self.limit, self.latching)
