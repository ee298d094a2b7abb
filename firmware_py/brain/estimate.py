"""Synchronising the film model with the running machine: load and viscosity from what is measured now.

Weighted least squares on mean shaft position and shaft power, with priors from the declared load range and
the oil's temperature.  The unbalance comes from its own filter (:mod:`firmware_py.brain.unbalance`).

What cannot be told apart: in an isothermal plain film the position fixes only viscosity / (load x
clearance^2).  The shaft power separates the two where friction is large against the channel's error; at low
speed the oil-temperature prior does.  A zero error of the probes reads as load (its declared size is counted), a wrong
clearance as viscosity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.film import Film, Points
from firmware_py.config import Config

Floats = NDArray[np.float64]

ZERO_ERROR_M: Final = 2e-6
PROBE_GAIN_ERROR: Final = 0.03
POWER_ERROR_W: Final = 5.0
POWER_MODEL_ERROR: Final = 0.05
TEMPERATURE_ERROR_C: Final = 3.0
VISCOSITY_SPREAD: Final = 0.1
SIGMA_90: Final = 1.645
"""Half-width of a 90 % interval in standard deviations."""

_ITERATIONS: Final = 4
_LOG_STEP: Final = 0.02


@dataclass(frozen=True, slots=True)
class Measured:
    """What one window and its readings say about the bearing, SI."""

    speed_rad_s: float
    clearance_m: float
    mean_x_m: float
    mean_y_m: float
    peak_to_peak_m: float
    shaft_power_W: float
    oil_outlet_C: float
    shaft_power_sd_W: float = POWER_ERROR_W


@dataclass(frozen=True, slots=True)
class Estimate:
    """Synchronised load and viscosity, lognormal.

    Attributes
    ----------
    log_covariance
        Shape (2, 2): of ``ln load`` and ``ln viscosity``.
    """

    load_N: float
    viscosity_Pa_s: float
    log_covariance: Floats

    @property
    def load_interval_N(self) -> tuple[float, float, float]:
        """90 % interval: low, expected, high."""
        return lognormal(self.load_N, float(np.sqrt(self.log_covariance[0, 0])))

    @property
    def viscosity_interval_Pa_s(self) -> tuple[float, float, float]:
        """90 % interval: low, expected, high."""
        return lognormal(self.viscosity_Pa_s, float(np.sqrt(self.log_covariance[1, 1])))


def lognormal(value: float, log_sd: float) -> tuple[float, float, float]:
    """90 % interval of a lognormal quantity with median ``value``."""
    spread = float(np.exp(SIGMA_90 * log_sd))
    return value / spread, value, value * spread


class Synchroniser:
    """Finds the film model's parameters that explain a window.

    Parameters
    ----------
    film
        The surrogate of this bearing.
    config
        For the declared load range and the oil.
    """

    def __init__(self, film: Film, config: Config) -> None:
        self._film = film
        self._oil = config.oil
        low, high = np.log([config.operating.load_min_N, config.operating.load_max_N])
        self._prior_load = 0.5 * (low + high)
        self._prior_load_sd = 0.5 * (high - low) / SIGMA_90 + 0.1

    def step(self, measured: Measured) -> Estimate:
        """The parameters behind ``measured``: Gauss-Newton from the priors; four iterations, three equilibria each."""
        prior = np.array([self._prior_load, np.log(self._oil.viscosity_Pa_s(measured.oil_outlet_C))])
        slope = self._oil.viscosity_slope_per_K * TEMPERATURE_ERROR_C
        information = np.diag([self._prior_load_sd**-2, 1.0 / (slope**2 + VISCOSITY_SPREAD**2)])
        observed, deviation = _observed(measured)
        theta, start_m = prior, None
        for _ in range(_ITERATIONS):
            predicted, sensitivity, start_m = self._predict(theta, measured, start_m)
            weighted = sensitivity / deviation[:, None]
            normal = weighted.T @ weighted + information
            gradient = weighted.T @ ((observed - predicted) / deviation) + information @ (prior - theta)
            theta = theta + np.clip(np.linalg.solve(normal, gradient), -0.7, 0.7)
        covariance = np.asarray(np.linalg.inv(normal), np.float64)
        return Estimate(float(np.exp(theta[0])), float(np.exp(theta[1])), covariance)

    def _predict(self, theta: Floats, measured: Measured, start_m: Floats | None) -> tuple[Floats, Floats, Floats]:
        """Position and power (3,) at ``theta``, their derivatives (3, 2) by logarithm, and the positions (3, 2)."""
        shifted = np.exp(theta + _LOG_STEP * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        points = points_at(measured, shifted)
        position, _, torque = self._film.equilibrium(points, start_m)
        values = np.column_stack([position, torque * points.speed_rad_s])
        return values[0], (values[1:] - values[0]).T / _LOG_STEP, position


def _observed(measured: Measured) -> tuple[Floats, Floats]:
    """Mean x, mean y, power, and their standard deviations."""
    values = np.array([measured.mean_x_m, measured.mean_y_m, measured.shaft_power_W])
    position = np.hypot(ZERO_ERROR_M, PROBE_GAIN_ERROR * np.hypot(measured.mean_x_m, measured.mean_y_m))
    power = np.hypot(measured.shaft_power_sd_W, POWER_MODEL_ERROR * measured.shaft_power_W)
    return values, np.array([position, position, power])


def points_at(measured: Measured, load_viscosity: Floats) -> Points:
    """Operating points at the measured speed and clearance with loads and viscosities (n, 2)."""
    n = len(load_viscosity)
    return Points(np.full(n, measured.speed_rad_s), np.full(n, measured.clearance_m),
                  load_viscosity[:, 1], load_viscosity[:, 0])
