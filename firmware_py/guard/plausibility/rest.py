"""Does the shaft stand?  What the marks cannot say alone, both probes of its displacement do.

A mark that stays away is a shaft that stands or a broken cable.  A shaft that turns is moved by
unbalance and runout; one that stands shows the noise of its probes.  So the speed meter tells a
standing shaft only where both probes are quiet, and a shaft that stood and moves for a while is not
known to stand any more.  Where the marks went away faster than any shaft stops, the vibration must
have fallen as well: of an orbit as small as the noise nobody can say that it has gone.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

from firmware_py.acquire.speed import SpeedState
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.measurement.motion import ShaftMotion
from firmware_py.machine.probes import PROBES, probe_noise_m
from firmware_py.machine.schema import Machine
from firmware_py.records import Severity

QUIET_NOISES: Final = 10.0
"""Largest peak-to-peak displacement of a shaft that stands, as a multiple of its probes' rms noise:
a window of noise alone shows seven,"""

QUIET_COUNTS: Final = 20
"""and in counts of the wire, for a probe whose noise is smaller than its digits."""

FALL: Final = 0.5
"""Share of the vibration before, to which it must have fallen where the marks went away too
fast."""


class StandstillEvidence(NamedTuple):
    """For how long the probes have shown a still shaft, or a moving one; 0 for both: they cannot
    say."""

    quiet_s: float
    moving_s: float


class RestState(msgspec.Struct):
    """Since when it is quiet or moves (-1: it does not), the vibration at the last known speed, and
    whether the marks went away too fast; ``hard_stops`` counts the shafts that stood after that."""

    quiet_ns: int = -1
    moving_ns: int = -1
    moved_um: float = 0.0
    torn: bool = False
    hard_stops: int = 0


class Rest:
    """Watches the probes for a shaft that stands."""

    def __init__(self, machine: Machine) -> None:
        digit_m = max(abs(probe.scale) for probe in machine.channel[:PROBES])
        noise_um = QUIET_NOISES * 1e6 * probe_noise_m(machine)
        self.quiet_um = max(noise_um, QUIET_COUNTS * 1e6 * digit_m)
        self.state = RestState()

    def look(
        self, motion: ShaftMotion, probes_ok: bool, speed: SpeedState, now_ns: int
    ) -> StandstillEvidence:
        """What ``motion`` says of the last window, with the newest block at ``now_ns``."""
        s = self.state
        p2p_um, judged = max(motion.peak_to_peak_um), motion.complete and probes_ok
        if judged and not speed.lost and speed.speed_rad_s == speed.reading_rad_s > 0.0:
            s.moved_um = p2p_um
        most_um = min(self.quiet_um, FALL * s.moved_um) if speed.torn else self.quiet_um
        quiet = p2p_um <= most_um
        s.quiet_ns = _since(s.quiet_ns, judged and quiet, now_ns)
        s.moving_ns = _since(s.moving_ns, judged and not quiet, now_ns)
        return StandstillEvidence(_lasted_s(s.quiet_ns, now_ns), _lasted_s(s.moving_ns, now_ns))

    def step(self, speed: SpeedState) -> list[Notice]:
        """Tell of a shaft that stands after its marks went away too fast."""
        s = self.state
        was_torn, s.torn = s.torn, speed.torn
        if not was_torn or speed.torn or speed.lost or speed.reading_rad_s:
            return []
        s.hard_stops += 1
        return [
            Notice(
                Severity.ALERT,
                "hard_stop",
                "the shaft stands: it makes no mark and both probes are quiet; it stopped faster "
                "than twice operating.speed_ramp_max_rpm_s: braked hard, or seized; look at the "
                "machine before it starts again",
            )
        ]


def _since(since_ns: int, holds: bool, now_ns: int) -> int:
    if not holds:
        return -1
    return now_ns if since_ns < 0 else since_ns


def _lasted_s(since_ns: int, now_ns: int) -> float:
    """Above 0 from the first moment on."""
    return 0.0 if since_ns < 0 else max(now_ns - since_ns, 1) * 1e-9
