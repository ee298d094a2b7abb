"""The offset of the shaft-power channel, learned while the machine runs.

The channel's error is a constant of the sensor (1 % of its 500 W range) and drowns the friction of a slow
shaft.  Reported power is ``b + k P``: ``P`` is what the film model expects from position and oil temperature
alone, ``k`` the error of that expectation (oil, build), ``b`` the channel's offset.  A Kalman filter over
both separates them as the operating point moves.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

OFFSET_PRIOR_W: Final = 3.0
"""Deviation of an offset that is even between -5 and 5 W."""
FACTOR_PRIOR: Final = 0.12
FACTOR_DRIFT: Final = 0.01
"""Random walk of the factor per root second."""
NOISE_W: Final = 0.3
NOISE_SHARE: Final = 0.03


class PowerFilter:
    """Kalman filter of the offset (W) and the factor."""

    def __init__(self) -> None:
        self._mean: NDArray[np.float64] = np.array([0.0, 1.0])
        self._covariance: NDArray[np.float64] = np.diag([OFFSET_PRIOR_W**2, FACTOR_PRIOR**2])
        self._t_ns: int | None = None

    @property
    def offset_W(self) -> float:
        """Expected offset of the channel."""
        return float(self._mean[0])

    @property
    def offset_sd_W(self) -> float:
        """Its standard deviation."""
        return math.sqrt(float(self._covariance[0, 0]))

    def step(self, t_ns: int, reported_W: float, expected_W: float) -> None:
        """Take the power that a window reported, and what position and oil make expect."""
        elapsed_s = 0.0 if self._t_ns is None else max(0.0, (t_ns - self._t_ns) * 1e-9)
        self._t_ns = t_ns
        prior = self._covariance + np.diag([0.0, FACTOR_DRIFT**2 * elapsed_s])
        row = np.array([1.0, expected_W])
        variance = float(row @ prior @ row) + NOISE_W**2 + (NOISE_SHARE * expected_W) ** 2
        gain = prior @ row / variance
        self._mean = self._mean + gain * (reported_W - float(row @ self._mean))
        covariance = prior - np.outer(gain, row @ prior)
        self._covariance = 0.5 * (covariance + covariance.T)
