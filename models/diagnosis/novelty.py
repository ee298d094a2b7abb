"""How unlike everything that was taught a row of features is, and how far it lies from one
machine's own normal.

What the operating point explains is taken out first: a quadratic regression of every feature on
speed, clearance, oil, supply and where the shaft floats, over a scale that itself depends on the
operating point (some watts of zero error matter at 10 W, not at 300 W).  The residuals of a part of
the features are whitened so that scatter within a build has unit covariance and scatter between
builds is diagonal (as in probabilistic linear discriminant analysis, Ioffe 2006): a machine's own
offset then has a closed posterior, one number a direction
(:class:`firmware_py.brain.normal.Normal`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire import film_check, ringing
from firmware_py.acquire.features import FEATURE_NAMES, HIGH_ORDERS
from models.diagnosis.dataset import Dataset, DatasetError

Floats = NDArray[np.float64]

OPERATING: Final = (
    "log_speed_rad_s",
    "log_clearance_100um",
    "oil_outlet_50C",
    "pressure_bar",
    "mean_x_over_clearance",
    "mean_y_over_clearance",
    "contact_eccentricity",
)
"""The operating point, on which all other features are regressed; the last three stand for the
load."""
OPERATING_COLUMNS: Final = np.array([FEATURE_NAMES.index(name) for name in OPERATING])
REACH: Final = 3.0
"""Deviations beyond which the regression is not followed further."""
FARTHEST: Final = 8.0
"""Scales beyond which a residual counts no more."""
RIDGE: Final = 1.0
SCALE_RIDGE: Final = 3.0
PAIRS: Final = np.array([(i, j) for i in range(len(OPERATING)) for j in range(i + 1)]).T

FILM: Final = np.isin(FEATURE_NAMES, film_check.names()[:4])
"""Film, position, power and load against each other: what oil, wear, side loads and a rub change.

They are scaled by their own errors already and stay as they are: a regression on where the shaft
floats would take out that a starved shaft floats where no load of the rig puts it.
"""
ORDERS: Final = np.isin(
    FEATURE_NAMES,
    [
        *(f"log_shaft_{way}_{k}x_m" for way in ("fwd", "bwd") for k in HIGH_ORDERS),
        "contact_2x_film",
        "microphone_2x_rms",
        *(f"{name}_2x_1x" for name in ringing.CHANNELS),
    ],
)
"""Orders of a misaligned coupling and of a shaft that touches."""
POWER: Final = np.isin(FEATURE_NAMES, ["film_power_excess"])
"""The light rub's only trace: friction.  Beside other features of the film it would be diluted."""
RINGING: Final = np.isin(FEATURE_NAMES, ringing.names())
"""How pedestal and motor ring."""
BOLTS: Final = 3
"""Directions of the ringing in which the taught bolts, two of the pedestal and the motor's, move it
most.

A bolt that is no class moves the same modes another way (one on the other side turns the phase
between lift and roll): there it lies far from all that was taught, while in the whole ringing it
drowns.
"""
THIRD: Final = 1.0 / 3.0
"""Where the parts' scales are made alike besides their limits: distances of a third of the limit's
improbability.

A single feature scatters more about its limit than the mean of many; as logs of a probability both
compare.
"""
PARTS: Final = {
    "film": (FILM, None),
    "power": (POWER, None),
    "orders": (ORDERS, None),
    "ringing": (RINGING, None),
    "bolts": (RINGING, BOLTS),
}
"""Features of each part, and in how many discriminant directions they are looked at (None: all)."""


@dataclass(frozen=True)
class Residual:
    """Features without what the operating point explains, in units of their scatter there.

    ``centre``, ``spread`` ``(7,)`` of the operating point; ``mean`` ``(36, F)`` weights of its
    constant, linear and quadratic terms; ``log_scale`` ``(8, F)`` weights of its constant and
    linear terms.
    """

    centre: Floats
    spread: Floats
    mean: Floats
    log_scale: Floats

    @classmethod
    def fit(cls, features: NDArray[np.floating]) -> Residual:
        """Ridge regression on healthy rows; the scale follows the residuals that leave their own
        row out."""
        x = np.asarray(features, np.float64)
        point = x[:, OPERATING_COLUMNS]
        centre, spread = point.mean(axis=0), np.maximum(point.std(axis=0), 1e-9)
        terms = quadratic((point - centre) / spread)
        inverse = np.linalg.inv(terms.T @ terms + RIDGE * _but_the_constant(terms.shape[1]))
        unit = np.maximum(x.std(axis=0), 1e-9)
        mean = inverse @ (terms.T @ (x / unit)) * unit
        leverage = np.minimum(np.einsum("ij,jk,ik->i", terms, inverse, terms), 0.9)
        left = (x - terms @ mean) / (1.0 - leverage)[:, None]
        linear = terms[:, : 1 + len(OPERATING)]
        normal = linear.T @ linear + SCALE_RIDGE * _but_the_constant(linear.shape[1])
        log_scale = np.linalg.solve(normal, linear.T @ np.log(np.abs(left) + 0.01 * unit))
        scaled = left * np.exp(-linear @ log_scale)
        log_scale[0] += np.log(np.maximum(1.4826 * np.median(np.abs(scaled), axis=0), 1e-9))
        plain = x[:, FILM] - x[:, FILM].mean(axis=0)
        mean[:, FILM], log_scale[:, FILM] = 0.0, 0.0
        mean[0, FILM] = x[:, FILM].mean(axis=0)
        log_scale[0, FILM] = np.log(np.maximum(1.4826 * np.median(np.abs(plain), axis=0), 1e-9))
        return cls(centre, spread, mean, log_scale)

    def __call__(self, features: NDArray[np.floating]) -> Floats:
        """Residuals ``(n, F)``."""
        x = np.asarray(features, np.float64)
        terms = quadratic((x[:, OPERATING_COLUMNS] - self.centre) / self.spread)
        scaled = (x - terms @ self.mean) * np.exp(-terms[:, : 1 + len(OPERATING)] @ self.log_scale)
        return np.clip(scaled, -FARTHEST, FARTHEST)


def quadratic(u: Floats) -> Floats:
    """Constant, linear and quadratic terms of ``u`` ``(n, 7)`` within :data:`REACH`, ``(n,
    36)``."""
    held = np.clip(u, -REACH, REACH)
    return np.column_stack([np.ones(len(u)), held, held[:, PAIRS[0]] * held[:, PAIRS[1]]])


def _but_the_constant(size: int) -> Floats:
    """Ridge on every term but the first."""
    ridge = np.eye(size)
    ridge[0, 0] = 0.0
    return ridge


@dataclass(frozen=True)
class Part:
    """Distance to the nearest of the taught centres: of healthy machines and of each fault at each
    severity.

    ``whitening`` ``(F, k)``: ``residual @ whitening`` has unit covariance within a build about the
    centres ``(K, k)``, the first of them healthy, and the variances ``between`` ``(k,)`` between
    builds; features that are not looked at have zero rows.  ``limit`` is what all but a few inner
    rows keep, ``exponent`` turns distance into improbability.
    """

    whitening: Floats
    centres: Floats
    between: Floats
    limit: float = 1.0
    exponent: float = 1.0

    @classmethod
    def fit(
        cls, columns: NDArray[np.bool_], directions: int | None, residual: Floats, data: Dataset
    ) -> Part:
        """Covariances within and between builds (shrunk, Ledoit and Wolf 2004); limits are still to
        be set.

        Parameters
        ----------
        columns
            Features of the part, ``(F,)``.
        directions
            How many discriminant directions of the centres are kept (Fisher 1936, Rao 1948); None:
            no such choice.
        """
        from sklearn.covariance import ledoit_wolf

        used = np.flatnonzero(columns & (residual.std(axis=0) > 1e-6))
        labels = np.column_stack([data.kind, np.where(data.kind > 0, data.severity, 0.0)])
        _, label_of = np.unique(labels, axis=0, return_inverse=True)
        builds, build_of = np.unique(data.group, return_inverse=True)
        count_of = np.bincount(label_of.reshape(-1))
        means = np.array(
            [residual[label_of == k][:, used].mean(axis=0) for k in range(len(count_of))]
        )
        about = residual[:, used] - means[label_of]
        healthy = about[data.kind == 0]
        build_of, count = (
            build_of[data.kind == 0],
            np.bincount(build_of[data.kind == 0], minlength=len(builds)),
        )
        if not (count > 1).any():
            raise DatasetError(
                "no build has two healthy recordings: scatter between builds cannot be told from "
                "scatter within; "
                "record healthy builds at several operating points"
            )
        own = np.array([healthy[build_of == b].mean(axis=0) for b in np.flatnonzero(count > 1)])
        within, _ = ledoit_wolf(about, assume_centered=True)
        values, vectors = np.linalg.eigh(within)
        white = vectors / np.sqrt(values)
        if directions is not None:
            apart = (means - np.average(means, axis=0, weights=count_of)) @ white
            white = white @ np.linalg.svd(np.sqrt(count_of)[:, None] * apart)[2][:directions].T
        spread, turn = np.linalg.eigh(white.T @ np.atleast_2d(np.cov(own.T, bias=True)) @ white)
        whitening = np.zeros((residual.shape[1], white.shape[1]))
        whitening[used] = white @ turn
        between = np.maximum(spread - 1.0 / np.mean(count[count > 1]), 0.0)
        return cls(whitening, means @ white @ turn, between)

    def limited(self, residual: Floats, quantile: float) -> Part:
        """The same with the limit that ``quantile`` of inner residuals keep, and its exponent
        (:data:`THIRD`)."""
        away = self.distance(residual)
        limit, third = np.quantile(away, [quantile, 1.0 - (1.0 - quantile) ** THIRD])
        exponent = math.log(THIRD) / math.log(third / limit) if 0.0 < third < limit else 1.0
        return replace(self, limit=float(limit), exponent=exponent)

    def distance(self, residual: Floats) -> Floats:
        """Novelty ``(n,)`` of residuals, about the log of their probability over that of the limit:
        there 1."""
        white = residual @ self.whitening
        found = [np.sqrt(np.mean((white - centre) ** 2, axis=1)) for centre in self.centres]
        return np.asarray((np.min(found, axis=0) / self.limit) ** self.exponent)


def fit_novelty(
    train: Dataset, inner: Dataset, quantile: float
) -> tuple[Residual, tuple[Part, ...]]:
    """What the operating point explains, and the parts whose largest distance is the novelty score.

    Parameters
    ----------
    quantile
        Share of the inner rows that each part keeps.
    """
    residual = Residual.fit(train.features[train.kind == 0])
    rows, inner_rows = residual(train.features), residual(inner.features)
    return residual, tuple(
        Part.fit(*part, rows, train).limited(inner_rows, quantile) for part in PARTS.values()
    )


def fleet(parts: Sequence[Part], healthy: Floats, quantile: float) -> dict[str, object]:
    """What a device needs to know of the fleet (:class:`firmware_py.brain.normal.Prior`).

    Parameters
    ----------
    healthy
        Residuals of healthy inner rows; ``quantile`` of them stay within the limits of healthy
        alone.
    """
    away = [
        np.sqrt(np.mean((healthy @ p.whitening - p.centres[0]) ** 2 / (1.0 + p.between), axis=1))
        for p in parts
    ]
    return {
        "parts": list(PARTS),
        "columns": [len(part.between) for part in parts],
        "between": [float(f"{value:.4g}") for part in parts for value in part.between],
        "limits": [float(np.quantile(a, quantile)) for a in away],
        "typical": [float(np.median(a)) for a in away],
    }


def novelty(parts: Sequence[Part], residual: Floats) -> Floats:
    """The largest of the parts' distances ``(n,)``: above 1 a row is unlike what was taught."""
    return np.asarray(np.max([part.distance(residual) for part in parts], axis=0))
