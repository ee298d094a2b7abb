"""Fault classes of measured recordings: the device's spectra and networks on whatever channels a rig has.

Every group is left out once; random windows are never quoted.  Beside the networks stands the random forest on log
band energies and moments that the public recordings come with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.ringing import spectra
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import Measured
from models.learning.network import Mlp
from models.learning.scaled_conjugate_gradient import scaled_conjugate_gradient

Floats = NDArray[np.float64]
Predict = Callable[[Floats], Floats]
"""Features to class probabilities."""
Fit = Callable[[Floats, NDArray[np.intp], int, int], Predict]
"""Features, labels, number of classes, seed."""

WINDOW_SAMPLES: Final = 200
WINDOW_LEAST_S: Final = 1.0
"""A window holds so many samples and lasts so long at least."""
BANDS: Final = 24
LOWEST_LINE: Final = 2
"""Bands begin at this line of a window's spectrum."""
HIDDEN: Final = 16
L2: Final = 1e-3
ITERATIONS: Final = 150
TREES: Final = 200
DRAWS: Final = 1000


@dataclass(frozen=True)
class Windows:
    """Rows of one dataset: features of both codes, label, group and recording of every window."""

    features: Floats
    simple: Floats
    label: NDArray[np.intp]
    group: NDArray[np.intp]
    recording: NDArray[np.intp]
    labels: tuple[str, ...]
    groups: tuple[str, ...]


def windows_of(found: list[Measured]) -> Windows:
    """Non-overlapping windows of every recording."""
    labels, groups = sorted({r.label for r in found}), sorted({r.group for r in found})
    rows: list[tuple[Floats, Floats, int, int, int]] = []
    for number, recording in enumerate(found):
        n = window_samples(recording.rate_hz)
        for start in range(0, max(1, len(recording.samples) - n + 1), n):
            window = recording.samples[start : start + n].T
            rows.append((window_features(window, recording.rate_hz), simple_features(window),
                         labels.index(recording.label), groups.index(recording.group), number))  # fmt: skip
    full, simple, label, group, number_of = zip(*rows, strict=True)
    return Windows(np.array(full), np.array(simple), np.array(label), np.array(group), np.array(number_of),
                   tuple(labels), tuple(groups))  # fmt: skip


def window_samples(rate_hz: float) -> int:
    """Length of a window at ``rate_hz``."""
    return max(WINDOW_SAMPLES, round(WINDOW_LEAST_S * rate_hz))


def window_features(window: Floats, rate_hz: float) -> Floats:
    """Levels, shapes and phasors of the device's :func:`spectra` in bands even in the logarithm, and peakiness.

    Parameters
    ----------
    window
        Shape (channels, n).
    """
    n = window.shape[1]
    lines = np.unique(np.round(np.geomspace(LOWEST_LINE, n // 2, min(BANDS, n // 4) + 1)).astype(np.intp))
    level, shape, cross = spectra(window, rate_hz, lines * rate_hz / n)
    deviation = window - window.mean(axis=1, keepdims=True)
    rms = np.sqrt(np.mean(deviation**2, axis=1)) + 1e-12
    kurtosis = np.log10(np.mean(deviation**4, axis=1) / rms**4 + 0.1)
    crest = np.log10(np.abs(deviation).max(axis=1) / rms + 0.1)
    parts = (level, shape.ravel(), cross.real.ravel(), cross.imag.ravel(), np.log10(rms), kurtosis, crest)
    return np.concatenate(parts)


def simple_features(window: Floats, bands: int = 16) -> Floats:
    """Log energies of equal bands, and moments: what the forest sees."""
    deviation = window - window.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(deviation * np.hanning(window.shape[1]))) ** 2
    energy = [np.log(part.sum(axis=1) + 1e-12) for part in np.array_split(power[:, 1:], bands, axis=1)]
    std = deviation.std(axis=1) + 1e-12
    moments = [std, np.mean(deviation**3, axis=1) / std**3, np.mean(deviation**4, axis=1) / std**4]
    return np.concatenate([*energy, *moments])


@dataclass(frozen=True)
class Network:
    """The paper's network, softmax (7), on scaled features; called with features it gives class probabilities."""

    mean: Floats
    deviation: Floats
    net: Mlp
    theta: Floats

    def __call__(self, rows: Floats) -> Floats:
        """Class probabilities ``(n, classes)``."""
        return softmax(self.net.outputs(self.theta, (rows - self.mean) / self.deviation))


def fit_network(
    x: Floats, label: NDArray[np.intp], classes: int, seed: int, hidden: tuple[int, ...] = (HIDDEN,)
) -> Network:
    """Classes weighted alike, scaled conjugate gradient; no hidden layer is logistic regression."""
    mean, deviation = x.mean(axis=0), x.std(axis=0) + 1e-9
    z, truth = (x - mean) / deviation, np.eye(classes)[label]
    weight = (len(label) / (classes * np.maximum(np.bincount(label, minlength=classes), 1)))[label][:, None]
    net = Mlp((x.shape[1], *hidden, classes))
    decay = L2 * net.is_weight()

    def cost(theta: Floats) -> tuple[float, Floats]:
        h = softmax(net.outputs(theta, z))
        value = -float(np.sum(weight * truth * np.log(h + 1e-300))) / len(z) + 0.5 * float(decay @ theta**2)
        return value, net.gradient(theta, z, weight * (h - truth) / len(z)) + decay * theta

    start = net.initial(np.random.default_rng(seed))
    return Network(mean, deviation, net, scaled_conjugate_gradient(cost, start, iterations=ITERATIONS).theta)


def fit_regression(x: Floats, label: NDArray[np.intp], classes: int, seed: int) -> Network:
    """Logistic regression."""
    return fit_network(x, label, classes, seed, ())


def fit_forest(x: Floats, label: NDArray[np.intp], classes: int, seed: int) -> Predict:
    """Random forest, classes weighted alike."""
    from sklearn.ensemble import RandomForestClassifier

    forest = RandomForestClassifier(TREES, class_weight="balanced_subsample", random_state=seed, n_jobs=1)
    forest.fit(x, label)

    def predict(rows: Floats) -> Floats:
        probability = np.zeros((len(rows), classes))
        probability[:, forest.classes_] = forest.predict_proba(rows)
        return probability

    return predict


def softmax(z: Floats) -> Floats:
    """Class probabilities (7), summed over the outputs only."""
    e = np.exp(z - z.max(axis=1, keepdims=True))
    return np.asarray(e / e.sum(axis=1, keepdims=True))


RIVALS: Final[dict[str, tuple[str, Fit]]] = {
    "random forest, band energies": ("simple", fit_forest),
    "logistic regression, spectra": ("features", fit_regression),
    "network, spectra": ("features", fit_network),
    "random forest, spectra": ("features", fit_forest),
}


def evaluate(data: Windows, seed: int = 0) -> dict[str, object]:
    """Every rival with each group left out once; balanced accuracy of windows, paired against the first rival."""
    scored = _scored(data)
    if not scored.any():
        raise DatasetError("no group shares its class with another: nothing can be judged; choose another group column")
    named = {name: _left_out(getattr(data, view), data, fit, seed) for name, (view, fit) in RIVALS.items()}
    rows = np.flatnonzero(scored)
    first = next(iter(named))
    report: dict[str, object] = {
        "windows": len(rows), "recordings": len(np.unique(data.recording[rows])), "groups_left_out": len(data.groups),
        "labels": list(data.labels), "majority_share": round(float(np.bincount(data.label[rows]).max() / len(rows)), 4),
    }  # fmt: skip
    for name, answer in named.items():
        low, high = paired_interval(data, rows, answer, named[first])
        report[name] = {
            "accuracy": round(float(np.mean(answer[rows] == data.label[rows])), 4),
            "balanced_accuracy": round(balanced(data.label[rows], answer[rows]), 4),
            **({"over_forest_95": [round(low, 4), round(high, 4)]} if name != first else {}),
        }
    return report


def _scored(data: Windows) -> NDArray[np.bool_]:
    """Windows whose class some other group holds as well."""
    groups_of = {label: np.unique(data.group[data.label == label]) for label in range(len(data.labels))}
    return np.array([len(groups_of[label]) > 1 for label in data.label])


def _left_out(x: Floats, data: Windows, fit: Fit, seed: int) -> NDArray[np.intp]:
    """The class named for each window by a model that has not seen its group."""
    named = np.full(len(x), -1, dtype=np.intp)
    for train, test in _folds(data):
        named[test] = fit(x[train], data.label[train], len(data.labels), seed)(x[test]).argmax(axis=1)
    return named


def _folds(data: Windows) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    for group in range(len(data.groups)):
        test = data.group == group
        yield ~test, test


def balanced(truth: NDArray[np.intp], named: NDArray[np.intp]) -> float:
    """Mean recall over the classes that occur."""
    return float(np.mean([np.mean(named[truth == k] == k) for k in np.unique(truth)]))


def paired_interval(
    data: Windows, rows: NDArray[np.intp], better: NDArray[np.intp], than: NDArray[np.intp]
) -> tuple[float, float]:
    """95 % interval of the difference of balanced accuracies, recordings drawn with replacement."""
    truth, recording = data.label[rows], data.recording[rows]
    share = 1.0 / np.bincount(truth, minlength=len(data.labels))[truth] / len(np.unique(truth))
    gain = share * ((better[rows] == truth).astype(np.float64) - (than[rows] == truth))
    of_recording = np.bincount(np.unique(recording, return_inverse=True)[1], gain)
    draws = np.random.default_rng(0).integers(0, len(of_recording), (DRAWS, len(of_recording)))
    sums = of_recording[draws].sum(axis=1)
    return float(np.quantile(sums, 0.025)), float(np.quantile(sums, 0.975))
