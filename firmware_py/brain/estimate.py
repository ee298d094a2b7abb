"""Synchronising the film model with the running machine: load, viscosity and unbalance from one window.

Weighted least squares on mean shaft position and shaft power, with priors from the declared load range and
the oil's temperature; the unbalance follows from the forward 1X amplitude.

What cannot be told apart: in an isothermal plain film the position fixes only viscosity / (load x
clearance^2).  The shaft power (error 5 W) separates the two where friction is large; at low speed the
oil-temperature prior does.  A zero error of the probes reads as load, runout as unbalance, a wrong clearance
as viscosity; the covariance counts the declared size of the first and third, the runout not.
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
AMPLITUDE_ERROR_M: Final = 3e-7
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
    forward_1x_m: float
    peak_to_peak_m: float
    shaft_power_W: float
    oil_outlet_C: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """Synchronised parameters; load, viscosity and unbalance are lognormal.

    Attributes
    ----------
    log_covariance
        Shape (2, 2): of ``ln load`` and ``ln viscosity``.
    log_unbalance_sd
        Standard deviation of ``ln unbalance``.
    """

    load_N: float
    viscosity_Pa_s: float
    unbalance_kg_m: float
    log_covariance: Floats
    log_unbalance_sd: float

    def interval(self, name: str) -> tuple[float, float, float]:
        """90 % interval (low, expected, high) of ``load_N``, ``viscosity_Pa_s`` or ``unbalance_kg_m``."""
        deviations = {"load_N": float(np.sqrt(self.log_covariance[0, 0])),
                      "viscosity_Pa_s": float(np.sqrt(self.log_covariance[1, 1])),
                      "unbalance_kg_m": self.log_unbalance_sd}
        value, spread = float(getattr(self, name)), float(np.exp(SIGMA_90 * deviations[name]))
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
        theta = prior
        for _ in range(_ITERATIONS):
            predicted, sensitivity = self._predict(theta, measured)
            weighted = sensitivity / deviation[:, None]
            normal = weighted.T @ weighted + information
            gradient = weighted.T @ ((observed - predicted) / deviation) + information @ (prior - theta)
            theta = theta + np.clip(np.linalg.solve(normal, gradient), -0.7, 0.7)
        covariance = np.asarray(np.linalg.inv(normal), np.float64)
        unbalance, spread = self._unbalance(theta, measured)
        return Estimate(float(np.exp(theta[0])), float(np.exp(theta[1])), unbalance, covariance, spread)

    def _predict(self, theta: Floats, measured: Measured) -> tuple[Floats, Floats]:
        """Position and power (3,) at ``theta``, and their derivatives (3, 2) by logarithm."""
        shifted = np.exp(theta + _LOG_STEP * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        points = _points(measured, shifted)
        position, _, torque = self._film.equilibrium(points)
        values = np.column_stack([position, torque * points.speed_rad_s])
        return values[0], (values[1:] - values[0]).T / _LOG_STEP

    def _unbalance(self, theta: Floats, measured: Measured) -> tuple[float, float]:
        """Unbalance whose forward 1X response is the measured one, and the deviation of its logarithm."""
        steady = self._film.steady(_points(measured, np.exp(theta)[None, :]))
        x, y = steady.response_m_per_kg_m[0]
        gain = 0.5 * abs(x + 1j * y)
        relative = float(np.hypot(PROBE_GAIN_ERROR, AMPLITUDE_ERROR_M / max(measured.forward_1x_m, 1e-9)))
        return measured.forward_1x_m / max(float(gain), 1e-12), min(relative, 1.0)


def _observed(measured: Measured) -> tuple[Floats, Floats]:
    """Mean x, mean y, power, and their standard deviations."""
    values = np.array([measured.mean_x_m, measured.mean_y_m, measured.shaft_power_W])
    position = np.hypot(ZERO_ERROR_M, PROBE_GAIN_ERROR * np.hypot(measured.mean_x_m, measured.mean_y_m))
    power = np.hypot(POWER_ERROR_W, POWER_MODEL_ERROR * measured.shaft_power_W)
    return values, np.array([position, position, power])


def _points(measured: Measured, load_viscosity: Floats) -> Points:
    n = len(load_viscosity)
    return Points(np.full(n, measured.speed_rad_s), np.full(n, measured.clearance_m),
                  load_viscosity[:, 1], load_viscosity[:, 0])
