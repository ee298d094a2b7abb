"""Scores of a diagnosis: classes from heads, balanced accuracy, worst group, calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from models.diagnosis.clearance_loops import LOOPS
from models.diagnosis.dataset import CLASSES, Dataset, severe
from models.diagnosis.recordings import DUTIES

Floats = NDArray[np.float64]

CALIBRATION_BINS = 10
LEAST_PROBABILITY = 1e-4
"""One decision costs no more than this in the log score."""
LEAST_ODDS = 100.0
"""Odds against normal below which no fault is named: a rarer machine than the training's healthy
ones reaches them."""
APART = 0.9
"""Balanced accuracy of two classes alone below which they cannot be told apart."""
SPEED_BORDERS = np.log10(np.array([3000.0, 6000.0]) * np.pi / 30.0)
REGIMES = (LOOPS, DUTIES, ("below 3000 rpm", "3000 to 6000 rpm", "above 6000 rpm"))
"""Names of the columns of :attr:`Decisions.regime`."""


@dataclass(frozen=True)
class Decisions:
    """Class probabilities ``(n, 6)`` beside the truth, one row a decision; ``regime`` ``(n, k)``
    for worst groups."""

    probability: Floats
    kind: NDArray[np.intp]
    severity: Floats
    group: NDArray[np.intp]
    regime: NDArray[np.intp]

    @property
    def named(self) -> NDArray[np.intp]:
        """The most probable class."""
        return np.asarray(np.argmax(self.probability, axis=1), dtype=np.intp)

    @property
    def abnormal(self) -> NDArray[np.bool_]:
        """True where any fault is more probable than none."""
        return self.probability[:, 0] < 0.5

    def subset(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Decisions:
        """The decisions at ``rows``."""
        return Decisions(*(getattr(self, f.name)[rows] for f in fields(self)))


def decide(probability: Floats, data: Dataset) -> Decisions:
    """Decisions from class probabilities of the rows of ``data``."""
    return Decisions(probability, data.kind, data.severity, data.group, regimes(data))


def regimes(data: Dataset) -> NDArray[np.intp]:
    """Who moved the clearance, what speed and load did, third of the speeds: ``(n, 3)``."""
    speed = np.zeros(len(data), dtype=np.intp)
    if data.features.shape[1] == len(FEATURE_NAMES):
        speed = np.digitize(data.features[:, FEATURE_NAMES.index("log_speed_rad_s")], SPEED_BORDERS)
    return np.column_stack([data.loop, data.duty, speed])


def worst_group(
    decisions: Decisions, score: Callable[[Decisions], float] | None = None
) -> tuple[str, NDArray[np.bool_]]:
    """Name and rows of the regime with the lowest ``score`` (default: six-class balanced
    accuracy)."""
    found: list[tuple[float, str, NDArray[np.bool_]]] = []
    for column, names in enumerate(REGIMES):
        for index, name in enumerate(names):
            rows = decisions.regime[:, column] == index
            if len(np.unique(decisions.kind[rows])) == len(np.unique(decisions.kind)):
                found.append(((score or six_classes)(decisions.subset(rows)), name, rows))
    _, name, rows = min(found, key=lambda item: item[0], default=(0.0, "all", decisions.kind >= 0))
    return name, rows


def six_classes(decisions: Decisions) -> float:
    """Balanced accuracy of the named class."""
    return balanced_accuracy(decisions.kind, decisions.named)


def log_score(decisions: Decisions) -> float:
    """Mean log probability of the truth, every class with the same weight (Good 1952); 0 is the
    best."""
    right = np.log(
        decisions.probability[np.arange(len(decisions.kind)), decisions.kind] + LEAST_PROBABILITY
    )
    return float(
        np.mean([right[decisions.kind == kind].mean() for kind in np.unique(decisions.kind)])
    )


def two_classes(decisions: Decisions) -> float:
    """Balanced accuracy of normal against any fault."""
    return balanced_accuracy(
        (decisions.kind > 0).astype(np.intp), decisions.abnormal.astype(np.intp)
    )


def required(decisions: Decisions) -> Decisions:
    """The decisions at the severities that must be found: G16 and more, at most 25 % of the
    preload."""
    return decisions.subset(severe(decisions.kind, decisions.severity))


def balanced_accuracy(truth: NDArray[np.intp], named: NDArray[np.intp]) -> float:
    """Mean recall over the classes that occur."""
    return float(np.mean([np.mean(named[truth == kind] == kind) for kind in np.unique(truth)]))


def confused(decisions: Decisions) -> list[dict[str, object]]:
    """Pairs of classes that are confused, the worst first: each decision between the two alone."""
    found = []
    for a, b in combinations(np.unique(decisions.kind).tolist(), 2):
        rows = decisions.subset((decisions.kind == a) | (decisions.kind == b))
        named = np.where(rows.probability[:, a] >= rows.probability[:, b], a, b)
        score = balanced_accuracy(rows.kind, named)
        if score < APART:
            found.append((score, CLASSES[a], CLASSES[b]))
    return [
        {"classes": [a, b], "balanced_accuracy": round(score, 4)} for score, a, b in sorted(found)
    ]


def calibration_error(decisions: Decisions) -> float:
    """Expected calibration error of the named class, ten equal bins (Naeini et al. 2015)."""
    confidence = decisions.probability.max(axis=1)
    right = decisions.named == decisions.kind
    bins = np.minimum((confidence * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    gaps = [
        np.mean(bins == k) * abs(confidence[bins == k].mean() - right[bins == k].mean())
        for k in np.unique(bins)
    ]
    return float(np.sum(gaps))


def summary(decisions: Decisions) -> dict[str, object]:
    """Six-class and two-class balanced accuracy with 95 % intervals over builds, and
    calibration."""
    if len(decisions.kind) == 0:
        return {"decisions": 0}
    report: dict[str, object] = {
        "decisions": len(decisions.kind),
        "builds": len(np.unique(decisions.group)),
    }
    for name, score in (("six_classes", six_classes), ("two_classes", two_classes)):
        worst, rows = worst_group(decisions, score)
        report[name] = {
            "balanced_accuracy": round(score(decisions), 4),
            "interval_95": [round(limit, 4) for limit in bootstrap(decisions, score)],
            "worst_group": {
                "name": worst,
                "decisions": int(rows.sum()),
                "balanced_accuracy": round(score(decisions.subset(rows)), 4),
            },
        }
    return report | {"ece": round(calibration_error(decisions), 4)}


def bootstrap(
    decisions: Decisions, score: Callable[[Decisions], float], draws: int = 500, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of ``score``, builds drawn with replacement."""
    rng = np.random.default_rng(seed)
    rows_of = [np.flatnonzero(decisions.group == g) for g in np.unique(decisions.group)]
    scores = [
        score(
            decisions.subset(
                np.concatenate([rows_of[k] for k in rng.integers(0, len(rows_of), len(rows_of))])
            )
        )
        for _ in range(draws)
    ]
    return float(np.quantile(scores, 0.025)), float(np.quantile(scores, 0.975))


def beats(better: Decisions, simpler: Decisions, draws: int = 1000) -> bool:
    """True when ``better`` has the higher balanced accuracy on the same decisions, beyond luck.

    The lower 95 % limit of the paired difference, builds drawn with replacement, must lie above
    zero.
    """
    share = 1.0 / np.bincount(better.kind)[better.kind]
    right = (better.named == better.kind).astype(np.float64) - (simpler.named == simpler.kind)
    builds, index = np.unique(better.group, return_inverse=True)
    total, weight = np.bincount(index, share * right), np.bincount(index, share)
    rows = np.random.default_rng(0).integers(0, len(builds), (draws, len(builds)))
    difference = total[rows].sum(axis=1) / weight[rows].sum(axis=1)
    return bool(np.quantile(difference, 0.025) > 0.0)


def severity_grid(decisions: Decisions) -> dict[str, dict[str, float]]:
    """Share of decisions that named the right class, per class and severity; for normal: no
    alarm."""
    grid: dict[str, dict[str, float]] = {}
    for kind in np.unique(decisions.kind):
        of_kind = decisions.kind == kind
        grid[CLASSES[kind]] = {
            f"{severity:g}": round(
                float(np.mean(decisions.named[of_kind & (decisions.severity == severity)] == kind)),
                4,
            )
            for severity in np.unique(decisions.severity[of_kind])
        }
    return grid


def nll(logits: Floats, heads: Floats, weight: Floats | float = 1.0) -> float:
    """Mean (weighted) negative log-likelihood of the heads, equation (8) without its
    regulariser."""
    return float(np.mean(weight * (np.logaddexp(0.0, logits) - heads * logits)))


def alarm_limits(probability: Floats, rate: float, tail: float = 0.05) -> Floats:
    """Odds of each fault against normal that healthy decisions exceed at ``rate`` over all faults
    at most, ``(5,)``.

    Each fault has its own limit: one that is hard to tell must not make the others wait.  Peaks
    over the quantile ``1 - tail`` of the log-odds reach beyond what was counted
    (:func:`peaks_over`).

    Parameters
    ----------
    probability
        Of the six classes on healthy decisions, ``(n, 6)``.
    """
    odds = fault_log_odds(probability)
    steps = np.log(tail * odds.shape[1] / rate)
    limits = []
    for column in odds.T:
        high, scale, shape = peaks_over(column, tail)
        limits.append(high + scale * np.expm1(shape * steps) / shape)
    return np.maximum(np.exp(limits), LEAST_ODDS)


def peaks_over(values: Floats, tail: float) -> tuple[float, float, float]:
    """Quantile ``1 - tail`` of ``values``; scale and shape of the generalised Pareto distribution
    above it.

    By the first two moments (Pickands 1975; Hosking and Wallis 1987).  The shape is held below 0,
    where 0 is exponential: what is normal for a machine is bounded, and so is what its sensors make
    of it.
    """
    high = float(np.quantile(values, 1.0 - tail))
    excess = values[values > high] - high
    mean = float(np.mean(excess))
    shape = min(-1e-6, 0.5 * (1.0 - mean**2 / max(float(np.var(excess)), 1e-12)))
    return high, mean * (1.0 - shape), shape


def fault_log_odds(probability: Floats) -> Floats:
    """Log-odds of each fault against normal, ``(n, 5)``."""
    held = np.log(np.maximum(probability, 1e-12))
    return np.asarray(held[:, 1:] - held[:, :1])


def temperatures(logits: Floats, heads: Floats, weight: Floats | float = 1.0) -> Floats:
    """Divisor of each head's log-odds that minimises its (weighted) :func:`nll` (Guo et al. 2017),
    on a grid of 1 %.

    Log-odds are sharpened threefold at most: rows that a head tells apart without a miss do not say
    how sure it may be.
    """
    grid = np.exp(np.arange(-1.1, 2.5, 0.01))
    return np.array(
        [
            grid[np.argmin([nll(z / t, truth, weight) for t in grid])]
            for z, truth in zip(logits.T, heads.T, strict=True)
        ]
    )
