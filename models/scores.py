"""Scores of a diagnosis: classes from heads, decisions over ten windows, balanced accuracy, calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.dataset import CLASSES, HEADS_OF_CLASS, Dataset

Floats = NDArray[np.float64]

WINDOWS_PER_DECISION = 10
CALIBRATION_BINS = 10


@dataclass(frozen=True)
class Decisions:
    """Class probabilities ``(n, 6)`` beside the truth; one row a window or a decision of ten windows."""

    probability: Floats
    kind: NDArray[np.intp]
    severity: Floats
    group: NDArray[np.intp]

    @property
    def named(self) -> NDArray[np.intp]:
        """The most probable class."""
        return np.asarray(np.argmax(self.probability, axis=1), dtype=np.intp)

    @property
    def abnormal(self) -> NDArray[np.bool_]:
        """True where any fault is more probable than none."""
        return self.probability[:, 0] < 0.5


def class_probabilities(logits: Floats) -> Floats:
    """Six class probabilities ``(n, 6)`` from the heads' log-odds ``(n, 4)``.

    The heads are taken as independent, and of their 16 patterns only the six classes are allowed.
    """
    log_p, log_not = -np.logaddexp(0.0, -logits), -np.logaddexp(0.0, logits)
    joint = log_p @ HEADS_OF_CLASS.T + log_not @ (1.0 - HEADS_OF_CLASS).T
    joint = np.exp(joint - joint.max(axis=1, keepdims=True))
    probability: Floats = joint / joint.sum(axis=1, keepdims=True)
    return probability


def log_odds(probability: Floats) -> Floats:
    """Log-odds of probabilities, within those of float32."""
    p = np.clip(probability, 1e-6, 1.0 - 1e-6)
    odds: Floats = np.log(p) - np.log1p(-p)
    return odds


def by_window(logits: Floats, data: Dataset) -> Decisions:
    """One decision a window."""
    return Decisions(class_probabilities(logits), data.kind, data.severity, data.group)


def pool(logits: Floats, data: Dataset, windows: int = WINDOWS_PER_DECISION) -> tuple[Floats, NDArray[np.intp]]:
    """Mean log-odds of every ``windows`` windows of a recording, and the row of the first of them.

    A recording that is shorter than ``windows`` but has half of them gives one decision.
    """
    means, first = [], []
    for recording in np.unique(data.recording):
        rows = np.flatnonzero(data.recording == recording)
        for start in range(0, max(1, len(rows) - windows + 1), windows):
            some = rows[start : start + windows]
            if len(some) >= windows / 2:
                means.append(logits[some].mean(axis=0))
                first.append(some[0])
    return np.array(means).reshape(-1, logits.shape[1]), np.array(first, dtype=np.intp)


def by_ten_windows(logits: Floats, data: Dataset) -> Decisions:
    """One decision for every ten windows of a recording, from their mean log-odds."""
    pooled, at = pool(logits, data)
    return Decisions(class_probabilities(pooled), data.kind[at], data.severity[at], data.group[at])


def required(decisions: Decisions) -> Decisions:
    """The decisions at the severities that must be found: G16 and more, at most 25 % of the preload."""
    unbalance = CLASSES.index("unbalance")
    enough = np.where(decisions.kind == unbalance, decisions.severity >= 16.0, decisions.severity <= 25.0)
    rows = enough | (decisions.kind == 0)
    return Decisions(decisions.probability[rows], decisions.kind[rows], decisions.severity[rows], decisions.group[rows])


def balanced_accuracy(truth: NDArray[np.intp], named: NDArray[np.intp]) -> float:
    """Mean recall over the classes that occur."""
    return float(np.mean([np.mean(named[truth == kind] == kind) for kind in np.unique(truth)]))


def calibration_error(decisions: Decisions) -> float:
    """Expected calibration error of the named class, ten equal bins (Naeini et al. 2015)."""
    confidence = decisions.probability.max(axis=1)
    right = decisions.named == decisions.kind
    bins = np.minimum((confidence * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    gaps = [np.mean(bins == k) * abs(confidence[bins == k].mean() - right[bins == k].mean()) for k in np.unique(bins)]
    return float(np.sum(gaps))


def summary(decisions: Decisions) -> dict[str, object]:
    """Six-class and two-class balanced accuracy with 95 % intervals over builds, and calibration."""
    if len(decisions.kind) == 0:
        return {"decisions": 0}
    low, high = bootstrap(decisions)
    two = balanced_accuracy((decisions.kind > 0).astype(np.intp), decisions.abnormal.astype(np.intp))
    return {
        "decisions": len(decisions.kind),
        "builds": len(np.unique(decisions.group)),
        "six_class_balanced_accuracy": round(balanced_accuracy(decisions.kind, decisions.named), 4),
        "six_class_interval_95": [round(low, 4), round(high, 4)],
        "two_class_balanced_accuracy": round(two, 4),
        "expected_calibration_error": round(calibration_error(decisions), 4),
    }


def bootstrap(decisions: Decisions, draws: int = 500, seed: int = 0) -> tuple[float, float]:
    """95 % interval of the six-class balanced accuracy, builds drawn with replacement."""
    rng = np.random.default_rng(seed)
    rows_of = [np.flatnonzero(decisions.group == g) for g in np.unique(decisions.group)]
    named, scores = decisions.named, []
    for _ in range(draws):
        rows = np.concatenate([rows_of[k] for k in rng.integers(0, len(rows_of), len(rows_of))])
        scores.append(balanced_accuracy(decisions.kind[rows], named[rows]))
    return float(np.quantile(scores, 0.025)), float(np.quantile(scores, 0.975))


def beats(better: Decisions, simpler: Decisions, draws: int = 1000) -> bool:
    """True when ``better`` has the higher balanced accuracy on the same decisions, beyond luck.

    The lower 95 % limit of the paired difference, builds drawn with replacement, must lie above zero.
    """
    share = 1.0 / np.bincount(better.kind)[better.kind]
    right = (better.named == better.kind).astype(np.float64) - (simpler.named == simpler.kind)
    builds, index = np.unique(better.group, return_inverse=True)
    total, weight = np.bincount(index, share * right), np.bincount(index, share)
    rows = np.random.default_rng(0).integers(0, len(builds), (draws, len(builds)))
    difference = total[rows].sum(axis=1) / weight[rows].sum(axis=1)
    return bool(np.quantile(difference, 0.025) > 0.0)


def severity_grid(decisions: Decisions) -> dict[str, dict[str, float]]:
    """Share of decisions that named the right class, per class and severity; for normal: no alarm."""
    grid: dict[str, dict[str, float]] = {}
    for kind in np.unique(decisions.kind):
        of_kind = decisions.kind == kind
        grid[CLASSES[kind]] = {
            f"{severity:g}": round(
                float(np.mean(decisions.named[of_kind & (decisions.severity == severity)] == kind)), 4
            )
            for severity in np.unique(decisions.severity[of_kind])
        }
    return grid


def false_alarms(decisions: Decisions) -> dict[str, object]:
    """Healthy decisions that named a fault, decision by decision and by build."""
    healthy = decisions.kind == 0
    alarms, n = int(np.sum(healthy & (decisions.named != 0))), int(np.sum(healthy))
    builds = decisions.group[healthy & (decisions.named != 0)]
    return {
        "healthy_decisions": n,
        "healthy_builds": len(np.unique(decisions.group[healthy])),
        "false_alarms": alarms,
        "builds_with_a_false_alarm": len(np.unique(builds)),
        "share": round(alarms / max(n, 1), 5),
    }


def nll(logits: Floats, heads: Floats) -> float:
    """Mean negative log-likelihood of the heads, equation (8) without its regulariser."""
    return float(np.mean(np.logaddexp(0.0, logits) - heads * logits))


def temperature(logits: Floats, heads: Floats) -> float:
    """Divisor of the log-odds that minimises :func:`nll` (Guo et al. 2017), on a grid of 1 %."""
    grid = np.exp(np.arange(-1.5, 2.5, 0.01))
    return float(grid[np.argmin([nll(logits / t, heads) for t in grid])])
