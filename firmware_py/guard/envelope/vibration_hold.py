"""Vibration that the shield may count with: it does not fall for no reason.

The orbit of a rotor at one speed and clearance stays as large as it is.  When it falls there, a
probe may have lost its gain, and a smaller orbit would widen the range.  So the shield counts with
the largest *lasting* vibration (the smallest of a second) of the last :data:`HOLD_NS` at that
speed.  A narrower clearance explains a fall up to the square of the clearances, a wider one none,
and another speed any.  A larger vibration counts at once.
"""

from __future__ import annotations

from typing import Final

import msgspec

LASTING_NS: Final = 1_000_000_000
"""A vibration lasts when it was there so long: what a move of the clearance shakes up does not."""
HOLD_NS: Final = 120_000_000_000
"""Long enough for the probe pair to be judged many times over, in a duty with few steady seconds as
well."""
STEADY_SPEED: Final = 0.03
"""Share by which the speed may change and be the same."""


class VibrationHoldState(msgspec.Struct):
    """The largest lasting vibration, where and when it was last reached; the second under way."""

    speed_rad_s: float = 0.0
    level_m: float = 0.0
    clearance_m: float = 0.0
    reached_ns: int = 0
    begun_ns: int = 0
    smallest_m: float = 0.0


class VibrationHold:
    """Keeps the vibration from falling unexplained."""

    def __init__(self) -> None:
        self.state = VibrationHoldState()

    def step(
        self, peak_to_peak_m: float, clearance_m: float, speed_rad_s: float, now_ns: int
    ) -> float:
        """Vibration (m, peak to peak) to count with in ``clearance_m`` at ``speed_rad_s``."""
        s = self.state
        if not abs(speed_rad_s - s.speed_rad_s) <= STEADY_SPEED * s.speed_rad_s:
            self.state = VibrationHoldState(
                speed_rad_s, 0.0, clearance_m, now_ns, now_ns, peak_to_peak_m
            )
            return peak_to_peak_m
        s.smallest_m = min(s.smallest_m, peak_to_peak_m)
        held_m = self._held(clearance_m)
        if now_ns - s.begun_ns >= LASTING_NS:
            if s.smallest_m >= held_m or now_ns - s.reached_ns >= HOLD_NS:
                s.level_m, s.clearance_m, s.reached_ns = s.smallest_m, clearance_m, now_ns
            s.begun_ns, s.smallest_m = now_ns, peak_to_peak_m
        return max(peak_to_peak_m, held_m)

    def _held(self, clearance_m: float) -> float:
        """The lasting level, as small as a narrower clearance may have made it."""
        s = self.state
        if not 0.0 < clearance_m < s.clearance_m:
            return s.level_m
        share = clearance_m / s.clearance_m
        return s.level_m * share * share
