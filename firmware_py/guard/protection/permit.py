"""The run permit: every reason for which the device withholds it stands in one table.

The device may remove the permission to run, never grant one that others withhold.  It grants only
after it has seen OK samples itself: neither a cold start nor a restart after a crash says anything
about the machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec

from firmware_py.config import Drive
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.condition import Condition, ConditionState
from firmware_py.records import Alarm, Severity

UNREADABLE: Final = "trip_file_unreadable"
"""Stands among the latched trips when nobody knows which ones stood.  Nothing dangerous was
measured, so it withholds the permit but does not request a trip."""

UNREADABLE_TEXT: Final = (
    "trips.json in the guard's state folder cannot be read (cause in the guard's log): which trips "
    "were latched is not "
    "known; look at the machine, then `reset`"
)

NEVER_NS: Final = -(1 << 62)
RESTART_WINDOW_NS: Final = 600_000_000_000
"""Two restarts within this time withdraw the permit; so long a restarted guard is on probation."""

RESTART_BLIND_NS: Final = 2_000_000_000
"""Longest time without samples on probation: what crashed once is given less patience."""

BLIND_OVER_NS: Final = 1_000_000_000
"""Longest time for which samples must be back before the permit is given again."""

NO_SAMPLES_NS: Final = 100_000_000
"""The alarm ``no_samples`` begins after five times the age at which samples stop being fresh (20
ms): a host that stalled for a moment is told by the failsafe ``samples_stale`` alone."""

SAMPLES_BACK_NS: Final = 1_000_000_000
"""Samples that come without a break for this time end the alarm: one that flickers is one event,
not many."""

FIRST_SAMPLES_NS: Final = 3_000_000_000
"""At a cold start the node may start later than the device; then the alarm waits this long."""


class Start(msgspec.Struct, frozen=True):
    """How this run of the guard began.

    ``restart``: the run before it, in the same boot of the host, was not told to stop (killed,
    crashed, hung). ``barred``: that happened twice within 10 min, and nobody has said `reset` or
    `arm` since.
    """

    restart: bool = False
    barred: bool = False


class PermitFacts(msgspec.Struct):
    """What one cycle knows.

    ``tripped``: latched trips that the drive is to execute; ``foreign``: the node follows commands
    that this device did not send, and ``drive.trip_on_foreign`` is set.
    """

    now_ns: int
    samples_fresh: bool
    samples_ok: bool
    tripped: list[str]
    foreign: bool = False


class PermitState(msgspec.Struct):
    """What the permit remembers (for snapshots)."""

    start: Start = Start()
    started_ns: int = NEVER_NS
    fresh_ns: int = NEVER_NS
    stale_ns: int = NEVER_NS
    judged_ns: int = NEVER_NS
    blind_ns: int = 0
    seen: bool = False
    barred: bool = False
    probation: bool = False
    granted: bool = False
    trip_request: bool = False
    reasons: list[str] = []
    no_samples: ConditionState = msgspec.field(default_factory=ConditionState)


class PermitRow(msgspec.Struct, frozen=True):
    """One reason: its name, when it holds (facts, state, longest time without samples in ns), and
    the text."""

    name: str
    holds: Callable[[PermitFacts, PermitState, int], bool]
    text: str


ROWS: Final = (
    PermitRow("tripped", lambda f, s, _: bool(f.tripped),
        "tripped: an alarm is latched; remove the cause, then `reset`"),
    PermitRow("foreign", lambda f, s, _: f.foreign,
        "foreign: the node follows commands of another device; disconnect that one"),
    PermitRow("restarts", lambda f, s, _: s.barred,
        "restarts: the guard was restarted twice within 10 min; read its log, then `reset` or "
        "`arm`"),
    PermitRow("unseen", lambda f, s, _: not s.seen,
        "unseen: no OK samples since the guard started; check node and displacement probes"),
    PermitRow("blind", lambda f, s, blind_ns: s.seen and s.blind_ns > blind_ns,
        "blind: samples were missing for longer than drive.blind_max_s (2 s after a restart); "
        "check link and node"),
)  # fmt: skip


class Permit:
    """Judges the table once a cycle.

    Parameters
    ----------
    drive
        Table ``[drive]``.
    start
        How this run of the guard began.
    """

    def __init__(self, drive: Drive, start: Start) -> None:
        self._blind_ns = round(drive.blind_max_s * 1e9)
        self._no_samples = Condition("no_samples", "samples_back")
        self._state = PermitState(start=start, barred=start.barred, probation=start.restart)
        self._state.no_samples = self._no_samples.state

    @property
    def state(self) -> PermitState:
        """The stage's memory (for snapshots)."""
        return self._state

    @state.setter
    def state(self, state: PermitState) -> None:
        self._state = state
        self._no_samples.state = state.no_samples

    def begin(self, latched: list[str]) -> list[Notice]:
        """What a person should know of this start; ``latched``: trips that the run before has
        left."""
        notices = []
        if self._state.start.restart:
            notices.append(
                Notice(
                    Severity.ALERT,
                    "guard_restarted",
                    (
                        "the guard that ran before was killed, crashed or hung; a second restart "
                        "within 10 min withdraws the "
                        "run permit: read its log"
                    ),
                )
            )
        if UNREADABLE in latched:
            notices.append(Notice(Severity.FAULT, UNREADABLE, UNREADABLE_TEXT))
        return notices

    def step(self, facts: PermitFacts) -> list[Notice]:
        """Judge one cycle; ``state.granted`` and ``state.trip_request`` are what the heartbeat
        says."""
        s, now_ns = self._state, facts.now_ns
        if s.started_ns == NEVER_NS:
            s.started_ns = s.stale_ns = s.judged_ns = now_ns
        s.probation = s.probation and now_ns - s.started_ns < RESTART_WINDOW_NS
        blind_ns = min(self._blind_ns, RESTART_BLIND_NS) if s.probation else self._blind_ns
        self._look(facts, blind_ns)
        s.reasons = [row.text for row in ROWS if row.holds(facts, s, blind_ns)]
        s.trip_request = any(name != UNREADABLE for name in facts.tripped)
        return self._change(not s.reasons) + self._watch(facts)

    def reset(self) -> None:
        """A person has looked (`reset`, or an accepted `arm`): restarts count from here on."""
        self._state.barred = self._state.probation = False

    def standing(self) -> list[Alarm]:
        """The alarm ``no_samples``."""
        return self._no_samples.standing()

    def _look(self, facts: PermitFacts, blind_ns: int) -> None:
        """Count the time without samples; time with samples takes it back, one for one.

        So a frame now and then does not count as seeing, and a stall now and then does not stop the
        machine.
        """
        s, now_ns = self._state, facts.now_ns
        passed_ns, s.judged_ns = now_ns - s.judged_ns, now_ns
        if facts.samples_fresh:
            s.fresh_ns = now_ns
            s.seen = s.seen or facts.samples_ok
            s.blind_ns = max(0, s.blind_ns - passed_ns)
        else:
            s.stale_ns = now_ns
            s.blind_ns = min(s.blind_ns + passed_ns, blind_ns + BLIND_OVER_NS)

    def _change(self, granted: bool) -> list[Notice]:
        s = self._state
        if granted == s.granted:
            return []
        s.granted = granted
        if granted:
            return [Notice(Severity.INFO, "run_permit_granted", "OK samples, nothing latched")]
        return [Notice(Severity.ALERT, "run_permit_withdrawn", "; ".join(s.reasons))]

    def _watch(self, facts: PermitFacts) -> list[Notice]:
        """Alarm while samples stay away."""
        s, now_ns = self._state, facts.now_ns
        if facts.samples_fresh:
            away = s.no_samples.standing and now_ns - s.stale_ns < SAMPLES_BACK_NS
        else:
            known = s.fresh_ns != NEVER_NS or s.start.restart
            since_ns = max(s.fresh_ns, s.started_ns)
            away = s.no_samples.standing or now_ns - since_ns > (
                NO_SAMPLES_NS if known else FIRST_SAMPLES_NS
            )
        return self._no_samples.step(
            away,
            (
                "no fresh samples from the node: nothing is protected; the run permit ends after "
                "drive.blind_max_s = "
                f"{self._blind_ns * 1e-9:g} s: check that node and link are running"
            ),
            now_ns,
        )
