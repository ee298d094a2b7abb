"""By how much the predictor's intervals are stretched so that they cover what they say, per regime.

The factors are found on training episodes (``orbitd train predictor``) by split conformal prediction: the
quantile of errors over predicted deviations (Lei et al. 2018, locally weighted), one side at a time.
"""

from __future__ import annotations

from typing import Final

import msgspec

REGIMES: Final = ("steady", "ramp", "near_whirl", "fault")
QUANTITIES: Final = ("power_W", "peak_to_peak_m", "min_film_m", "whirl_margin")
NEAR_WHIRL: Final = 0.15
"""Damping ratio below which a forecast counts as near whirl."""
GROWING_SIGMAS: Final = 3.0
"""A rate of unbalance, viscosity or clearance this clear counts as a fault that grows."""
SIGMA_90: Final = 1.645
"""Half-width of a 90 % interval in standard deviations."""


class IntervalFactors(msgspec.Struct, frozen=True):
    """Deviations below and above the expected value, by regime and quantity; without a model file the Gaussian's."""

    factors: dict[str, dict[str, tuple[float, float]]] = {}
    physics_version: str = ""

    def of(self, regime: str, quantity: str) -> tuple[float, float]:
        """Low and high factor."""
        return self.factors.get(regime, {}).get(quantity, (SIGMA_90, SIGMA_90))
