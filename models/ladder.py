"""The ladder of classifiers, simplest first: thresholds, logistic regression, a small network; and the paper's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES
from models.dataset import CLASSES, Dataset
from models.network import Mlp, sigmoid
from models.scaled_conjugate_gradient import ScgResult, scaled_conjugate_gradient
from models.scores import Decisions, nll

Floats = NDArray[np.float64]

THRESHOLD_FEATURES = (
    "log_shaft_fwd_1x_m",
    "shaft_fwd_2x_1x",
    "shaft_half_fwd_rms",
    "acc_bearing_vertical_log_rms",
    "acc_bearing_vertical_2x_1x",
    "acc_bearing_vertical_half_rms",
    "acc_motor_log_rms",
    "acc_motor_2x_1x",
    "acc_motor_half_rms",
)
"""What a plant engineer would put an alarm on: first, second and half order."""


@dataclass(frozen=True)
class Scaler:
    """Mean and deviation of the training windows."""

    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, data: Dataset) -> Scaler:
        """Moments of ``data``; a feature that never moves gets the deviation 1."""
        x = np.asarray(data.features, np.float64)
        deviation = x.std(axis=0)
        return cls(x.mean(axis=0), np.where(deviation > 1e-9, deviation, 1.0))

    def __call__(self, data: Dataset, clip: float = 10.0) -> Floats:
        """Scaled features, held to ``clip`` deviations as in the exported graph."""
        return np.clip((data.features - self.mean) / self.deviation, -clip, clip)


@dataclass(frozen=True)
class HeadNetwork:
    """A trained network that gives four log-odds from scaled features."""

    name: str
    net: Mlp
    theta: Floats
    l2: float
    iterations: int

    def logits(self, x: Floats) -> Floats:
        """Log-odds ``(n, 4)``."""
        return self.net.outputs(self.theta, x)


def fit_heads(
    name: str,
    hidden: tuple[int, ...],
    train: tuple[Floats, Floats],
    inner: tuple[Floats, Floats],
    l2: float,
    iterations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] | None = None,
) -> HeadNetwork:
    """Four sigmoid heads by scaled conjugate gradient on equation (8) with the square that it lacks.

    Parameters
    ----------
    hidden
        Neurons of the hidden layers; none is logistic regression.
    train, inner
        Scaled features and heads; the weights that are best on ``inner`` are kept.
    """  # fmt: skip
    x, heads = train
    net = Mlp((x.shape[1], *hidden, heads.shape[1]))
    decay = l2 * net.is_weight()

    def cost(theta: Floats) -> tuple[float, Floats]:
        logits = net.outputs(theta, x)
        slope = (sigmoid(logits) - heads) / heads.size
        return nll(logits, heads) + 0.5 * float(decay @ theta**2), net.gradient(theta, x, slope) + decay * theta

    result = scaled_conjugate_gradient(
        cost, net.initial(rng), iterations=iterations, monitor=lambda t: nll(net.outputs(t, inner[0]), inner[1]),
        patience=60, progress=progress,
    )  # fmt: skip
    return HeadNetwork(name, net, result.theta, l2, result.iterations)


def thresholds(train: Dataset, judged: Dataset) -> Floats:
    """Log-odds ``(n, 4)`` of one threshold a head, on the feature and side that separate ``train`` best."""
    columns = [FEATURE_NAMES.index(name) for name in THRESHOLD_FEATURES]
    logits = np.empty((len(judged), train.heads.shape[1]))
    for head in range(logits.shape[1]):
        truth = train.heads[:, head] > 0.5
        best = (-1.0, 0, 0.0, 1.0)
        for column in columns:
            for limit in np.quantile(train.features[:, column], np.linspace(0.02, 0.98, 49)):
                above = train.features[:, column] > limit
                for side in (1.0, -1.0):
                    called = above if side > 0 else ~above
                    score = 0.5 * float(np.mean(called[truth]) + np.mean(~called[~truth]))
                    best = max(best, (score, column, float(limit), side))
        _, column, limit, side = best
        logits[:, head] = np.where(side * (judged.features[:, column] - limit) > 0, 2.0, -2.0)
    return logits


def paper_network(
    train: Dataset,
    inner: Dataset,
    judged: Dataset,
    hidden: int,
    iterations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] | None = None,
) -> Decisions:
    """The paper's classifier as printed: raw windows of 800 points, one hidden sigmoid layer, softmax (7), SCG.

    The softmax sums over the outputs only (the printed upper limit is a misprint).
    """  # fmt: skip
    scaler = Scaler.of(train)
    x, truth = scaler(train), np.eye(len(CLASSES))[train.kind]
    x_inner, net = scaler(inner), Mlp((train.features.shape[1], hidden, len(CLASSES)))

    def softmax(theta: Floats, inputs: Floats) -> Floats:
        z = net.outputs(theta, inputs)
        e = np.exp(z - z.max(axis=1, keepdims=True))
        return np.asarray(e / e.sum(axis=1, keepdims=True))

    def cost(theta: Floats) -> tuple[float, Floats]:
        h = softmax(theta, x)
        value = -float(np.mean(np.sum(truth * np.log(h + 1e-300), axis=1)))
        return value, net.gradient(theta, x, (h - truth) / len(x))

    def inner_cost(theta: Floats) -> float:
        h = softmax(theta, x_inner)
        return -float(np.mean(np.log(h[np.arange(len(h)), inner.kind] + 1e-300)))

    result: ScgResult = scaled_conjugate_gradient(
        cost, net.initial(rng), iterations=iterations, monitor=inner_cost, patience=20, progress=progress
    )
    return Decisions(softmax(result.theta, scaler(judged)), judged.kind, judged.severity, judged.group)
