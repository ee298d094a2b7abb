"""The predictor: what each candidate clearance would bring, with intervals (ISO 13374 PA).

The synchronised film model answers for every candidate at once: equilibrium, friction power, 1X response,
stability.  Intervals come from the parameters' covariance (sigma points) and from declared model errors.
Two filters learn from window to window: unbalance apart from runout, and the offset of the power channel.
Power is drawn towards the measurement at the present clearance as far as that is the more certain.  Speed,
load and oil are held at their present values; the oil's answer to another friction is not followed.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.estimate import SIGMA_90, Estimate, Measured, Synchroniser, points_at
from firmware_py.brain.film import Film, Points, Steady
from firmware_py.brain.power import PowerFilter
from firmware_py.brain.store import Model
from firmware_py.brain.unbalance import ImbalanceFilter
from firmware_py.config import Config

Floats = NDArray[np.float64]

HORIZON_S: Final = 2.0
CANDIDATES: Final = 16
POWER_ERROR: Final = 0.04
PEAK_TO_PEAK_ERROR: Final = 0.15
FILM_ERROR_M: Final = 1e-6
MARGIN_ERROR: Final = 0.02
POWER_IGNORED_W: Final = 1e6
POWER_SCALE: Final = (0.8, 1.25)


@dataclass(frozen=True, slots=True)
class Outlook:
    """Forecast for ``n`` clearances; each quantity has shape (n, 3): low, expected, high.

    ``peak_to_peak_m`` is the shaft's own motion at the probes, without runout; ``residual_m`` is by how much
    the probes report more than that now (runout, harmonics, noise).  ``whirl_margin`` is the damping ratio of
    the least damped mode, ``possible`` (n,) says where the film carries the load at all.
    """

    clearance_m: Floats
    peak_to_peak_m: Floats
    power_W: Floats
    min_film_m: Floats
    whirl_margin: Floats
    possible: NDArray[np.bool_]
    residual_m: float


class Predictor:
    """Surrogate-based predictive model of the running machine.

    Parameters
    ----------
    model
        ``surrogate.onnx``.
    config
        Bearing, rotor, oil, probe angles.
    """

    def __init__(self, model: Model, config: Config) -> None:
        self._film = Film(model.session, config.bearing.journal_radius_m, config.bearing.length_m,
                          config.rotor.effective_mass_at_bearing_kg)
        self._synchroniser = Synchroniser(self._film, config)
        angles = np.radians([channel.angle_deg for channel in config.channel[:2]])
        self._probes = np.column_stack([np.cos(angles), np.sin(angles)])
        self._load_range_N = (config.operating.load_min_N, config.operating.load_max_N)
        bearing = config.bearing
        self._power = PowerFilter()
        self._imbalance = ImbalanceFilter(config.rotor.unbalance_normal_kg_m)
        self.candidates_m: Floats = 1e-6 * np.linspace(bearing.radial_clearance_min_um,
                                                       bearing.radial_clearance_max_um, CANDIDATES)
        self.label = model.label

    def corrected(self, measured: Measured) -> Measured:
        """``measured`` without the known part of the power channel's offset."""
        power_W = max(0.0, measured.shaft_power_W - self._power.offset_W)
        return dataclasses.replace(measured, shaft_power_W=power_W, shaft_power_sd_W=self._power.offset_sd_W)

    def estimate(self, measured: Measured) -> Estimate:
        """Synchronise the model with the machine."""
        return self._synchroniser.step(self.corrected(measured))

    def learn(self, t_ns: int, measured: Measured, forward_m: complex) -> None:
        """Let a window speak about the power channel, and its forward first order about unbalance and runout.

        Parameters
        ----------
        forward_m
            Complex amplitude, phase from the mark.
        """
        blind = self._synchroniser.step(dataclasses.replace(measured, shaft_power_sd_W=POWER_IGNORED_W))
        steady = self._film.steady(points_at(measured, np.array([[blind.load_N, blind.viscosity_Pa_s]])))
        self._power.step(t_ns, measured.shaft_power_W, float(steady.power_W[0]))
        x, y = steady.response_m_per_kg_m[0].tolist()
        self._imbalance.step(t_ns, forward_m, 0.5 * (x + 1j * y))

    @property
    def unbalance_interval_kg_m(self) -> tuple[float, float, float]:
        """90 % interval: low, expected, high."""
        size, half = self._imbalance.state.size_kg_m, SIGMA_90 * self._imbalance.state.size_sd_kg_m
        return max(0.0, size - half), size, size + half

    def forecast(self, measured: Measured, estimate: Estimate, clearances_m: Floats) -> Outlook:
        """What the clearances ``clearances_m`` (n,) would bring."""
        every = np.append(clearances_m, measured.clearance_m)
        sigma = _sigma_points(estimate)
        sigma[:, 0] = np.clip(sigma[:, 0], *self._load_range_N)
        k = len(sigma)
        points = Points(np.full(k * len(every), measured.speed_rad_s), np.repeat(every, k),
                        np.tile(sigma[:, 1], len(every)), np.tile(sigma[:, 0], len(every)))
        return self._outlook(measured, every, points, self._film.steady(points))

    def _outlook(self, measured: Measured, every: Floats, points: Points, steady: Steady) -> Outlook:
        shape = (len(every), -1)
        imbalance = self._imbalance.state
        unbalance = np.full(len(points.load_N), imbalance.size_kg_m)
        motion = 2.0 * np.abs(steady.response_m_per_kg_m @ self._probes.T).max(axis=1) * unbalance
        power = _spread(steady.power_W.reshape(shape), POWER_ERROR, 0.0)
        power *= self._power_scale(measured, float(power[-1, 1]))
        uncertain = math.hypot(PEAK_TO_PEAK_ERROR, imbalance.size_sd_kg_m / imbalance.size_kg_m)
        swing = _spread(motion.reshape(shape), uncertain, 0.0)
        film = _spread(steady.min_film_m(points.clearance_m, unbalance).reshape(shape), 0.05, FILM_ERROR_M)
        margin = _spread(steady.damping_ratio.reshape(shape), 0.0, MARGIN_ERROR)
        possible = np.asarray(steady.converged.reshape(shape).all(axis=1))
        residual_m = max(0.0, measured.peak_to_peak_m - float(swing[-1, 1]))
        return Outlook(every[:-1], np.maximum(swing[:-1], 0.0), power[:-1], film[:-1], margin[:-1], possible[:-1],
                       residual_m)

    def _power_scale(self, measured: Measured, modelled_W: float) -> float:
        """Factor that draws the modelled power at the present clearance towards the measured one."""
        measured = self.corrected(measured)
        trust = 1.0 / (1.0 + (measured.shaft_power_sd_W / (POWER_ERROR * modelled_W)) ** 2)
        ratio = 1.0 + trust * (measured.shaft_power_W / modelled_W - 1.0)
        return min(max(ratio, POWER_SCALE[0]), POWER_SCALE[1])


def _sigma_points(estimate: Estimate) -> Floats:
    """Load and viscosity (5, 2): expected, and one 90 % half-width along each column of the covariance's root."""
    root = SIGMA_90 * np.linalg.cholesky(estimate.log_covariance)
    centre = np.log([estimate.load_N, estimate.viscosity_Pa_s])
    return np.asarray(np.exp(centre + np.concatenate([np.zeros((1, 2)), root.T, -root.T])))


def _spread(values: Floats, relative: float, absolute: float) -> Floats:
    """(n, 3) low, expected, high from the five sigma points (n, 5) and a model error (one deviation)."""
    expected = values[:, 0]
    reach = 0.5 * (values[:, 1:3] - values[:, 3:5])
    model = SIGMA_90 * np.hypot(relative * expected, absolute)
    half = np.sqrt(np.sum(reach**2, axis=1) + model**2)
    return np.column_stack([expected - half, expected, expected + half])
