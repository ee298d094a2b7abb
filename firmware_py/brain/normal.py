"""Fit normal, then detect: what is normal for one machine, from its own healthy windows and the
fleet's statistics.

The classifier's output ``normal`` holds features without what the operating point explains,
whitened: within a machine their covariance is one, between machines it is diagonal, ``between``.  A
machine's own offset is then a Gaussian with the fleet's as its prior (empirical Bayes;
probabilistic linear discriminant analysis, Ioffe 2006)::

    offset = sum(rows) between / (1 + n between),    variance = 1 + between / (1 + n between)

with ``n`` counted in *operating points*: what the regression gets wrong at one point, more windows
there do not tell. Without commissioning ``n = 0``: the fleet alone.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.orders import Orders
from firmware_py.acquire.windows import Window
from firmware_py.brain.store import Model
from firmware_py.errors import OrbitdError
from firmware_py.records import Baseline, Belonging, Normal

Floats = NDArray[np.float64]

POINT: Final = ("speed_rad_s", "clearance_m", "eccentricity", "oil_C")
"""What makes an operating point: the columns of every array of points."""
LOG_SPEED_STEP: Final = 0.2
STEPS: Final = np.array([LOG_SPEED_STEP, 10e-6, 0.1, 5.0])
"""Points that share a step of each (log speed, m, 1, K) count as one."""
POINTS_LEAST: Final = 4
FLEET_POINTS: Final = 8.0
"""The fleet's scatter counts as much as so many points of the machine's own."""
QUIET_MARGIN: Final = 1.0
"""Log-odds above what a head said of the healthy machine at most."""
BASELINE_RIDGE: Final = 0.1
REACH: Final = 2.0
"""Spreads beyond which the first order's baseline is not followed."""
MOVED: Final = 4.0
"""First order away from its baseline by so many scatters is not this machine's normal."""
LEAST_SCATTER_UM: Final = 0.1
BASELINE_POINTS: Final = 8
"""Operating points below which the first order's scatter is not known well enough to judge by."""


class NormalError(OrbitdError):
    """A normal state cannot be learned or used; the text names cause, value, limit and next
    step."""


class Prior(msgspec.Struct, frozen=True):
    """The fleet's healthy statistics, from the classifier's metadata.

    ``parts``: names; ``columns`` of each part of the output ``normal``; ``between`` ``(k,)``
    variances between machines; ``limits``: distance of each part that all but the stated share of
    healthy decisions keep, and ``typical``: its median.
    """

    parts: list[str]
    columns: list[int]
    between: list[float]
    limits: list[float]
    typical: list[float]


def prior_of(model: Model | None) -> Prior | None:
    """The fleet's statistics in the classifier's metadata; None when it carries none that fit its
    answers."""
    if model is None or "normal" not in model.session.outputs:
        return None
    try:
        prior = msgspec.convert(model.card.settings.get("normal"), Prior)
    except msgspec.ValidationError:
        return None
    each = {len(prior.parts), len(prior.columns), len(prior.limits), len(prior.typical)}
    return prior if len(each) == 1 and sum(prior.columns) == len(prior.between) else None


@dataclass(frozen=True)
class Detector:
    """Distance of whitened residuals from a normal state, between a typical one and its limit.

    Parameters
    ----------
    prior
        The fleet's statistics.
    normal
        The machine's own state; None for the fleet alone.
    """

    prior: Prior
    normal: Normal | None = None

    def by_part(self, rows: Floats) -> Floats:
        """Distances ``(n, parts)``, 0 at a typical healthy one, 1 at the limit: parts are alike
        before they compete."""
        limits, typical = np.array(self.prior.limits), np.array(self.prior.typical)
        if self.normal is None:
            away = self._distances(rows)
        else:
            normal = self.normal
            away = _distances(
                rows, np.array(normal.offset), np.array(normal.variance), self.prior.columns
            )
            away = away / normal.scale
        return np.asarray((away - typical) / (limits - typical))

    def novelty(self, rows: Floats) -> Floats:
        """The largest distance ``(n,)``."""
        return np.asarray(self.by_part(rows).max(axis=1))

    def _distances(self, rows: Floats) -> Floats:
        between = np.array(self.prior.between)
        return _distances(rows, np.zeros_like(between), 1.0 + between, self.prior.columns)


def fit(
    rows: Floats,
    log_odds: Floats,
    points: Floats,
    first_order_m: NDArray[np.complex128],
    prior: Prior,
    belongs: Belonging,
    minutes: float,
) -> Normal:
    """The normal state of the machine that gave these decisions.

    Parameters
    ----------
    rows
        Output ``normal`` of the classifier, ``(n, k)``.
    log_odds
        Of the heads, ``(n, 4)``.
    points
        Operating points, ``(n, 4)``, columns :data:`POINT`.
    first_order_m
        Forward first order of the orbit without runout, complex, ``(n,)``.
    belongs
        What the rows were made with.

    Raises
    ------
    NormalError
        Numbers that are not finite, or fewer than :data:`POINTS_LEAST` operating points.
    """
    _check_finite(rows, log_odds, points, first_order_m)
    cell, count = cells(points), count_points(points)
    if count < POINTS_LEAST:
        raise NormalError(
            f"{count} operating points in {len(rows)} decisions, at least {POINTS_LEAST} are "
            f"needed: run "
            "the machine at other speeds, loads or clearances, then stop again"
        )
    means = _by_cell(rows, cell)
    offset, variance = posterior(means.sum(axis=0), count, np.array(prior.between))
    return Normal(
        belongs=belongs,
        minutes=minutes,
        decisions=len(rows),
        points=count,
        ranges=ranges(points),
        offset=offset.tolist(),
        variance=variance.tolist(),
        scale=_own_scale(rows, cell, means, prior).tolist(),
        quiet=np.maximum(0.0, log_odds.max(axis=0) + QUIET_MARGIN).tolist(),
        baseline=_baseline(*(_by_cell(values, cell) for values in (points, first_order_m * 1e6))),
    )


def posterior(total: Floats, count: int, between: Floats) -> tuple[Floats, Floats]:
    """Offset and variance of one more row after ``count`` rows that add up to ``total``."""
    share = between / (1.0 + count * between)
    return total * share, 1.0 + share


def operating_point(window: Window, orders: Orders) -> Floats:
    """Speed, clearance, eccentricity and oil, as :data:`POINT`."""
    eccentricity = math.hypot(orders.mean[0], orders.mean[1]) / window.clearance_m
    return np.array([orders.speed_rad_s, window.clearance_m, eccentricity, window.oil_outlet_C])


def cells(points: Floats) -> NDArray[np.intp]:
    """Number of the operating point of every row, counted from 0, ``(n,)``."""
    logs = np.column_stack([np.log(points[:, :1]), points[:, 1:]])
    _, cell = np.unique(np.floor(logs / STEPS), axis=0, return_inverse=True)
    return np.asarray(cell.reshape(-1), np.intp)


def count_points(points: Floats) -> int:
    """How many operating points there are among the rows of ``points``."""
    return int(cells(points).max(initial=-1)) + 1


def speed_steps(speeds_rad_s: Floats) -> int:
    """Steps of speed that occur."""
    return (
        len(np.unique(np.floor(np.log(speeds_rad_s) / LOG_SPEED_STEP))) if len(speeds_rad_s) else 0
    )


def ranges(points: Floats) -> dict[str, tuple[float, float]]:
    """Least and largest value of every column of ``points``."""
    return {
        name: (float(points[:, i].min()), float(points[:, i].max())) for i, name in enumerate(POINT)
    }


def baseline_at(baseline: Baseline, point: Floats) -> complex | None:
    """Healthy first order at ``point`` ``(4,)``, um; None where the machine was not commissioned
    near."""
    away = (_coordinates(point[None, :]) - baseline.centre) / baseline.spread
    if np.abs(away).max() > REACH:
        return None
    return complex(_terms(away)[0] @ [complex(*w) for w in baseline.weights_um])


def first_order_distance(normal: Normal, point: Floats, first_order_m: complex) -> dict[str, float]:
    """How far the first order lies from its baseline, 1 at :data:`MOVED` scatters; nothing where
    that is not known."""
    base_um = baseline_at(normal.baseline, point)
    if base_um is None or normal.points < BASELINE_POINTS:
        return {}
    return {
        "first_order": abs(first_order_m * 1e6 - base_um) / (MOVED * normal.baseline.scatter_um)
    }


EXPLAINED: Final = {
    "configuration": " (other figures of sampling, channels, bearing, lubricant, contact circuit, "
    "the rotor's mass, windage and power error or the oil thermometer's error; or a version whose "
    "features did not rest on all of these)"
}
"""What a difference in a field of :class:`~firmware_py.records.Belonging` means."""


def check_belongs(normal: Normal, device: Belonging) -> None:
    """Refuse the state of another model, feature set, rig or configuration.

    Raises
    ------
    NormalError
        Names everything that differs.
    """
    found, now = msgspec.structs.asdict(normal.belongs), msgspec.structs.asdict(device)
    wrong = [
        f"{what} {found[what][:12]!r}, this device has {now[what][:12]!r}{EXPLAINED.get(what, '')}"
        for what in found
        if found[what] != now[what]
    ]
    if wrong:
        raise NormalError(
            f"the machine's normal state was learned with {'; '.join(wrong)}: commission again "
            "(`orbitd commission start`), or forget it (`orbitd commission forget`)"
        )


def digest(normal: Normal) -> str:
    """Short name of a state, by all of its content but when it was made."""
    return hashlib.sha256(
        msgspec.msgpack.encode(msgspec.structs.replace(normal, made_unix_ns=0))
    ).hexdigest()[:12]


def _distances(rows: Floats, offset: Floats, variance: Floats, columns: Sequence[int]) -> Floats:
    """Root mean square of the standardised residuals of each part, ``(n, parts)``."""
    square = (rows - offset) ** 2 / variance
    ends = np.cumsum(columns)
    means = [
        square[:, end - size : end].mean(axis=1) for end, size in zip(ends, columns, strict=True)
    ]
    return np.asarray(np.sqrt(np.column_stack(means)))


def _own_scale(rows: Floats, cell: NDArray[np.intp], means: Floats, prior: Prior) -> Floats:
    """Median distance of each part from the state that the *other* points give, over the fleet's;
    shrunk to 1."""
    between, count, away = np.array(prior.between), len(means), []
    for k in range(count):
        offset, variance = posterior(means.sum(axis=0) - means[k], count - 1, between)
        away.append(np.median(_distances(rows[cell == k], offset, variance, prior.columns), axis=0))
    ratio = np.median(away, axis=0) / prior.typical
    return np.asarray((count * ratio + FLEET_POINTS) / (count + FLEET_POINTS))


def _baseline(points: Floats, first_order_um: NDArray[np.complex128]) -> Baseline:
    """Ridge regression of the first order on the operating point; the scatter is of points that are
    left out."""
    where = _coordinates(points)
    centre, spread = where.mean(axis=0), np.maximum(where.std(axis=0), STEPS[:3])
    terms = _terms((where - centre) / spread)
    ridge = BASELINE_RIDGE * np.diag([0.0, *np.ones(terms.shape[1] - 1)])
    hat = np.linalg.solve(terms.T @ terms + ridge, terms.T)
    weights = hat @ first_order_um
    left_out = (first_order_um - terms @ weights) / np.maximum(
        1.0 - np.einsum("ij,ji->i", terms, hat), 0.1
    )
    scatter = max(math.sqrt(float(np.mean(np.abs(left_out) ** 2))), LEAST_SCATTER_UM)
    return Baseline(
        centre.tolist(), spread.tolist(), [(w.real, w.imag) for w in weights.tolist()], scatter
    )


def _by_cell(values: NDArray[Any], cell: NDArray[np.intp]) -> NDArray[Any]:
    """Means over the rows of every operating point."""
    return np.array([values[cell == k].mean(axis=0) for k in range(int(cell.max()) + 1)])


def _coordinates(points: Floats) -> Floats:
    """Log speed, clearance and eccentricity, ``(n, 3)``."""
    return np.column_stack([np.log(points[:, 0]), points[:, 1], points[:, 2]])


def _terms(u: Floats) -> Floats:
    return np.column_stack([np.ones(len(u)), u, u[:, 0] ** 2])


def _check_finite(*arrays: NDArray[np.generic]) -> None:
    for array, what in zip(
        arrays, ("residuals", "log-odds", "operating points", "first orders"), strict=True
    ):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise NormalError(
                f"{what}: decision {bad[0][0]} is not finite; it must not be learned from"
            )
