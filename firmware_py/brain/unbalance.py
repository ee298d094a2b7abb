"""Telling unbalance from runout: a slow-roll compensation that works while the machine runs.

The forward first order that the probes report is ``z = r + g U``: runout ``r`` is the same at every speed and
clearance, the response ``g`` to a unit of unbalance ``U`` is known from the film model and changes with both.
A Kalman filter over the two complex numbers (phases from the mark) separates them as the operating point
moves; until it has moved, the priors share the signal between them and the covariance says so.  A change at
a fixed operating point goes to ``U``: runout does not change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

RUNOUT_PRIOR_M: Final = 4e-6
"""Root mean square of the runout's forward amplitude before anything was seen."""
RUNOUT_DRIFT_M_S: Final = 2e-8
"""Random walk per root second."""
UNBALANCE_DRIFT_SHARE: Final = 0.15
"""Random walk of the unbalance per root second, as a share of the normal unbalance: faults grow."""
NOISE_M: Final = 2e-7
GAIN_ERROR: Final = 0.08
"""Error of the model's response and of the probes' gain."""

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Imbalance:
    """Runout (m) and unbalance (kg m), complex, phases from the mark; ``sd_kg_m`` is the latter's deviation."""

    runout_m: complex
    unbalance_kg_m: complex
    sd_kg_m: float

    @property
    def size_kg_m(self) -> float:
        """Expected magnitude of the unbalance (of a Rice distribution, to a few percent)."""
        return math.hypot(abs(self.unbalance_kg_m), 0.5 * math.sqrt(math.pi) * self.sd_kg_m)

    @property
    def size_sd_kg_m(self) -> float:
        """Standard deviation of the magnitude: the radial half of the complex deviation."""
        return self.sd_kg_m / math.sqrt(2.0)


class ImbalanceFilter:
    """Kalman filter of runout and unbalance.

    Parameters
    ----------
    normal_kg_m
        Unbalance of a healthy machine: scale of the prior and of the drift.
    """

    def __init__(self, normal_kg_m: float) -> None:
        self._normal_kg_m = max(normal_kg_m, 1e-7)
        self._mean: Complexes = np.zeros(2, np.complex128)
        self._covariance: Complexes = np.diag([RUNOUT_PRIOR_M**2, 1.0]).astype(np.complex128)
        self._t_ns: int | None = None

    @property
    def state(self) -> Imbalance:
        """The present estimate."""
        runout, unbalance = self._mean.tolist()
        deviation = float(np.sqrt(self._covariance[1, 1].real))
        return Imbalance(runout, unbalance * self._normal_kg_m, deviation * self._normal_kg_m)

    def step(self, t_ns: int, forward_m: complex, response_m_per_kg_m: complex) -> Imbalance:
        """Take the forward first order ``forward_m`` of a window and the model's response at its operating point."""
        elapsed_s = 0.0 if self._t_ns is None else max(0.0, (t_ns - self._t_ns) * 1e-9)
        self._t_ns = t_ns
        drift = np.diag([RUNOUT_DRIFT_M_S**2, UNBALANCE_DRIFT_SHARE**2]) * elapsed_s
        prior = self._covariance + drift
        row = np.array([1.0, response_m_per_kg_m * self._normal_kg_m])
        innovation = forward_m - complex(row @ self._mean)
        variance = float((row @ prior @ row.conj()).real) + NOISE_M**2 + (GAIN_ERROR * abs(row[1] * self._mean[1])) ** 2
        gain = prior @ row.conj() / variance
        self._mean = self._mean + gain * innovation
        covariance = prior - np.outer(gain, row @ prior)
        self._covariance = 0.5 * (covariance + covariance.conj().T)
        return self.state
