"""The envelope: which clearances are admissible now, from everything that is measured.

Load estimate, vibration that does not fall unexplained, the smaller clearance and the shield in
their one order.  The guard feeds it with what its stages believe; environments and studies that
show a policy what the device would let through feed it with their observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import LoadEstimator, LoadInterval, Look
from firmware_py.guard.envelope.retreat import Ramp
from firmware_py.guard.envelope.shield import Shield
from firmware_py.guard.envelope.vibration_hold import VibrationHold

UNKNOWN_VIBRATION: Final = 1.01
"""A vibration that is not known counts as this many times what may fill the clearance: the bearing
narrows to safe."""


class Known(NamedTuple):
    """Readings that are OK all together; the shaft power may be missing."""

    oil_C: float
    clearance_um: float
    pressure_bar: float
    power_W: float | None


class EnvelopeInput(NamedTuple):
    """What is measured at one instant.

    Attributes
    ----------
    mean_m, peak_to_peak_m
        Shaft position and the larger axis of its vibration, over the last window.
    displacement_ok, whole
        Both probes are OK and plausible together; the window is full.
    fast_rad_s, slow_rad_s
        Highest and lowest speed that the shaft may have; None: not known.
    readings
        None while a part of them is not OK.
    oil_C
        Oil outlet, None while it is not OK.
    narrow_um
        The smaller of measured and commanded clearance, or the narrowest there is.
    """

    mean_m: tuple[float, float]
    peak_to_peak_m: float
    displacement_ok: bool
    whole: bool
    fast_rad_s: float | None
    slow_rad_s: float
    readings: Known | None
    oil_C: float | None
    narrow_um: float


class Admissible(NamedTuple):
    """Interval of the film's load, and admissible clearances (m); None: not even safe is one."""

    load: LoadInterval
    interval_m: tuple[float, float] | None


class Envelope:
    """Admissible clearances from measurements; thin state around :class:`Shield`.

    Parameters
    ----------
    config
        The guard's.
    """

    def __init__(self, config: Config) -> None:
        self._share = config.limits.clearance_share
        self.shield, self.load = Shield(config), LoadEstimator(config)
        self.vibration = VibrationHold()

    def step(self, seen: EnvelopeInput, announced: Sequence[Ramp], now_ns: int) -> Admissible:
        """Judge one instant; ``announced`` as :meth:`Shield.interval` takes it."""
        p2p_m, narrow_m = seen.peak_to_peak_m, seen.narrow_um * 1e-6
        if not seen.displacement_ok:  # it may be the largest that is admissible, and more
            p2p_m = max(p2p_m, UNKNOWN_VIBRATION * self._share * seen.narrow_um * 1e-6)
        load = self._load(seen, p2p_m, now_ns)
        oil_C, oil = self.load.oil_at(seen.oil_C)
        if seen.fast_rad_s is None:
            return Admissible(load, None)
        if seen.whole and seen.displacement_ok:
            p2p_m = self.vibration.step(p2p_m, narrow_m, seen.fast_rad_s, now_ns)
        interval_m = self.shield.interval(
            seen.fast_rad_s,
            load.low_N,
            load.film_N,
            oil_C,
            p2p_m,
            narrow_m,
            announced,
            oil,
            seen.slow_rad_s,
        )
        return Admissible(load, interval_m)

    def _load(self, seen: EnvelopeInput, p2p_m: float, now_ns: int) -> LoadInterval:
        known = seen.readings
        if known is None or not seen.whole or seen.fast_rad_s is None or not seen.displacement_ok:
            return self.load.declared()
        return self.load.estimate(
            Look(
                now_ns * 1e-9,
                *seen.mean_m,
                p2p_m,
                known.clearance_um * 1e-6,
                seen.fast_rad_s,
                known.oil_C,
                known.power_W,
                known.pressure_bar,
            )
        )
