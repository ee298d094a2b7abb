"""By how much the predictor's intervals are stretched so that they cover what they say, per regime.

The factors are found on training episodes (``orbitd train predictor``) by split conformal prediction: the
quantile of errors over predicted deviations (Lei et al. 2018, locally weighted), one side at a time.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config

REGIMES: Final = ("steady", "ramp", "near_whirl", "fault")
QUANTITIES: Final = ("power_W", "peak_to_peak_m", "min_film_m", "whirl_margin")
NEAR_WHIRL: Final = 0.15
"""Damping ratio below which a forecast counts as near whirl."""
GROWING_SIGMAS: Final = 0.7
"""A rate of unbalance, viscosity or clearance this clear counts as a fault that grows.

The filters allow for fast faults, so their deviations are wide: 97 % of healthy forecasts stay below 0.6.
"""
SIGMA_90: Final = 1.645
"""Half-width of a 90 % interval in standard deviations."""


class IntervalFactors(msgspec.Struct, frozen=True):
    """Deviations below and above the expected value, by state of the probes, regime and quantity.

    What is not there is the Gaussian's.
    """

    factors: dict[str, dict[str, dict[str, tuple[float, float]]]] = {}

    def of(self, state: str, regime: str, quantity: str) -> tuple[float, float]:
        """Low and high factor."""
        return self.factors.get(state, {}).get(regime, {}).get(quantity, (SIGMA_90, SIGMA_90))


def state_of(config: Config) -> str:
    """``zeroed`` after the slow-roll and zero procedure of the probes, else ``as_built``."""
    return "zeroed" if all(channel.zeroed for channel in config.channel[:2]) else "as_built"
