"""Can a shaft turn as the marks say?  Doubt begins at once, and ends slowly.

An implausible mark ends authority (the speed is unknown to the envelope) and still counts for the
speed-high trip.  The doubt ends when the marks have been clean for :data:`CLEAN_NS` and something
speaks for them: the speed came back to its former course, or the orbit turns at the told speed.  It
also ends when the shaft stands, and when a person resets it.

What is judged is the last reading of the marks, not the lower speed that is told while a mark stays
away: a number that steps by two makes every mark late.
"""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec

from firmware_py.acquire.speed import SpeedState, Turn
from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.tally import BAD, counted
from firmware_py.guard.measurement.orbit_orders import Evidence, OrbitOrders, OrbitState
from firmware_py.records import Alarm, Block, Severity

NAME: Final = "speed_implausible"

CLEAN_NS: Final = 30_000_000_000
"""Marks that were implausible once are believed after this time without another doubt."""

WINDOWS: Final = 3
"""Windows in a row in which the orbit agrees with the marks; windows in which it contradicts them,
which add up where it agrees between."""

_CAUSES: Final = {
    "ramp": "the marks tell {value:.0f} rpm, operating.speed_ramp_max_rpm_s lets it reach "
    "{limit:.0f}: edges too many "
    "or missing, or a broken coupling; check mark sensor and machine",
    "count": "tick and number of the once-per-turn mark contradict each other; check the mark "
    "input of the node",
    "ahead": "the once-per-turn mark is later than the frame that tells it; check the clock of the "
    "node",
    "orbit": "the marks tell {value:.0f} rpm, the shaft moves {limit:.0f} times a minute: edges "
    "too many or missing, "
    "or whirl; check mark sensor and machine",
    "standing": "the marks tell a standing shaft, but it vibrates; check mark sensor and machine",
}


class SpeedCheckState(msgspec.Struct):
    """The alarm, what speaks for the marks, and what the orbit said lately.

    ``cause`` is empty while the marks are plausible.  ``confirmed``: since the marks were lost
    last, the orbit has agreed with them, so that a later contradiction is a whirl.
    """

    orbit: OrbitState = msgspec.field(default_factory=OrbitState)
    cause: str = ""
    since_ns: int = 0
    doubt_ns: int = 0
    value_rpm: float = 0.0
    limit_rpm: float = 0.0
    returned: bool = False
    confirmed: bool = False
    agreed: int = 0
    contradicted: int = 0
    doubts: int = 0


class SpeedCheck:
    """The alarm ``speed_implausible``.

    Parameters
    ----------
    config
        Displacement channels and sampling.
    """

    def __init__(self, config: Config) -> None:
        self._orbit = OrbitOrders(config)
        self._state = SpeedCheckState()

    @property
    def state(self) -> SpeedCheckState:
        """The stage's memory (for snapshots)."""
        self._state.orbit = self._orbit.state
        return self._state

    @state.setter
    def state(self, state: SpeedCheckState) -> None:
        self._state, self._orbit.state = state, state.orbit

    def step(
        self, turns: list[Turn], blocks: list[Block], speed: SpeedState, now_ns: int
    ) -> list[Notice]:
        """Judge new marks and blocks."""
        s = self._state
        notices: list[Notice] = []
        for turn in turns:
            if turn.doubt:
                notices += self._doubt(
                    turn.doubt, turn.speed_rad_s * 30 / pi, turn.limit_rad_s * 30 / pi, now_ns
                )
            s.returned = s.returned or turn.returned
        if speed.lost:
            s.confirmed, s.agreed = False, 0
            self._orbit.restart()
        elif blocks and (s.cause or not s.confirmed or speed.reading_rad_s == 0.0):
            for block in blocks:
                notices += self._look(self._orbit.step(block, speed.reading_rad_s), speed, now_ns)
        if s.cause and blocks and self._is_clean(speed, now_ns):
            notices.append(self._end("the marks are plausible again"))
        return notices

    @property
    def doubted(self) -> bool:
        """Whether the speed is implausible."""
        return bool(self._state.cause)

    def standing(self) -> list[Alarm]:
        """The alarm while it stands."""
        s = self._state
        if not s.cause:
            return []
        text = _CAUSES[s.cause].format(value=s.value_rpm, limit=s.limit_rpm)
        return [Alarm(NAME, int(Severity.FAULT), s.since_ns, s.value_rpm, s.limit_rpm, False, text)]

    def reset(self) -> list[Notice]:
        """A person has looked at mark and machine."""
        return [self._end("reset")] if self._state.cause else []

    # ------------------------------------------------------------------ one doubt

    def _doubt(self, cause: str, value_rpm: float, limit_rpm: float, now_ns: int) -> list[Notice]:
        s = self._state
        begins = not s.cause
        s.doubt_ns, s.returned, s.confirmed, s.agreed = now_ns, False, False, 0
        s.contradicted = 0
        s.doubts += 1
        if not begins:
            return []
        s.cause, s.since_ns, s.value_rpm, s.limit_rpm = cause, now_ns, value_rpm, limit_rpm
        text = _CAUSES[cause].format(value=value_rpm, limit=limit_rpm)
        return [Notice(Severity.FAULT, NAME, text, value_rpm, limit_rpm)]

    def _look(self, evidence: Evidence, speed: SpeedState, now_ns: int) -> list[Notice]:
        """What the orbit says.  Once it has agreed, only a shaft that is told to stand can be
        contradicted."""
        s = self._state
        if evidence == Evidence.AGREES:
            s.agreed += 1
            s.contradicted = counted(s.contradicted, False, 1, WINDOWS)
            s.confirmed = s.confirmed or s.agreed >= WINDOWS
        elif evidence == Evidence.CONTRADICTS:
            s.agreed = 0
            s.contradicted = counted(s.contradicted, True, 1, WINDOWS)
            if s.contradicted >= BAD * WINDOWS:
                told_rpm = speed.reading_rad_s * 30 / pi
                cause = "orbit" if told_rpm else "standing"
                return self._doubt(cause, told_rpm, told_rpm * self._orbit.seen_order, now_ns)
        return []

    def _is_clean(self, speed: SpeedState, now_ns: int) -> bool:
        """Whether the marks may be believed again."""
        s = self._state
        if speed.lost:
            return False
        if speed.reading_rad_s == 0.0:
            return s.cause != "standing"
        return now_ns - s.doubt_ns >= CLEAN_NS and (s.returned or s.agreed >= WINDOWS)

    def _end(self, why: str) -> Notice:
        s = self._state
        s.cause, s.agreed = "", 0
        s.contradicted = 0
        return Notice(Severity.INFO, "speed_plausible", f"{why}: the speed is believed again")
