"""Shaft speed from the once-per-turn mark: told, standing, lost, or doubted.

A mark that stays away is a shaft that slows, or a broken cable.  While it stays away, the speed
told is the most that a shaft can turn without making a mark; that it stands is told only where the
shaft is seen to be quiet as well, which somebody else has to say (:meth:`SpeedMeter.hear_motion`).

A node sends the 32-bit tick and the 16-bit number of the newest mark.  A mark is never later than
the frame that tells it, so its tick is unwrapped backward from there: right for 71 minutes, and
held as long as the mark stays the same.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Final

import msgspec

STANDSTILL_RAD_S: Final = 1.0
"""Below about 10 rpm the shaft counts as standing."""

FALL_MARGIN: Final = 2.0
"""A coasting machine may slow this much faster than its declared ramp."""

OVERDUE_TURNS: Final = 2
"""A mark is overdue after so many turns at the last reading."""

RISE_MARGIN: Final = 1.25
"""A drive that overshoots may rise this much faster than its declared ramp; a load rejection is
faster."""

MARK_ERROR_US: Final = 5
"""Resolution of a mark's tick beside the sampling period (wire interface)."""

SLACK_MAX: Final = 0.25
"""Most that a reading may differ from a reachable speed, as a share of it: half of what one missing
edge does."""

RETURN_S: Final = 1.0
"""Readings that are back on their former course within this time were interrupted by false
edges."""

AHEAD_MAX_US: Final = 20
"""A mark may be this much later than its frame's last instant: the wander of the node's sample
grid."""

QUIET_S: Final = 1.5
"""A shaft that has been quiet for so long, and made no mark at more than :data:`STANDSTILL_RAD_S`,
stands."""

MOVING_S: Final = 3.0
"""A shaft that stood and has moved for so long is not known to stand any more."""

LATE_MAX_US: Final = 50_000
"""A mark that was not told by the frame before it came after that frame, or the node is this slow
to tell it."""

_TICK_MASK: Final = 0xFFFFFFFF
_TICK_HALF: Final = 0x80000000
_TURNS_MAX: Final = 0x7FFF


class Turn(msgspec.Struct, frozen=True, gc=False):
    """What a new mark says of the time since the mark before it.

    ``doubt`` is empty, or why no shaft can do that: ``ramp`` (the speed changed faster than the
    declared ramp; ``limit_rad_s`` could be reached), ``count`` (tick and number of the mark
    contradict each other), ``ahead`` (the mark is later than its frame); ``count`` and ``ahead``
    tell no speed.  ``returned``: after false edges, the speed is back on its former course.
    """

    interval_us: int
    speed_rad_s: float
    doubt: str = ""
    limit_rad_s: float = 0.0
    returned: bool = False


class SpeedState(msgspec.Struct):
    """Tick and number of the last mark, and the speed over the last turn(s).

    ``turn`` is -1 while no mark is known; ``paired`` says that the last mark was seen to come;
    ``absent_us`` is the tick since which surely none has come.  ``speed_rad_s`` is told;
    ``reading_rad_s`` is what the marks said last (0: standing), more than that while they stay
    away.  ``torn``: they went away faster than any shaft stops.  ``course_rad_s`` follows the
    readings no faster than the ramp (-1: unknown), ``course_us`` is its tick; ``former_*`` the same
    before the newest doubt; ``broken``: a contradiction has interrupted it.  ``end_us``: last
    instant of the frame before.  ``most_rad_s``: what the wait for the next mark lets the shaft
    turn at most (-1: no such bound).  ``quiet_s``, ``moving_s``: for how long the shaft has been
    seen to be still, or not to be (0: it has not).
    """

    mark_us: int = -1
    turn: int = -1
    speed_rad_s: float = 0.0
    reading_rad_s: float = 0.0
    lost: bool = True
    doubted: bool = False
    first: bool = True
    paired: bool = False
    absent_us: int = 0
    torn: bool = False
    course_rad_s: float = -1.0
    course_us: int = 0
    former_rad_s: float = -1.0
    former_us: int = 0
    broken: bool = False
    end_us: int = 0
    most_rad_s: float = -1.0
    quiet_s: float = 0.0
    moving_s: float = 0.0

    def surely_below(self, speed_rad_s: float) -> bool:
        """Whether the shaft turns slower than ``speed_rad_s``: by the marks, or by their staying
        away from a shaft that is quiet."""
        if self.doubted:
            return False
        return (not self.lost and self.reading_rad_s < speed_rad_s) or (
            self.quiet_s > 0.0 and 0.0 <= self.most_rad_s < speed_rad_s
        )

    @property
    def known(self) -> bool:
        """Whether the speed may be built upon."""
        return not self.lost and not self.doubted


class SpeedMeter:
    """Speed between marks.

    Without a new mark the speed can be at most ``2 pi / (time since the last one)``.  While that
    bound is compatible with the fastest declared ramp the shaft is slowing, and the bound is told;
    when it falls faster than any ramp can slow the shaft, the mark is lost, not the speed: the last
    reading is kept and called unknown.  A bound below :data:`STANDSTILL_RAD_S` is a standing shaft
    where the shaft is quiet, however it came there, and a lost mark otherwise.

    A reading that no ramp reaches is told as it is and makes the speed ``doubted``, until
    :meth:`doubt` ends it.

    Parameters
    ----------
    ramp_max_rad_s2
        Fastest declared change of speed.
    period_us
        Sampling period: a node may know its marks no better.
    """

    def __init__(self, ramp_max_rad_s2: float, period_us: int = 200) -> None:
        self._rise_rad_s2 = RISE_MARGIN * ramp_max_rad_s2
        self._fall_rad_s2 = FALL_MARGIN * ramp_max_rad_s2
        self._unstoppable_rad_s = sqrt(4 * OVERDUE_TURNS * pi * self._fall_rad_s2)
        self._error_us = 2 * (period_us + MARK_ERROR_US)
        self.state = SpeedState()

    def mark(self, mark32_us: int, turn: int, end_us: int) -> Turn | None:
        """Take in the newest mark of a frame; what a new one says.

        Parameters
        ----------
        mark32_us, turn
            Low 32 bits of the mark's tick, 16-bit number of the mark.
        end_us
            Unwrapped tick of the frame's last instant.
        """
        s = self.state
        before_us, s.end_us = s.end_us, end_us
        if s.turn < 0:
            self._begin(mark32_us, turn, end_us)
            return None
        if turn == s.turn and mark32_us == s.mark_us & _TICK_MASK:
            return None
        mark_us = _placed(mark32_us, end_us)
        turns, interval_us = (turn - s.turn) & 0xFFFF, mark_us - s.mark_us
        if interval_us <= 0 or mark_us < before_us - LATE_MAX_US or not 0 < turns <= _TURNS_MAX:
            return self._contradiction(mark32_us, turn, end_us)
        paired, s.paired, s.torn = s.paired, True, False
        s.mark_us, s.turn, s.absent_us = mark_us, turn, mark_us
        if not paired:
            return None
        s.lost, s.reading_rad_s = False, 2 * pi * turns / (interval_us * 1e-6)
        s.speed_rad_s = s.reading_rad_s
        return self._judged(s.speed_rad_s, interval_us)

    def lose(self) -> None:
        """The mark is not valid: unknown until two new marks, or until the shaft stands."""
        s = self.state
        self._lose_sight(torn=s.reading_rad_s > self._unstoppable_rad_s)
        s.turn, s.first = -1, False

    def forget(self) -> None:
        """The node's clock has jumped: nothing from before can be compared."""
        self.lose()
        self.state.course_rad_s = self.state.former_rad_s = -1.0

    def doubt(self, doubted: bool) -> None:
        """Something else contradicts the mark, or the doubt is over: the present course is the
        shaft's."""
        self.state.doubted, self.state.former_rad_s = doubted, -1.0

    def hear_motion(self, quiet_s: float, moving_s: float) -> None:
        """For how long the shaft has been seen to be still, or not to be; 0 for both: not seen."""
        self.state.quiet_s, self.state.moving_s = quiet_s, moving_s

    def idle(self, tick_us: int) -> None:
        """Judge the time since the last mark at node tick ``tick_us``."""
        s = self.state
        waited_s = (tick_us - s.absent_us) * 1e-6
        s.most_rad_s = -1.0
        if s.turn < 0 or waited_s <= 0.0:
            return
        bound_rad_s = 2 * pi / waited_s
        s.most_rad_s = -1.0 if s.torn else bound_rad_s
        if s.lost:
            if bound_rad_s < STANDSTILL_RAD_S and s.quiet_s >= QUIET_S:
                self._stand()
        elif not s.reading_rad_s:
            if s.moving_s >= MOVING_S:
                self._lose_sight(torn=False)
        else:
            s.speed_rad_s = min(s.reading_rad_s, bound_rad_s)
            if waited_s * s.reading_rad_s > OVERDUE_TURNS * 2 * pi:
                self._overdue(waited_s, bound_rad_s)

    # ------------------------------------------------------------------ marks that stay away

    def _overdue(self, waited_s: float, bound_rad_s: float) -> None:
        """Two turns at the last reading without a mark: slowing, standing, or lost."""
        s = self.state
        if bound_rad_s < s.reading_rad_s - self._fall_rad_s2 * waited_s:
            self._lose_sight(torn=True)
        elif bound_rad_s >= STANDSTILL_RAD_S:
            return
        elif s.quiet_s >= QUIET_S:
            self._stand()
        else:
            self._lose_sight(torn=False)

    def _lose_sight(self, torn: bool) -> None:
        """Nobody knows how fast it turns; the last reading is kept."""
        s = self.state
        s.torn = s.torn or (torn and not s.lost)
        s.lost, s.paired, s.most_rad_s = True, False, -1.0
        s.speed_rad_s = s.reading_rad_s

    def _stand(self) -> None:
        """The shaft stands: what it did before says nothing of what it will do."""
        s = self.state
        s.speed_rad_s = s.reading_rad_s = 0.0
        s.lost, s.torn = False, False
        s.course_rad_s = s.former_rad_s = -1.0

    # ------------------------------------------------------------------ one mark

    def _begin(self, mark32_us: int, turn: int, end_us: int) -> None:
        """The first mark of which anything is known: it may have come long ago.

        At the very start its age is trusted as the least that it can be; later it is not older than
        this frame.
        """
        s = self.state
        s.mark_us, s.turn = _placed(mark32_us, end_us), turn
        s.absent_us = min(s.mark_us, end_us) if s.first else end_us
        s.first = False

    def _contradiction(self, mark32_us: int, turn: int, end_us: int) -> Turn:
        """Tick and number of a mark cannot both be right: begin anew from it."""
        ahead = AHEAD_MAX_US < (mark32_us - end_us) & _TICK_MASK < _TICK_HALF
        self.lose()
        self._begin(mark32_us, turn, end_us)
        self.state.doubted = self.state.broken = True
        return Turn(0, 0.0, "ahead" if ahead else "count")

    def _judged(self, speed_rad_s: float, interval_us: int) -> Turn:
        """Hold a reading against the course so far, and against that before the newest doubt."""
        s = self.state
        middle_us = s.mark_us - interval_us // 2
        slack_rad_s = speed_rad_s * min(self._error_us / interval_us, SLACK_MAX)
        course = (
            speed_rad_s
            if s.course_rad_s < 0.0
            else self._nearest(speed_rad_s, s.course_rad_s, middle_us - s.course_us)
        )
        turn = Turn(
            interval_us,
            speed_rad_s,
            returned=s.broken and middle_us - s.course_us <= RETURN_S * 1e6,
        )
        s.broken = False
        if abs(speed_rad_s - course) > slack_rad_s:
            turn = self._off_course(speed_rad_s, interval_us, course, slack_rad_s)
            course = speed_rad_s
        s.course_rad_s, s.course_us = course, middle_us
        return turn

    def _off_course(
        self, speed_rad_s: float, interval_us: int, limit_rad_s: float, slack_rad_s: float
    ) -> Turn:
        """A reading that cannot be reached from the one before it."""
        s = self.state
        waited_us = s.mark_us - interval_us // 2 - s.former_us
        if s.former_rad_s >= 0.0 and waited_us <= RETURN_S * 1e6:
            nearest = self._nearest(speed_rad_s, s.former_rad_s, waited_us)
            if abs(speed_rad_s - nearest) <= slack_rad_s:
                s.former_rad_s = -1.0
                return Turn(interval_us, speed_rad_s, returned=True)
        else:
            s.former_rad_s, s.former_us = s.course_rad_s, s.course_us
        s.doubted = True
        return Turn(interval_us, speed_rad_s, "ramp", limit_rad_s)

    def _nearest(self, speed_rad_s: float, from_rad_s: float, after_us: int) -> float:
        """The speed nearest to ``speed_rad_s`` that a shaft can reach."""
        after_s = after_us * 1e-6
        low, high = (
            from_rad_s - self._fall_rad_s2 * after_s,
            from_rad_s + self._rise_rad_s2 * after_s,
        )
        return min(max(speed_rad_s, low), high)


def _placed(mark32_us: int, end_us: int) -> int:
    """The unwrapped tick of a mark: the newest possible one that is not later than its frame."""
    ahead_us = (mark32_us - end_us) & _TICK_MASK
    return end_us + ahead_us if ahead_us <= AHEAD_MAX_US else end_us + ahead_us - (_TICK_MASK + 1)
