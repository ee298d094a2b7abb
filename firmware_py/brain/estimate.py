"""Synchronising the film model with the running machine: an extended Kalman filter over readings.

State: the ten parameters of :mod:`firmware_py.brain.measurement` and the rates of viscosity and
clearance, so that starvation and wear are followed and foreseen.  Load moves freely; the errors of
the instruments stay what they are and come to light as the operating point moves.  The model's
error is no white noise: a reading counts for less the sooner it follows the one before.

Source: iterated extended Kalman filter, Bell and Cathey 1993.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.errors import EstimateLostError
from firmware_py.brain.film import Film
from firmware_py.brain.intervals import GROWING_SIGMAS, SIGMA_90
from firmware_py.brain.measurement import (
    CARRIES,
    CLEARANCE,
    CONTACT,
    FILLED,
    GAIN_1,
    GAIN_2,
    LOAD,
    PARAMETERS,
    POWER,
    ROWS,
    UM,
    VISCOSITY,
    ZERO_X,
    ZERO_Y,
    Errors,
    Instruments,
    Measured,
)
from firmware_py.config import Config
from firmware_py.machine.lubricant import viscosity_Pa_s

Floats = NDArray[np.float64]

VISCOSITY_RATE, CLEARANCE_RATE = PARAMETERS, PARAMETERS + 1
STATES: Final = PARAMETERS + 2

LOAD_DRIFT: Final = 0.5
"""Random walk of ``ln`` load per root second."""
VISCOSITY_DRIFT: Final = 0.003
CLEARANCE_DRIFT_UM: Final = 0.05
RATE_DRIFT: Final = (0.03, 0.05)
"""Random walk of the two rates: 1/s, um/s, per root second."""
RATE_MEMORY_S: Final = 30.0
BORE_SINKS: Final = 2.0
"""Wear that widens the clearance by 1 lowers the bore's middle by this (first order over mean of a
small flat)."""
LAG_ERROR_S: Final = 0.02
"""How far the readings are from one moment after they were taken back to it."""
MODEL_MEMORY_S: Final = 1.0
"""Readings within this time share their model error."""
REFUSED_SIGMAS: Final = 4.0
"""A reading further off than this counts for less."""

_HEARD_TO_START: Final = 2
"""Whether the shaft had come to rest shows only by the second reading, which therefore begins
anew."""
_FIRST_ITERATIONS: Final = 8
_ITERATIONS: Final = 1
_STEP_MAX: Final = 0.7
CLEARANCE_LEAST_SHARE: Final = 0.1
"""Of the reported clearance the true one is at least so much, ..."""
FACTOR_MOST: Final = 100.0
"""... the load within the declared range, and the viscosity beside its law, up to this factor: what
needs more to be explained are no readings of this bearing."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Synchronised parameters.

    Attributes
    ----------
    load_N, viscosity_Pa_s, clearance_m
        Expected static load, film viscosity, and true radial clearance.
    log_covariance
        Shape (2, 2): of ``ln`` load and ``ln`` viscosity.
    mean, covariance
        Shapes (12,) and (12, 12): the whole state.
    """

    load_N: float
    viscosity_Pa_s: float
    clearance_m: float
    log_covariance: Floats
    mean: Floats
    covariance: Floats

    @property
    def load_interval_N(self) -> tuple[float, float, float]:
        """90 % interval: low, expected, high."""
        return lognormal(self.load_N, float(np.sqrt(self.log_covariance[0, 0])))

    @property
    def viscosity_interval_Pa_s(self) -> tuple[float, float, float]:
        """90 % interval: low, expected, high."""
        return lognormal(self.viscosity_Pa_s, float(np.sqrt(self.log_covariance[1, 1])))

    @property
    def growing(self) -> NDArray[np.bool_]:
        """Whether viscosity and clearance (2,) change at a rate clearly different from none."""
        deviation = np.sqrt(np.diag(self.covariance)[PARAMETERS:])
        return np.asarray(np.abs(self.mean[PARAMETERS:]) > GROWING_SIGMAS * deviation)

    def ahead(self, seconds: float) -> tuple[Floats, Floats, float]:
        """Mean (3,) and covariance (3, 3) of ``ln`` load, viscosity factor, clearance error (um),
        ``seconds`` on.

        The third is the expected ``ln`` of the film's filled share.

        A rate that is not clear is taken for none: after a change of speed the model's own error
        looks like one.
        """
        f = _transition(seconds)
        mean = self.mean.copy()
        mean[PARAMETERS:] *= self.growing
        mean = f @ mean
        film = slice(CLEARANCE + 1)
        return mean[film], f[film] @ self.covariance @ f[film].T, float(mean[FILLED])


def lognormal(value: float, log_sd: float) -> tuple[float, float, float]:
    """90 % interval of a lognormal quantity with median ``value``."""
    spread = float(np.exp(SIGMA_90 * log_sd))
    return value / spread, value, value * spread


def _transition(seconds: float) -> Floats:
    """Transition (12, 12) over ``seconds``: rates act and fade."""
    f = np.eye(STATES)
    fade = math.exp(-seconds / RATE_MEMORY_S)
    f[VISCOSITY, VISCOSITY_RATE] = f[CLEARANCE, CLEARANCE_RATE] = RATE_MEMORY_S * (1.0 - fade)
    f[FILLED, VISCOSITY_RATE] = f[VISCOSITY, VISCOSITY_RATE] / CARRIES
    f[ZERO_Y, CLEARANCE_RATE] = -BORE_SINKS * f[CLEARANCE, CLEARANCE_RATE]
    f[VISCOSITY_RATE, VISCOSITY_RATE] = f[CLEARANCE_RATE, CLEARANCE_RATE] = fade
    return f


class SynchroniserState(msgspec.Struct):
    """Estimate and what the next reading is held against.

    Attributes
    ----------
    mean, covariance
        Shapes (12,) and (12, 12): the whole state of the filter.
    readings
        How many were learned from.
    last, then
        The newest reading as it came, and taken back to the time of its means.
    start_m
        Equilibria from which the next solution starts, shape (4, 2).
    unbalance_kg_m
        What the orbit's part of a reading is reckoned with.
    """

    mean: Floats
    covariance: Floats
    readings: int = 0
    last: Measured | None = None
    then: Measured | None = None
    start_m: Floats | None = None
    unbalance_kg_m: float = 0.0


class Synchroniser:
    """Finds the film model's parameters that explain the readings so far.

    Parameters
    ----------
    film
        The surrogate of this bearing.
    config
        Declared load range, oil, probes, contact channel.
    """

    def __init__(self, film: Film, config: Config) -> None:
        self._instruments = Instruments(film, config)
        self._clearance_noise_um = config.machine.actuator.position_noise_um
        self._oil = config.machine.lubricant
        errors = Errors.of(config)
        low, high = np.log(
            [config.machine.operating.load_min_N, config.machine.operating.load_max_N]
        )
        self._log_load = float(low), float(high)
        mean = np.zeros(STATES)
        mean[LOAD] = 0.5 * (low + high)
        mean[CLEARANCE] = config.machine.bearing.radial_clearance_offset_um
        deviation = np.zeros(STATES)
        deviation[LOAD] = 0.5 * (high - low) / SIGMA_90 + 0.1
        deviation[VISCOSITY] = errors.log_viscosity(config.machine.lubricant.viscosity_slope_per_K)
        deviation[CLEARANCE] = errors.clearance_um
        deviation[ZERO_X : ZERO_Y + 1] = errors.zero_um
        deviation[GAIN_1 : GAIN_2 + 1] = errors.gain
        deviation[POWER] = errors.power_W
        deviation[CONTACT] = (
            config.machine.contact.film_error_share if config.machine.contact else 0.0
        )
        deviation[VISCOSITY_RATE:] = 1e-4, 1e-3
        self._prior = SynchroniserState(mean, np.diag(deviation**2))
        self.state = msgspec.structs.replace(self._prior)
        drift = np.zeros(STATES)
        drift[[LOAD, VISCOSITY]] = LOAD_DRIFT, VISCOSITY_DRIFT
        drift[VISCOSITY_RATE:] = RATE_DRIFT
        self._drift = np.diag(drift**2)
        worn = np.zeros(STATES)
        worn[[CLEARANCE, ZERO_Y]] = CLEARANCE_DRIFT_UM * np.array([1.0, -BORE_SINKS])
        self._drift += np.outer(worn, worn)

    def clearance_m(self, measured: Measured) -> float:
        """The true radial clearance, m.

        Raises
        ------
        EstimateLostError
            The reported one has left what was estimated by it.
        """
        self._believable(self.state.mean, measured)
        return measured.clearance_m + float(self.state.mean[CLEARANCE]) * UM

    def step(self, measured: Measured) -> Estimate:
        """Take what was measured; the same time again changes nothing.

        Raises
        ------
        EstimateLostError
            It fits no film of this bearing; the estimate begins anew with the next.
        """
        state = self.state
        first, last = state.readings < _HEARD_TO_START, state.last
        elapsed_s = MODEL_MEMORY_S if last is None else (measured.t_ns - last.t_ns) * 1e-9
        if elapsed_s > 0.0:
            if first:
                state.mean, state.covariance = self._prior.mean, self._prior.covariance
            else:
                f = _transition(elapsed_s)
                state.mean = f @ state.mean
                state.covariance = f @ state.covariance @ f.T + elapsed_s * self._drift
            weight = 1.0 if first else max(1.0, MODEL_MEMORY_S / elapsed_s)
            state.then = measured if last is None else measured.at_means(last)
            late = self._late(measured)
            state.readings += self._update(
                state.then, late, weight, _FIRST_ITERATIONS if first else _ITERATIONS
            )
            state.last = measured
        return self._estimate(measured)

    def static_film(self) -> tuple[float, float]:
        """Film (m) at the mean shaft position, and the deviation that the filter predicts of its
        own error there.

        The position is the probes', less their zeros and gains as found so far: the mean of a
        whirling shaft, or of a large orbit, is no equilibrium of the model.  The deviation follows
        from the filter's own noise model: it is no bound that another estimator could not pass.
        Only after a :meth:`step`.
        """
        state = self.state
        assert state.then is not None
        film_m, slopes = self._instruments.static_film(state.mean[:PARAMETERS], state.then)
        spread = slopes @ state.covariance[:PARAMETERS, :PARAMETERS] @ slopes
        variance = spread + (self._clearance_noise_um * UM) ** 2
        return film_m, float(np.sqrt(variance))

    def _update(self, measured: Measured, late: Floats, weight: float, iterations: int) -> bool:
        """Iterated update: each pass linearises at the newest mean; a shaft that whirls (or starts)
        teaches nothing."""
        observed = measured.observed
        used = np.isfinite(observed) & np.array([True, True, True, self._instruments.has_contact])
        state = self.state
        prior, mean, covariance = state.mean, state.mean, state.covariance
        for _ in range(iterations):
            self._believable(mean, measured)
            shown = self._instruments.predict(
                mean[:PARAMETERS], measured, state.unbalance_kg_m, state.start_m
            )
            values, slopes, state.start_m = shown.values, shown.slopes, shown.position_m
            if shown.whirls(measured):
                return False
            noise = self._instruments.noise(values, slopes, measured) + np.diag(late**2)
            noise = weight * noise[np.ix_(used, used)]
            h = np.zeros((int(used.sum()), STATES))
            h[:, :PARAMETERS] = slopes[used]
            rest = (observed - values)[used] - h @ (prior - mean)
            spread = h @ covariance @ h.T
            off = np.abs(rest) / np.sqrt(np.diag(spread + noise))
            noise *= max(1.0, float(off.max()) / REFUSED_SIGMAS) ** 2
            gain = np.linalg.solve(spread + noise, h @ covariance).T
            move = prior + gain @ rest - mean
            move[: VISCOSITY + 1] = np.clip(move[: VISCOSITY + 1], -_STEP_MAX, _STEP_MAX)
            mean = mean + move
        state.mean = mean
        keep = np.eye(STATES) - gain @ h
        state.covariance = keep @ covariance @ keep.T + gain @ noise @ gain.T
        return True

    def _believable(self, mean: Floats, measured: Measured) -> None:
        """Begin anew where the readings drive the parameters to where no bearing is.

        Raises
        ------
        EstimateLostError
            They do; the next reading starts from what the machine is declared to be.
        """
        clearance_m = measured.clearance_m + mean[CLEARANCE] * UM
        load, viscosity = mean[LOAD], abs(mean[VISCOSITY])
        reach = math.log(FACTOR_MOST)
        low, high = self._log_load
        if (
            np.isfinite(mean).all()
            and clearance_m > CLEARANCE_LEAST_SHARE * measured.clearance_m
            and low - reach < load < high + reach
            and viscosity < reach
        ):
            return
        state = self.state
        state.mean, state.covariance = self._prior.mean, self._prior.covariance
        state.readings, state.start_m, state.last = 0, None, measured
        raise EstimateLostError(
            f"the readings fit no film of this bearing (estimated radial clearance "
            f"{clearance_m * 1e6:.1f} um at {measured.clearance_m * 1e6:.1f} um reported, load "
            f"{math.exp(np.clip(load, -99.0, 99.0)):.3g} N); the estimate begins anew"
        )

    def _late(self, measured: Measured) -> Floats:
        """Deviation (4,) of readings that are not quite of one moment: as far as they change
        meanwhile."""
        last = self.state.last
        if last is None:
            return np.zeros(len(ROWS))
        elapsed_s = (measured.t_ns - last.t_ns) * 1e-9
        return np.nan_to_num(LAG_ERROR_S / elapsed_s * (measured.observed - last.observed))

    def _estimate(self, measured: Measured) -> Estimate:
        law = viscosity_Pa_s(self._oil, measured.oil_outlet_C)
        mean, covariance = self.state.mean, self.state.covariance
        return Estimate(
            float(np.exp(mean[LOAD])),
            law * float(np.exp(mean[VISCOSITY])),
            self.clearance_m(measured),
            covariance[:2, :2].copy(),
            mean.copy(),
            covariance.copy(),
        )
