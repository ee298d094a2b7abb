"""Fit normal, then detect, on measured recordings: each machine's own normal windows, no fault ever
seen.

For every group left out (a speed, say) a machine's normal windows of the *other* groups give mean
and covariance, where groups are numbers after a quadratic regression on them; the windows of the
group left out are scored by their Mahalanobis distance.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_features import ORDERS_VIEW
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import NORMAL
from models.diagnosis.measured import DRAWS, Indices, folds
from models.diagnosis.measured_features import FeatureRows
from models.diagnosis.measured_score import fit_score

Floats = NDArray[np.float64]

NORMAL_VIEW: Final = "16 bands"
"""Features where there is no fault to choose others by."""
LEAST_GROUPS: Final = 3
"""Normal groups of a machine below which nothing is fitted."""
RIDGE: Final = 0.1


def detect(data: FeatureRows) -> dict[str, object]:
    """How well distance from a machine's own normal tells its faults: area under the curve over
    recordings.

    Without the label :data:`NORMAL`, or a machine with :data:`LEAST_GROUPS` normal groups, the
    reason stands instead.
    """
    if NORMAL not in data.labels:
        return {"left_out": f"no label {NORMAL!r}"}
    if len(data.labels) == 1:
        return {"left_out": f"nothing but {NORMAL!r} to detect from"}
    report: dict[str, object] = {}
    for view in data.views:
        away = distances(data, view)
        rows = np.flatnonzero(np.isfinite(away))
        if not len(rows):
            return {"left_out": f"no machine has {LEAST_GROUPS} groups with the label {NORMAL!r}"}
        healthy = data.label[rows] == data.labels.index(NORMAL)
        if not healthy.any() or healthy.all():
            return {
                "left_out": f"no machine has {LEAST_GROUPS} groups with the label {NORMAL!r} "
                "beside the one that is left out, and a fault"
            }
        report[view] = _figures(data, rows, away)
    return report


def normal_only(data: FeatureRows) -> dict[str, object]:
    """Share of windows of each group that a limit set by the other groups calls unlike normal, for
    recordings of machines in good order alone.

    Raises
    ------
    DatasetError
        Fewer than :data:`LEAST_GROUPS` groups.
    """
    groups = np.unique(data.group)
    if len(groups) < LEAST_GROUPS:
        raise DatasetError(
            f"{len(groups)} groups, all {NORMAL!r}: at least {LEAST_GROUPS} are needed to set a "
            "limit that others keep; record at more operating points, each a file of its own"
        )
    report: dict[str, object] = {}
    for view in (name for name in (NORMAL_VIEW, ORDERS_VIEW) if name in data.views):
        x = data.views[view]
        alarms = np.zeros(len(data))
        for train, test in folds(data, np.arange(len(data))):
            score = fit_score(x[train], data.label[train], data.group[train])
            alarms[test] = score(x[test]) > 1.0
        of_group = [float(alarms[data.group == group].mean()) for group in groups]
        report[view] = {
            "false_alarms": round(float(alarms.mean()), 4),
            "worst_group": round(max(of_group), 4),
        }
    return {
        "windows": len(data),
        "groups_left_out": len(groups),
        "labels": list(data.labels),
        "left_out": dict(data.left_out),
        "normal_only": report,
    }


def distances(data: FeatureRows, view: str) -> Floats:
    """Distance of every window from its machine's normal in other groups, over the typical one
    there; NaN without."""
    away = np.full(len(data), np.nan)
    normal = data.label == data.labels.index(NORMAL)
    where = _coordinate(data)
    for machine in range(len(data.machines)):
        for train, test in folds(data, np.flatnonzero(data.machine == machine)):
            healthy = train[normal[train]]
            if len(np.unique(data.group[healthy])) >= LEAST_GROUPS:
                away[test] = _distance(data.views[view], where, healthy, test)
    return away


def _coordinate(data: FeatureRows) -> Floats:
    """Where each window was taken, ``(n, 3)``: constant, group and its square where all groups
    begin with a number."""
    try:
        value = np.array([float(name.split()[0]) for name in data.groups])[data.group]
    except ValueError:
        value = np.zeros(len(data))
    scaled = (value - value.mean()) / (value.std() or 1.0)
    return np.column_stack([np.ones(len(data)), scaled, scaled**2])


def _distance(x: Floats, where: Floats, healthy: Indices, test: Indices) -> Floats:
    """Mahalanobis distances of ``test`` over the median of ``healthy``; covariance shrunk (Ledoit
    and Wolf 2004)."""
    from sklearn.covariance import ledoit_wolf

    unit = x[healthy].std(axis=0) + 1e-9
    terms = where[healthy]
    ridge = RIDGE * np.diag([0.0, 1.0, 1.0])
    weights = np.linalg.solve(terms.T @ terms + ridge, terms.T @ (x[healthy] / unit))
    left = x[healthy] / unit - terms @ weights
    covariance, _ = ledoit_wolf(left, assume_centered=True)
    inverse = np.linalg.inv(covariance)

    def away(residual: Floats) -> Floats:
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", residual, inverse, residual)))

    return np.asarray(away(x[test] / unit - where[test] @ weights) / np.median(away(left)))


def _figures(data: FeatureRows, rows: Indices, away: Floats) -> dict[str, object]:
    """Area under the curve of windows, with the 95 % interval over recordings drawn again, and of
    every fault."""
    healthy = data.label[rows] == data.labels.index(NORMAL)
    recordings = np.unique(data.recording[rows])
    of = [rows[data.recording[rows] == r] for r in recordings]
    rng, drawn = np.random.default_rng(0), []
    for _ in range(DRAWS // 5):
        again = np.concatenate([of[i] for i in rng.integers(0, len(of), len(of))])
        sick = data.label[again] != data.labels.index(NORMAL)
        if sick.any() and not sick.all():
            drawn.append(area(away[again[~sick]], away[again[sick]]))
    faults = {
        label: round(area(away[rows[healthy]], away[rows[data.label[rows] == k]]), 4)
        for k, label in enumerate(data.labels)
        if label != NORMAL and (data.label[rows] == k).any()
    }
    return {
        "auroc": round(area(away[rows[healthy]], away[rows[~healthy]]), 4),
        "interval_95": [round(float(q), 4) for q in np.quantile(drawn, [0.025, 0.975])],
        "windows": len(rows),
        "machines": len(np.unique(data.machine[rows])),
        "auroc_of": faults,
    }


def area(healthy: Floats, faulty: Floats) -> float:
    """Probability that a faulty window lies farther than a healthy one (area under the ROC
    curve)."""
    order = np.sort(healthy)
    below = np.searchsorted(order, faulty, "left") + np.searchsorted(order, faulty, "right")
    return float(below.mean() / (2 * len(order)))
