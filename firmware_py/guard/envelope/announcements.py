"""Ramps that were announced: what the shield must be ready for beside the unannounced ones.

An announcement is a question: may the machine ramp so, then?  Accepted means that the clearance
will be where every point of the ramp is admissible, in time.  It narrows what is admissible, and
expires with its ramp.
"""

from __future__ import annotations

from math import isfinite, pi
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.guard.envelope.retreat import Ramp
from firmware_py.records import CommandRequest

WAITING_MAX: Final = 8
AHEAD_MAX_S: Final = 3600.0
LATE_MAX_S: Final = 1.0
"""A ramp may end this much later than announced; until then its end is still expected."""


class Announced(msgspec.Struct, frozen=True):
    """An accepted ramp in the guard's own time."""

    start_ns: int
    end_ns: int
    speed_rad_s: float
    load_N: float


class Announcements:
    """Accepted ramps in the order of their starts.

    Parameters
    ----------
    config
        The declared range.
    lead_s
        How long before its start a ramp must be announced
        (:attr:`firmware_py.guard.envelope.shield.Shield.lead_s`).
    """

    def __init__(self, config: Config, lead_s: float) -> None:
        o = config.machine.operating
        self._speeds_rpm, self._loads_N = (
            (o.speed_min_rpm, o.speed_max_rpm),
            (o.load_min_N, o.load_max_N),
        )
        self._lead_s = lead_s
        self.state: list[Announced] = []

    def request(self, request: CommandRequest, now_ns: int) -> list[str]:
        """Take the ramp of ``request`` in, or every reason why not."""
        reasons = self._reasons(request, now_ns)
        if not reasons and (ramp := request.ramp) is not None:
            start_ns, end_ns = (now_ns + round(t * 1e9) for t in (ramp.start_s, ramp.end_s))
            self.state.append(Announced(start_ns, end_ns, ramp.speed_rpm * pi / 30, ramp.load_N))
        return reasons

    def ahead(self, now_ns: int) -> list[Ramp]:
        """What is to come or under way, relative to ``now_ns``; what is over is forgotten."""
        self.state = [a for a in self.state if now_ns <= a.end_ns + LATE_MAX_S * 1e9]
        return [
            Ramp((a.start_ns - now_ns) * 1e-9, (a.end_ns - now_ns) * 1e-9, a.speed_rad_s, a.load_N)
            for a in self.state
        ]

    def _reasons(self, request: CommandRequest, now_ns: int) -> list[str]:
        ramp = request.ramp
        if ramp is None or not all(
            isfinite(v) for v in (ramp.start_s, ramp.end_s, ramp.speed_rpm, ramp.load_N)
        ):
            return [
                "announce needs a ramp: start_s and end_s from now, speed_rpm and load_N at its "
                "end, all finite"
            ]
        free_ns = self.state[-1].end_ns - now_ns if self.state else 0
        checks = (
            (
                ramp.start_s >= self._lead_s,
                f"start_s = {ramp.start_s:g}: the actuator needs {self._lead_s:g} s to be ready; "
                f"start the ramp later",
            ),
            (
                ramp.start_s <= ramp.end_s <= AHEAD_MAX_S,
                f"end_s = {ramp.end_s:g}: outside start_s .. {AHEAD_MAX_S:g} s; end the ramp in "
                f"that time",
            ),
            (
                round(ramp.start_s * 1e9) >= free_ns,
                f"start_s = {ramp.start_s:g}: another announced ramp ends at {free_ns * 1e-9:.3f} "
                f"s; start after it",
            ),
            (
                _inside(ramp.speed_rpm, self._speeds_rpm),
                f"speed_rpm = {ramp.speed_rpm:g}: outside operating.speed_min_rpm .. speed_max_rpm",
            ),
            (
                _inside(ramp.load_N, self._loads_N),
                f"load_N = {ramp.load_N:g}: outside operating.load_min_N .. load_max_N",
            ),
            (
                len(self.state) < WAITING_MAX,
                f"{WAITING_MAX} announced ramps already wait; wait for one to end",
            ),
        )
        return [text for holds, text in checks if not holds]


def _inside(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
