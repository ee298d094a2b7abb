"""By how much the predictor's intervals are stretched so that they cover what they say, per regime.

The factors are found on training episodes (``orbitd train predictor``) by split conformal
prediction: the quantile of errors over predicted deviations (Lei et al. 2018, locally weighted),
one side at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.made_for import Figures, machines_of, misfit
from firmware_py.config import Config
from firmware_py.machine.probes import are_zeroed

Floats = NDArray[np.float64]

REGIMES: Final = ("steady", "ramp", "near_whirl", "fault")
QUANTITIES: Final = ("power_W", "peak_to_peak_m", "min_film_m", "whirl_margin")
NEAR_WHIRL: Final = 0.15
"""Damping ratio below which a forecast counts as near whirl."""
GROWING_SIGMAS: Final = 0.7
"""A rate of unbalance, viscosity or clearance this clear counts as a fault that grows.

The filters allow for fast faults, so their deviations are wide: 97 % of healthy forecasts stay
below 0.6.
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


class FactorsCard(msgspec.Struct, frozen=True):
    """What ``predictor.json`` says about itself; files before it had a card were fitted on
    ``bench``."""

    physics_version: str
    kind: str = "predictor"
    version: str = ""
    status: Literal["provisional", "qualified"] = "provisional"
    rigs: tuple[str, ...] = ("bench",)
    machines: dict[str, dict[str, float | str | tuple[float, float]]] | None = None
    surrogate: str = ""
    """Label of the film surrogate whose forecasts they stretch."""
    commit: str = ""

    @property
    def made_for(self) -> Mapping[str, Figures]:
        """Figures of each machine that they were fitted for."""
        return machines_of(self.rigs) if self.machines is None else self.machines

    def misfit(self, config: Config, physics: tuple[str, ...]) -> str:
        """Why they do not fit the device, which knows these versions of ``physics``; empty: they
        do."""
        wrong = [] if self.kind == "predictor" else [f"kind {self.kind!r}, expected 'predictor'"]
        if self.physics_version not in physics:
            wrong.append(f"physics_version {self.physics_version!r}, this brain knows {physics}")
        if other := misfit("predictor", self.made_for, config.machine):
            wrong.append(other)
        return "; ".join(wrong)


def state_of(config: Config) -> str:
    """``zeroed`` after the slow-roll and zero procedure of the probes, else ``as_built``."""
    return "zeroed" if are_zeroed(config.machine) else "as_built"


def sigma_points(mean: Floats, covariance: Floats) -> Floats:
    """(7, 3): expected, and one deviation along each column of the covariance's root."""
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(mean)))
    return np.asarray(mean + np.concatenate([np.zeros((1, len(mean))), root.T, -root.T]))


def deviation_of(values: Floats, model: Floats) -> Floats:
    """Standard deviation (n,) from the seven sigma points (n, 7) and a model error (n,)."""
    reach = 0.5 * (values[:, 1:4] - values[:, 4:7])
    return np.asarray(np.sqrt(np.sum(reach**2, axis=1) + model**2))


def interval(expected: Floats, deviation: Floats, factors: list[tuple[float, float]]) -> Floats:
    """(n, 3) low, expected, high."""
    low, high = np.array(factors).T
    return np.column_stack([expected - low * deviation, expected, expected + high * deviation])
