"""Telling unbalance from runout, and a growing unbalance from a steady one, while the machine runs.

The forward first order that the probes report is ``z = r + g U``: runout ``r`` is the same at every
speed and clearance, the response ``g`` to a unit of unbalance ``U`` is known from the film model
and changes with both. A Kalman filter over three complex numbers (phases from the mark), runout,
unbalance and its rate, separates them as the operating point moves; until it has moved, the priors
share the signal between them and the covariance says so.  After the slow-roll procedure the runout
is known but for a residual.  A change at a fixed operating point goes to ``U``: runout does not
change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.intervals import GROWING_SIGMAS
from firmware_py.machine import Machine
from firmware_py.machine.probes import as_built, probe_errors, probe_noise_m

UNBALANCE_PRIOR: Final = 0.7
"""Root mean square of a healthy build's unbalance, in normal unbalances."""
RUNOUT_DRIFT_M_S: Final = 2e-8
"""Random walk per root second."""
UNBALANCE_DRIFT: Final = 0.02
RATE_DRIFT: Final = 0.2
"""Random walks per root second of the unbalance and of its rate, in normal unbalances: faults
grow."""
FIRST_ORDER_NOISE: Final = 2.0
"""Deviation of a window's forward first order over the noise of a probe's sample: orders beside
it, and the mark."""

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Imbalance:
    """Runout (m) and unbalance (kg m), complex, phases from the mark.

    ``size_kg_m`` is the typical magnitude of the unbalance, between the mode and the mean of its
    Rice distribution, ``size_sd_kg_m`` its deviation; ``rate_kg_m_s`` and ``rate_sd_kg_m_s`` are of
    the magnitude.
    """

    runout_m: complex
    unbalance_kg_m: complex
    size_kg_m: float
    size_sd_kg_m: float
    rate_kg_m_s: float
    rate_sd_kg_m_s: float

    @property
    def growing(self) -> bool:
        """Whether the magnitude changes at a clear rate."""
        return abs(self.rate_kg_m_s) > GROWING_SIGMAS * self.rate_sd_kg_m_s > 0.0


class ImbalanceState(msgspec.Struct):
    """Mean (3,) and covariance (3, 3) of runout (m), unbalance and its rate (in normal unbalances),
    and their time."""

    mean: Complexes
    covariance: Complexes
    t_ns: int | None = None


class ImbalanceFilter:
    """Kalman filter of runout, unbalance and its rate.

    Parameters
    ----------
    machine
        Its probes: the runout before anything was seen, and noise.  Its unbalance when healthy:
        scale of the prior and of the drifts.  The probes' gain as built stands for the error of the
        model's response too.
    """

    def __init__(self, machine: Machine) -> None:
        self._normal_kg_m = max(machine.rotor.unbalance_normal_kg_m, 1e-7)
        self._noise_m = FIRST_ORDER_NOISE * probe_noise_m(machine)
        self._gain_share = as_built(machine).gain_share
        runout_m = probe_errors(machine).forward_runout_m
        prior = np.diag([runout_m**2, UNBALANCE_PRIOR**2, 0.0]).astype(np.complex128)
        self.state = ImbalanceState(np.zeros(3, np.complex128), prior)

    @property
    def present(self) -> Imbalance:
        """The present estimate."""
        return self.ahead(0.0)

    def at(self, t_ns: int, seconds: float = 0.0) -> Imbalance:
        """The estimate ``seconds`` after ``t_ns``, if the rate holds."""
        since_ns = self.state.t_ns
        return self.ahead(
            seconds + (0.0 if since_ns is None else max(0.0, (t_ns - since_ns) * 1e-9))
        )

    def ahead(self, seconds: float) -> Imbalance:
        """The estimate ``seconds`` on, if a clear rate holds; one that is not clear is taken for
        none."""
        runout, unbalance, rate = self.state.mean.tolist()
        covariance = self.state.covariance
        now_sd, rate_sd = np.sqrt(np.diag(covariance).real[1:]).tolist()
        outward, outward_sd = (
            (rate * unbalance.conjugate()).real / max(abs(unbalance), 1e-9),
            rate_sd / math.sqrt(2.0),
        )
        sd = now_sd
        if abs(outward) > GROWING_SIGMAS * outward_sd:
            f = _transition(seconds)
            unbalance, sd = (
                unbalance + seconds * rate,
                math.sqrt((f @ covariance @ f.T)[1, 1].real),
            )
        size, scale = math.hypot(abs(unbalance), 0.5 * now_sd), self._normal_kg_m
        return Imbalance(
            runout,
            unbalance * scale,
            size * scale,
            sd / math.sqrt(2.0) * scale,
            outward * scale,
            outward_sd * scale,
        )

    def step(self, t_ns: int, forward_m: complex, response_m_per_kg_m: complex) -> Imbalance:
        """Take the forward first order ``forward_m`` of a window and the model's response at its
        operating point."""
        state = self.state
        elapsed_s = 0.0 if state.t_ns is None else max(0.0, (t_ns - state.t_ns) * 1e-9)
        state.t_ns = t_ns
        f = _transition(elapsed_s)
        drift = np.diag([RUNOUT_DRIFT_M_S**2, UNBALANCE_DRIFT**2, RATE_DRIFT**2]) * elapsed_s
        mean, prior = f @ state.mean, f @ state.covariance @ f.T + drift
        row = np.array([1.0, response_m_per_kg_m * self._normal_kg_m, 0.0])
        innovation = forward_m - complex(row @ mean)
        variance = (
            float((row @ prior @ row.conj()).real)
            + self._noise_m**2
            + (self._gain_share * abs(row[1] * mean[1])) ** 2
        )
        gain = prior @ row.conj() / variance
        state.mean = mean + gain * innovation
        covariance = prior - np.outer(gain, row @ prior)
        state.covariance = 0.5 * (covariance + covariance.conj().T)
        return self.present


def _transition(seconds: float) -> NDArray[np.float64]:
    f = np.eye(3)
    f[1, 2] = seconds
    return f
