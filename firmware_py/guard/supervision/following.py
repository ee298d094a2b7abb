"""Following error: does the measured value go where the actuator is sent, in the time that it
declares?

The admissible position is a band.  Its edges lie at the targets of the last while where those call
the actuator away from the edge's side at once (the fastest response), and else run towards them no
faster than the slowest admissible actuator (:data:`SLOWEST_SHARE` of the declared rate, after the
allowed delay).  A measurement outside the band by more than the tolerance is a following error.  It
becomes an alarm when it lasts, when it is gross, when the actuator moves too slowly, or when it
comes again and again.  Time in error adds up where good readings, or none, come between
(:mod:`~firmware_py.guard.alarms.tally`).  The same test sees movement that nobody commanded:
without a command the target is the boot value.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.tally import Tally
from firmware_py.guard.supervision.recent import Span, extremes, note
from firmware_py.guard.supervision.standing import Supervised

SLOWEST_SHARE: Final = 0.9
"""An actuator that moves at less than this share of its declared rate falls out of the band."""

GROSS: Final = 4.0
GROSS_NS: Final = 500_000_000
"""An error of this many tolerances beyond the band is an alarm after this time: ten readings."""

SLOW_SHARES: Final = (0.1, 0.75)
SLOW_NS: Final = 500_000_000
"""Outside the band for this long and moving home at a share of the declared rate between these two:
a slow actuator. Below them it stands still, above them it catches up."""

EXCURSIONS: Final = 3
EXCURSION_READINGS: Final = 2
EXCURSIONS_NS: Final = 60_000_000_000
"""So many short errors, of so many readings in a row each, within a minute: it sticks or overshoots
now and then."""

CLEAR_NS: Final = 1_000_000_000
"""An alarm ends after this long inside the band."""

AGAIN_NS: Final = 600_000_000_000
"""A second alarm within ten minutes stands until somebody resets it: at the retreat value even a
stuck actuator is where it should be, so that being inside the band proves little."""

GAP_NS: Final = 500_000_000
"""Readings further apart than this (ten periods): the time between them is unknown, and counts
neither for an error nor against it."""


class Quantity(msgspec.Struct, frozen=True):
    """What one actuated quantity is, and what its actuator declares."""

    name: str
    unit: str
    measured: str
    tolerance: float
    rate: float
    delay_ns: int
    lasting_ns: int


class FollowingState(msgspec.Struct):
    """The band, the present error, the errors of the last minute and the alarm."""

    alarm: Supervised
    targets: list[Span] = []
    low: float = 0.0
    high: float = 0.0
    last_ns: int = -1
    side: int = 0
    readings: int = 0
    began_ns: int = 0
    began_at: float = 0.0
    lasted: Tally = msgspec.field(default_factory=Tally)
    gross: Tally = msgspec.field(default_factory=Tally)
    inside_ns: int = 0
    excursions_ns: list[int] = []
    alarms_ns: list[int] = []
    text: str = ""


class Following:
    """Supervises one quantity.

    Parameters
    ----------
    quantity
        Names, tolerance, rate (units a second), allowed delay, and how long an error may last.
    """

    def __init__(self, quantity: Quantity) -> None:
        self._q = quantity
        self.state = FollowingState(Supervised(quantity.name))

    def target(self, value: float, now_ns: int) -> None:
        """The actuator is, or may be, sent to ``value`` from now on."""
        note(self.state.targets, now_ns, value, self._q.delay_ns)

    def step(
        self,
        measured: float,
        commanded: float,
        now_ns: int,
        remark: str = "",
        excused: bool = False,
    ) -> list[Notice]:
        """Judge one reading.

        Parameters
        ----------
        measured
            A reading that is OK.
        commanded
            The present target, for the text.
        remark
            What the text says besides.
        excused
            An error counts for nothing now; being inside the band still ends an alarm.
        """
        notices = self._judge(measured, commanded, now_ns, remark, excused)
        s = self.state
        if s.alarm.standing:
            s.alarm.text = f"{s.text}; now {measured:.4g} {self._q.unit}, commanded {commanded:.4g}"
        return notices

    def _judge(
        self, measured: float, commanded: float, now_ns: int, remark: str, excused: bool
    ) -> list[Notice]:
        s, q = self.state, self._q
        joined = s.last_ns >= 0 and now_ns - s.last_ns <= GAP_NS
        passed_ns = now_ns - s.last_ns if joined else 0
        self._move_band(measured, now_ns)
        side = 1 if measured > s.high + q.tolerance else -1 if measured < s.low - q.tolerance else 0
        if side and excused:
            s.side, s.readings, s.inside_ns = 0, 0, now_ns
            self._forget()
            return []
        if s.side and side != s.side:
            self._end_excursion(now_ns)
        if not side:
            s.side, s.readings = 0, 0
            self._count(False, False, passed_ns)
            return self._inside(now_ns)
        if side != s.side or not joined:
            s.side, s.readings, s.began_ns, s.began_at = side, 0, now_ns, measured
        s.readings += 1
        s.inside_ns = now_ns
        limit = s.high if side > 0 else s.low
        s.alarm.value, s.alarm.limit = measured, limit
        why = self._why(measured, limit, passed_ns, now_ns)
        return self._begin(f"{why}{remark}", measured, commanded, limit, now_ns) if why else []

    def reset(self) -> None:
        """A person has looked: what is wrong now stays, what was before is forgotten."""
        s = self.state
        s.alarms_ns, s.excursions_ns, s.alarm.latched = [], [], False

    # ------------------------------------------------------------------ one reading

    def _count(self, error: bool, gross: bool, passed_ns: int) -> None:
        """The time since the reading before counts as this one does; a gap counts for neither."""
        s, q = self.state, self._q
        s.lasted.add(error, passed_ns, q.lasting_ns + GAP_NS)
        s.gross.add(gross, passed_ns, GROSS_NS + GAP_NS)

    def _forget(self) -> None:
        """What was in error does not count any more."""
        self.state.lasted.clear()
        self.state.gross.clear()

    def _move_band(self, measured: float, now_ns: int) -> None:
        """Let the edges run to the extremes of the targets."""
        s, q = self.state, self._q
        low, high = extremes(s.targets)
        if s.last_ns < 0:  # where it stood before the first reading is unknown
            s.low, s.high = min(low, measured), max(high, measured)
        else:
            way = q.rate * SLOWEST_SHARE * (now_ns - s.last_ns) * 1e-9
            s.low, s.high = min(low, s.low + way), max(high, s.high - way)
        s.last_ns = now_ns

    def _why(self, measured: float, limit: float, passed_ns: int, now_ns: int) -> str:
        """What makes the present error an alarm; empty while it may still pass."""
        s, q = self.state, self._q
        gross, lasted_ns = abs(measured - limit) > GROSS * q.tolerance, now_ns - s.began_ns
        self._count(True, gross, passed_ns)
        home = (s.began_at - measured) * s.side
        could = q.rate * lasted_ns * 1e-9
        # an error begins with its first reading, not with the time before it
        if s.lasted.amount - passed_ns >= q.lasting_ns:
            return f"for {q.lasting_ns * 1e-9:.1f} s"
        if gross and s.gross.amount - passed_ns >= GROSS_NS:
            return f"by more than {GROSS:g} tolerances for {GROSS_NS * 1e-9:.1f} s"
        if (
            lasted_ns >= SLOW_NS
            and could >= 2 * q.tolerance
            and SLOW_SHARES[0] < home / could < SLOW_SHARES[1]
        ):
            return f"moving at {100 * home / could:.0f} % of the declared rate"
        return ""

    def _inside(self, now_ns: int) -> list[Notice]:
        """Inside the band: a standing alarm ends after a while, unless it came twice."""
        s = self.state
        s.excursions_ns = [t for t in s.excursions_ns if now_ns - t < EXCURSIONS_NS]
        if not s.alarm.standing:
            if len(s.excursions_ns) >= EXCURSIONS:
                return [self._often(now_ns)]
            return []
        if s.alarm.latched or now_ns - s.inside_ns < CLEAR_NS:
            return []
        self._forget()
        return [s.alarm.end(now_ns)]

    def _often(self, now_ns: int) -> Notice:
        """Many short errors."""
        s, q = self.state, self._q
        count, s.excursions_ns, s.inside_ns = len(s.excursions_ns), [], now_ns
        return self._stand(
            (
                f"{q.measured} left the band of its target {count} times within "
                f"{EXCURSIONS_NS * 1e-9:g} s, at last with "
                f"{s.alarm.value:.4g} {q.unit} beyond {s.alarm.limit:.4g} (tolerance "
                f"{q.tolerance:g}); look at the "
                "actuator: it sticks, overshoots, or its position sensor is noisy"
            ),
            s.alarm.value,
            s.alarm.limit,
            now_ns,
        )

    def _end_excursion(self, now_ns: int) -> None:
        """A short error is over: remember it, unless it has become an alarm."""
        s = self.state
        if s.readings >= EXCURSION_READINGS and not s.alarm.standing:
            s.excursions_ns.append(now_ns)

    def _begin(
        self, why: str, measured: float, commanded: float, limit: float, now_ns: int
    ) -> list[Notice]:
        """The error is an alarm; nothing new when it is one already."""
        s, q = self.state, self._q
        if s.alarm.standing:
            return []
        return [
            self._stand(
                (
                    f"{q.measured} {measured:.4g} {q.unit}, commanded {commanded:.4g}: beyond the "
                    f"nearest admissible "
                    f"{limit:.4g} by {abs(measured - limit):.3g} (tolerance {q.tolerance:g}) "
                    f"{why}; look at the actuator"
                ),
                measured,
                limit,
                now_ns,
            )
        ]

    def _stand(self, text: str, measured: float, limit: float, now_ns: int) -> Notice:
        s = self.state
        s.alarms_ns = [t for t in s.alarms_ns if now_ns - t < AGAIN_NS]
        s.alarm.latched = bool(s.alarms_ns)
        s.alarms_ns.append(now_ns)
        if s.alarm.latched:
            text += (
                f"; the second time within {AGAIN_NS * 1e-9 / 60:g} minutes: it stands until "
                "`reset`"
            )
        s.text = text
        return s.alarm.begin(now_ns, text, measured, limit)
