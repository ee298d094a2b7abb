"""Fault classes of measured recordings: few rungs, the simplest that wins on inner groups, judged
on groups left out.

Every group is left out once; random windows are never quoted.  Inside each fold the rung is chosen
by leaving out groups of the training part only, so that the choice has not seen what it is judged
on.  Beside it stands the random forest on log band energies and moments that the public recordings
come with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_features import ORDERS_VIEW, VIEWS
from models.diagnosis.dataset import DatasetError
from models.diagnosis.measured_features import FeatureRows
from models.learning.network import Mlp
from models.learning.scaled_conjugate_gradient import scaled_conjugate_gradient

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Predict = Callable[[Floats], Floats]
"""Features to class probabilities."""
Fit = Callable[[Floats, Indices, int, int], Predict]
"""Features, labels, number of classes, seed."""

HIDDEN: Final = 16
L2: Final = 1e-3
ITERATIONS: Final = 150
TREES: Final = 200
DRAWS: Final = 1000
INNER_FOLDS: Final = 4
MARGIN: Final = 0.01
"""A rung must be better than every simpler one by so much balanced accuracy to be chosen."""


@dataclass(frozen=True)
class Network:
    """The paper's network, softmax (7), on scaled features; called with features it gives class
    probabilities."""

    mean: Floats
    deviation: Floats
    net: Mlp
    theta: Floats

    def __call__(self, rows: Floats) -> Floats:
        """Class probabilities ``(n, classes)``."""
        return softmax(self.net.outputs(self.theta, (rows - self.mean) / self.deviation))


def fit_network(
    x: Floats, label: Indices, classes: int, seed: int, hidden: tuple[int, ...] = (HIDDEN,)
) -> Network:
    """Classes weighted alike, scaled conjugate gradient; no hidden layer is logistic regression."""
    mean, deviation = x.mean(axis=0), x.std(axis=0) + 1e-9
    z, truth = (x - mean) / deviation, np.eye(classes)[label]
    weight = (len(label) / (classes * np.maximum(np.bincount(label, minlength=classes), 1)))[label][
        :, None
    ]
    net = Mlp((x.shape[1], *hidden, classes))
    decay = L2 * net.is_weight()

    def cost(theta: Floats) -> tuple[float, Floats]:
        h = softmax(net.outputs(theta, z))
        value = -float(np.sum(weight * truth * np.log(h + 1e-300))) / len(z) + 0.5 * float(
            decay @ theta**2
        )
        return value, net.gradient(theta, z, weight * (h - truth) / len(z)) + decay * theta

    start = net.initial(np.random.default_rng(seed))
    return Network(
        mean, deviation, net, scaled_conjugate_gradient(cost, start, iterations=ITERATIONS).theta
    )


def fit_regression(x: Floats, label: Indices, classes: int, seed: int) -> Network:
    """Logistic regression."""
    return fit_network(x, label, classes, seed, ())


@dataclass(frozen=True)
class Forest:
    """A random forest; called with features it gives class probabilities."""

    trees: Any
    classes: int

    def __call__(self, rows: Floats) -> Floats:
        """Class probabilities ``(n, classes)``; zero for a class that was not taught."""
        probability = np.zeros((len(rows), self.classes))
        probability[:, self.trees.classes_] = self.trees.predict_proba(rows.astype(np.float32))
        return probability


def fit_forest(x: Floats, label: Indices, classes: int, seed: int) -> Forest:
    """Random forest, classes weighted alike, on features of the precision of the exported graph."""
    from sklearn.ensemble import RandomForestClassifier

    forest = RandomForestClassifier(
        TREES, class_weight="balanced_subsample", random_state=seed, n_jobs=1
    )
    return Forest(forest.fit(x.astype(np.float32), label), classes)


def softmax(z: Floats) -> Floats:
    """Class probabilities (7), summed over the outputs only."""
    e = np.exp(z - z.max(axis=1, keepdims=True))
    return np.asarray(e / e.sum(axis=1, keepdims=True))


FOREST_NAME: Final = "random forest, 16 bands"
FOREST: Final = ("16 bands", fit_forest)
"""The baseline: what the public recordings come with."""
Rungs = dict[str, tuple[str, Callable[[Floats, Indices, int, int], Network | Forest]]]
RUNGS: Final[Rungs] = {
    **{
        f"{name}, {view}": (view, fit)
        for name, fit in (("logistic regression", fit_regression), ("network", fit_network))
        for view in VIEWS
    },
    FOREST_NAME: FOREST,
    f"random forest, {ORDERS_VIEW}": (ORDERS_VIEW, fit_forest),
}
"""Simplest first."""
CANDIDATES: Final = {name: rung for name, rung in RUNGS.items() if rung[1] is not fit_forest}
"""What is chosen from unless somebody asks for forests too, which take most of the time."""


def available(data: FeatureRows, rungs: Rungs) -> Rungs:
    """Those of ``rungs`` whose features these recordings have."""
    return {name: rung for name, rung in rungs.items() if rung[0] in data.views}


def evaluate(data: FeatureRows, seed: int = 0, rungs: Rungs = CANDIDATES) -> dict[str, object]:
    """The chosen rung, every rung and the forest with each group left out once; balanced accuracy
    of windows.

    Raises
    ------
    DatasetError
        No class is held by two groups.
    """
    rows = np.flatnonzero(_scored(data))
    if not len(rows):
        raise DatasetError(
            "no group shares its class with another: nothing can be judged; choose another group "
            "column"
        )
    classes, every, rungs = len(data.labels), np.arange(len(data)), available(data, rungs)
    forest = _left_out(data, every, seed, *FOREST)
    report: dict[str, object] = {
        "windows": len(rows),
        "recordings": len(np.unique(data.recording[rows])),
        "groups_left_out": len(data.groups),
        "labels": list(data.labels),
        "majority_share": round(float(np.bincount(data.label[rows]).max() / len(rows)), 4),
        "left_out": dict(data.left_out),
        FOREST_NAME: _figures(data, rows, forest),
    }
    if not rungs:
        return report
    chosen, names = _chosen_left_out(data, seed, rungs)
    report["chosen on inner groups"] = _figures(data, rows, chosen, forest) | {
        "chosen": {name: names.count(name) for name in sorted(set(names))},
        "confusion": _confusion(data.label[rows], chosen[rows], classes),
    }
    return report | {
        name: _figures(data, rows, _left_out(data, every, seed, *rung), forest)
        for name, rung in rungs.items()
        if name != FOREST_NAME
    }


def choose(data: FeatureRows, part: Indices, seed: int, rungs: Rungs = CANDIDATES) -> str:
    """The simplest rung that no other beats by :data:`MARGIN` with groups of ``part`` left out,
    fold by fold."""
    groups = np.random.default_rng(seed).permutation(np.unique(data.group[part]))
    rungs = available(data, rungs)
    scores = {
        name: _inner_score(
            data, part, np.array_split(groups, min(INNER_FOLDS, len(groups))), seed, *rung
        )
        for name, rung in rungs.items()
    }
    best = max(scores.values())
    return next(name for name, score in scores.items() if score >= best - MARGIN)


def _inner_score(
    data: FeatureRows, part: Indices, folds: list[Indices], seed: int, view: str, fit: Fit
) -> float:
    """Balanced accuracy over all of ``part``, each fold of groups named by a model of the
    others."""
    named = np.full(len(data), -1, np.intp)
    for fold in folds:
        held = np.isin(data.group[part], fold)
        train, test = part[~held], part[held]
        if len(train):
            named[test] = _named(data, train, test, seed, view, fit)
    return balanced(data.label[part], named[part])


def _named(
    data: FeatureRows, train: Indices, test: Indices, seed: int, view: str, fit: Fit
) -> Indices:
    x = data.views[view]
    predict = fit(x[train], data.label[train], len(data.labels), seed)
    return np.asarray(predict(x[test]).argmax(axis=1), np.intp)


def _left_out(data: FeatureRows, part: Indices, seed: int, view: str, fit: Fit) -> Indices:
    """The class named for each window of ``part`` by a model that has not seen its group."""
    named = np.full(len(data), -1, np.intp)
    for train, test in folds(data, part):
        named[test] = _named(data, train, test, seed, view, fit)
    return named


def _chosen_left_out(data: FeatureRows, seed: int, rungs: Rungs) -> tuple[Indices, list[str]]:
    """As :func:`_left_out` with the rung that the other groups choose, and what they chose."""
    named, names = np.full(len(data), -1, np.intp), []
    for train, test in folds(data, np.arange(len(data))):
        names.append(choose(data, train, seed, rungs))
        named[test] = _named(data, train, test, seed, *rungs[names[-1]])
    return named, names


def folds(data: FeatureRows, part: Indices) -> list[tuple[Indices, Indices]]:
    """Rows to train on and rows left out, one group at a time.

    Raises
    ------
    DatasetError
        A recording stands in two groups: it would be on both sides.
    """
    pairs = np.unique(np.column_stack([data.recording, data.group]), axis=0)
    twice, count = np.unique(pairs[:, 0], return_counts=True)
    if (count > 1).any():
        raise DatasetError(
            f"recording {twice[count > 1][0]} stands in {count.max()} groups, on "
            f"both sides of a split; "
            "give each recording one group"
        )
    return [
        (part[data.group[part] != group], part[data.group[part] == group])
        for group in np.unique(data.group[part])
    ]


def _scored(data: FeatureRows) -> NDArray[np.bool_]:
    """Windows whose class some other group holds as well."""
    groups_of = {
        label: np.unique(data.group[data.label == label]) for label in range(len(data.labels))
    }
    return np.array([len(groups_of[label]) > 1 for label in data.label])


def _figures(
    data: FeatureRows, rows: Indices, named: Indices, than: Indices | None = None
) -> dict[str, object]:
    found: dict[str, object] = {
        "accuracy": round(float(np.mean(named[rows] == data.label[rows])), 4),
        "balanced_accuracy": round(balanced(data.label[rows], named[rows]), 4),
    }
    if than is not None:
        found["over_forest_95"] = [
            round(value, 4) for value in paired_interval(data, rows, named, than)
        ]
    return found


def _confusion(truth: Indices, named: Indices, classes: int) -> list[list[int]]:
    """Windows by true class (row) and named class (column)."""
    return (
        np.bincount(truth * classes + named, minlength=classes**2)
        .reshape(classes, classes)
        .tolist()
    )


def balanced(truth: Indices, named: Indices) -> float:
    """Mean recall over the classes that occur."""
    return float(np.mean([np.mean(named[truth == k] == k) for k in np.unique(truth)]))


def paired_interval(
    data: FeatureRows, rows: Indices, better: Indices, than: Indices
) -> tuple[float, float]:
    """95 % interval of the difference of balanced accuracies, recordings drawn with replacement."""
    truth, recording = data.label[rows], data.recording[rows]
    share = 1.0 / np.bincount(truth, minlength=len(data.labels))[truth] / len(np.unique(truth))
    gain = share * ((better[rows] == truth).astype(np.float64) - (than[rows] == truth))
    of_recording = np.bincount(np.unique(recording, return_inverse=True)[1], gain)
    draws = np.random.default_rng(0).integers(0, len(of_recording), (DRAWS, len(of_recording)))
    sums = of_recording[draws].sum(axis=1)
    return float(np.quantile(sums, 0.025)), float(np.quantile(sums, 0.975))
