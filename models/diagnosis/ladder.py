"""The ladder of classifiers, simplest first, each a function from the views of recordings to
decisions.

Thresholds; logistic regression; the paper's network on raw windows and on order-tracked features; a
small convolutional network on waveforms over shaft angle; regression and network with the ringing
of the feet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire import film_check, ringing
from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.brain.verdict import class_probabilities
from models.diagnosis.dataset import CLASSES, Dataset
from models.diagnosis.scores import nll, temperatures
from models.learning.network import Mlp, sigmoid
from models.learning.scaled_conjugate_gradient import scaled_conjugate_gradient

Floats = NDArray[np.float64]
Columns = NDArray[np.bool_]

THRESHOLD_FEATURES: Final = (
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

CLIP: Final = 10.0
"""Standard deviations beyond which a feature moves the verdict no further."""

ORDER_FEATURES: Final = ~np.isin(FEATURE_NAMES, ringing.names())
"""All but the ringing of the feet."""
ALL_FEATURES: Final = np.ones(len(FEATURE_NAMES), dtype=np.bool_)

_OPERATING: Final = ("log_speed_rad_s", "log_clearance_100um", "contact_eccentricity")
MOTOR_FEATURES: Final = np.isin(FEATURE_NAMES, (*ringing.names(), *_OPERATING))
"""Where the motor's bolt is looked for: how motor and pedestal ring."""
PEDESTAL_FEATURES: Final = MOTOR_FEATURES & ~np.array(
    ["acc_motor" in name for name in FEATURE_NAMES]
)
"""Where the pedestal's bolts are looked for: how the pedestal rings."""
UNBALANCE_FEATURES: Final = np.isin(
    FEATURE_NAMES,
    (
        *_OPERATING,
        *film_check.names()[3:],
        "log_film_share",
        "log_shaft_fwd_1x_m",
        "contact_1x_film",
        *(f"{name}_{what}" for name in ringing.CHANNELS for what in ("log_rms", "1x_rms")),
        "contact_mean_V",
        "contact_low_V",
        "contact_log_std_V",
        "contact_2x_film",
        "contact_half_film",
    ),
)
"""Where unbalance is looked for: the first order of film, orbit and accelerations, what the film
lets it be, and whether the film is thick enough for the contact channel to tell."""
OWN_FEATURES: Final = np.column_stack(
    [PEDESTAL_FEATURES, PEDESTAL_FEATURES, MOTOR_FEATURES, UNBALANCE_FEATURES]
)
"""Features of each head, ``(F, 4)``."""


@dataclass(frozen=True)
class Scaler:
    """Mean and deviation of the training rows; a feature that is left out has an infinite
    deviation."""

    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, data: Dataset, columns: Columns | None = None) -> Scaler:
        """Moments of ``data``; a feature that never moves gets the deviation 1."""
        x = np.asarray(data.features, np.float64)
        deviation = x.std(axis=0)
        deviation = np.where(deviation > 1e-9, deviation, 1.0)
        return cls(
            x.mean(axis=0), deviation if columns is None else np.where(columns, deviation, np.inf)
        )

    def __call__(self, features: NDArray[np.floating]) -> Floats:
        """Scaled features, held to :data:`CLIP` deviations as in the exported graph."""
        return np.clip((features - self.mean) / self.deviation, -CLIP, CLIP)


@dataclass(frozen=True)
class HeadNetwork:
    """A trained network that gives four log-odds from features, each divided by its head's
    ``temperature`` ``(4,)``."""

    name: str
    scaler: Scaler
    net: Mlp
    theta: Floats
    l2: float
    columns: Columns
    hidden: int
    temperature: Floats

    def logits(self, features: NDArray[np.floating]) -> Floats:
        """Log-odds ``(n, 4)``."""
        return self.net.outputs(self.theta, self.scaler(features)) / self.temperature

    def calibrated(self, inner: Dataset) -> HeadNetwork:
        """The same with the temperatures that suit ``inner`` rows."""
        found = temperatures(self.logits(inner.features), inner.heads, inner.weight)
        return replace(self, temperature=self.temperature * found)


def fit_heads(
    name: str,
    columns: Columns,
    hidden: int,
    train: Dataset,
    inner: Dataset,
    l2: float,
    iterations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] | None = None,
) -> HeadNetwork:
    """Four sigmoid heads by scaled conjugate gradient on equation (8) with the square that it
    lacks.

    Parameters
    ----------
    columns
        Features that are used, ``(F,)``, or those of each head, ``(F, 4)``: then the heads share no
        neuron.
    hidden
        Neurons of the hidden layer (of each head, where they share none); 0 is logistic regression.
    train, inner
        Rows; the weights that are best on ``inner`` are kept.
    """
    own = columns.ndim == 2
    scaler = Scaler.of(train, np.asarray(columns.any(axis=1)) if own else columns)
    x, heads, x_inner, inner_heads = (
        scaler(train.features),
        train.heads,
        scaler(inner.features),
        inner.heads,
    )
    weight, inner_weight = train.weight[:, None], inner.weight[:, None]
    neurons = hidden * heads.shape[1] if own else hidden
    net = Mlp((x.shape[1], *((neurons,) if hidden else ()), heads.shape[1]))
    there = _own_weights(columns, hidden) if own else np.ones(net.count)
    decay = l2 * net.is_weight()

    def cost(theta: Floats) -> tuple[float, Floats]:
        logits = net.outputs(theta, x)
        slope = weight * (sigmoid(logits) - heads) / heads.size
        gradient = there * net.gradient(theta, x, slope) + decay * theta
        return nll(logits, heads, weight) + 0.5 * float(decay @ theta**2), gradient

    result = scaled_conjugate_gradient(
        cost,
        there * net.initial(rng),
        iterations=iterations,
        patience=40,
        progress=progress,
        monitor=lambda t: nll(net.outputs(t, x_inner), inner_heads, inner_weight),
    )
    return HeadNetwork(
        name, scaler, net, result.theta, l2, columns, hidden, np.ones(heads.shape[1])
    )


def cross_fitted(
    like: HeadNetwork, data: Dataset, folds: int, iterations: int, seed: int
) -> Floats:
    """Log-odds ``(n, 4)`` of every row by a network made as ``like`` that saw nothing of the row's
    build.

    Each of ``folds`` parts of the builds is left out in turn; the next one stops the training and
    calibrates.
    """
    builds = np.unique(data.group)
    fold = (
        np.random.default_rng(seed).permutation(len(builds))[np.searchsorted(builds, data.group)]
        % folds
    )
    found = np.empty((len(data), data.heads.shape[1]))
    for left in range(folds):
        inner = fold == (left + 1) % folds
        train, inner_rows = data.subset((fold != left) & ~inner), data.subset(inner)
        network = fit_heads(
            like.name,
            like.columns,
            like.hidden,
            train,
            inner_rows,
            like.l2,
            iterations,
            np.random.default_rng(seed),
        ).calibrated(inner_rows)
        found[fold == left] = network.logits(data.features[fold == left])
    return found


def _own_weights(columns: Columns, hidden: int) -> Floats:
    """1 for each weight of an :class:`Mlp` whose heads share no neuron and see ``columns`` ``(F,
    heads)``, else 0."""
    heads = columns.shape[1]
    layers: list[Floats] = [np.repeat(columns.astype(np.float64), max(hidden, 1), axis=1)]
    if hidden:
        layers.append(np.asarray(np.kron(np.eye(heads), np.ones((hidden, 1))), np.float64))
    return np.concatenate([np.vstack([np.ones((1, m.shape[1])), m]).ravel() for m in layers])


def side_by_side(name: str, networks: Sequence[HeadNetwork]) -> HeadNetwork:
    """One network of one hidden layer that gives the mean log-odds of ``networks``, which share a
    scaler."""
    first, count = networks[0], len(networks)
    hidden, last = zip(*(n.net.layers(n.theta) for n in networks), strict=True)
    bias, weights = np.mean([m[:1] for m in last], axis=0), np.vstack([m[1:] for m in last]) / count
    net = Mlp((first.net.sizes[0], count * first.net.sizes[1], first.net.sizes[-1]))
    theta = np.concatenate([np.hstack(hidden).ravel(), np.vstack([bias, weights]).ravel()])
    return HeadNetwork(
        name,
        first.scaler,
        net,
        theta,
        first.l2,
        first.columns,
        first.hidden,
        np.ones(net.sizes[-1]),
    )


def thresholds(train: Dataset, judged: Dataset) -> Floats:
    """Class probabilities of one threshold a head, on the feature and side that separate ``train``
    best."""
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
    return class_probabilities(logits)


@dataclass(frozen=True)
class PaperNetwork:
    """The paper's classifier as printed: one hidden sigmoid layer, softmax (7), scaled conjugate
    gradient.

    The softmax sums over the outputs only (the printed upper limit is a misprint).
    """

    scaler: Scaler
    net: Mlp
    theta: Floats

    @classmethod
    def fit(
        cls,
        train: Dataset,
        inner: Dataset,
        hidden: int,
        iterations: int,
        rng: np.random.Generator,
        columns: Columns | None = None,
        progress: Callable[[int, float], None] | None = None,
    ) -> PaperNetwork:
        """Train on ``train``; the weights that are best on ``inner`` are kept."""
        scaler, net = (
            Scaler.of(train, columns),
            Mlp((train.features.shape[1], hidden, len(CLASSES))),
        )
        x, truth, x_inner = (
            scaler(train.features),
            np.eye(len(CLASSES))[train.kind],
            scaler(inner.features),
        )

        def cost(theta: Floats) -> tuple[float, Floats]:
            h = _softmax(net.outputs(theta, x))
            value = -float(np.mean(np.sum(truth * np.log(h + 1e-300), axis=1)))
            return value, net.gradient(theta, x, (h - truth) / len(x))

        def inner_cost(theta: Floats) -> float:
            h = _softmax(net.outputs(theta, x_inner))
            return -float(np.mean(np.log(h[np.arange(len(h)), inner.kind] + 1e-300)))

        result = scaled_conjugate_gradient(
            cost,
            net.initial(rng),
            iterations=iterations,
            monitor=inner_cost,
            patience=20,
            progress=progress,
        )
        return cls(scaler, net, result.theta)

    def probability(self, features: NDArray[np.floating]) -> Floats:
        """Class probabilities ``(n, 6)``."""
        return _softmax(self.net.outputs(self.theta, self.scaler(features)))


def _softmax(z: Floats) -> Floats:
    e = np.exp(z - z.max(axis=1, keepdims=True))
    return np.asarray(e / e.sum(axis=1, keepdims=True))
