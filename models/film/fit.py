"""Fit of a film network by Levenberg-Marquardt: every lambda of equation (6) and several starts, by
validation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.export import data_hash
from models.film.cache import kept
from models.learning.levenberg_marquardt import LmOptions, levenberg_marquardt
from models.learning.network import Mlp
from models.learning.squares import NetworkSquares
from models.runs import progress_bar

Floats = NDArray[np.float64]
HELD_OUT = 4
"""Every fourth point validates; no start trains on it."""


class DataError(ValueError):
    """Points that no network can learn from; the text names the first and the next step."""


@dataclass(frozen=True)
class Targets:
    """What a network learns: inputs ``(m, n)``, targets and their weights ``(m, k)``.

    With a ``mirror`` ``(input signs, output signs)`` the prediction is the mean of the network and
    of its mirror image, so that the symmetry holds exactly.
    """

    x: Floats
    y: Floats
    weight: Floats
    mirror: tuple[Floats, Floats] | None = None

    def check(self, name: str) -> None:
        """Refuse what cannot be fitted."""
        if len(self.x) <= HELD_OUT:
            raise DataError(
                f"{name}: {len(self.x)} points, at least {HELD_OUT + 1} are needed: raise "
                f"train_points"
            )
        bad = np.flatnonzero(~np.all(np.isfinite(np.hstack([self.x, self.y, self.weight])), axis=1))
        if bad.size:
            raise DataError(
                f"{name}: {bad.size} points are not finite, the first is point {bad[0]} at "
                f"{self.x[bad[0]].tolist()}: delete the films kept in the runs folder and solve "
                f"them again"
            )

    def subset(self, rows: NDArray[np.bool_]) -> Targets:
        """The targets at ``rows``."""
        return replace(self, x=self.x[rows], y=self.y[rows], weight=self.weight[rows])

    def error(self, net: Mlp, theta: Floats) -> Floats:
        """Weighted error ``(m, k)``."""
        outputs = net.outputs(theta, self.x)
        if self.mirror is not None:
            outputs = 0.5 * (outputs + self.mirror[1] * net.outputs(theta, self.mirror[0] * self.x))
        return np.asarray((outputs - self.y) * self.weight)

    def squares(self, net: Mlp) -> NetworkSquares:
        """Their sum as Levenberg-Marquardt takes it."""
        return NetworkSquares(net, self.x, self.y, self.weight, self.mirror)


@dataclass(frozen=True)
class Search:
    """Weight decays, starts of each, and iterations of each start."""

    l2: tuple[float, ...]
    restarts: int
    iterations: int


@dataclass(frozen=True)
class FitStart:
    """Best weights of one start by validation, their score, the way there, and how the search
    ended."""

    theta: Floats
    score: Floats
    scores: Floats
    iterations: NDArray[np.int64]
    reason: NDArray[np.str_]


@dataclass(frozen=True)
class Fit:
    """Best weights by validation, their score, the scores on the way there, and one row for every
    start."""

    theta: Floats
    score: float
    scores: Floats
    l2: float
    starts: list[dict[str, object]]


def fit(
    net: Mlp,
    targets: Targets,
    search: Search,
    rng: np.random.Generator,
    name: str,
    folder: Path,
    log: Callable[[dict[str, object]], None] = lambda row: None,
) -> Fit:
    """Weights of ``net`` with the lambda and the start that are best on the held-out points.

    Every start is kept in ``folder`` as it is done, so that an interrupted search goes on where it
    was; ``log`` gets its row.

    Raises
    ------
    DataError
        Too few points to hold any out, or one that is not finite.
    """
    targets.check(name)
    tried: list[tuple[float, FitStart]] = []
    rows: list[dict[str, object]] = []
    for l2 in search.l2:
        for number in range(1, search.restarts + 1):
            first = net.initial(rng)
            key = (
                net.sizes,
                l2,
                search.iterations,
                data_hash(first, targets.x, targets.y, targets.weight),
            )
            bar = f"{name}: Levenberg-Marquardt, lambda {l2:g}, start {number}"
            start = kept(
                folder,
                "start",
                key,
                FitStart,
                partial(_search, net, targets, first, l2, search.iterations, bar),
            )
            tried.append((l2, start))
            rows.append(
                {
                    "network": name,
                    "lambda": l2,
                    "start": number,
                    "validation": float(f"{float(start.score):.4g}"),
                    "iterations": int(start.iterations),
                    "ended_by": str(start.reason),
                }
            )
            log(rows[-1])
    l2, best = min(tried, key=lambda one: float(one[1].score))
    return Fit(best.theta, float(best.score), best.scores, l2, rows)


def _search(
    net: Mlp, targets: Targets, first: Floats, l2: float, iterations: int, title: str
) -> FitStart:
    held_out = np.arange(len(targets.x)) % HELD_OUT == 0
    train_on, validate = targets.subset(~held_out), targets.subset(held_out)
    with progress_bar(title, iterations) as bar:
        result = levenberg_marquardt(
            train_on.squares(net),
            first,
            l2=l2,
            penalised=net.is_weight(),
            monitor=lambda theta: float(
                np.sqrt(np.mean(np.sum(validate.error(net, theta) ** 2, axis=1)))
            ),
            options=LmOptions(iterations=iterations),
            progress=bar,
        )
    counted, reason = np.array(result.iterations), np.array(result.reason)
    return FitStart(result.theta, np.array(result.score), np.array(result.scores), counted, reason)


def spread(errors_percent: Sequence[float], fits: Sequence[Fit]) -> dict[str, object]:
    """Force error of every seed's fit on the judged films: their median, with the range as its
    interval.

    Smallest and largest of five enclose the median with 94 % probability (order statistics).
    """
    return {
        "force_relative_rms_percent": [float(f"{error:.4g}") for error in errors_percent],
        "median": float(f"{np.median(errors_percent):.4g}"),
        "interval": [float(f"{min(errors_percent):.4g}"), float(f"{max(errors_percent):.4g}")],
        "validation": [float(f"{one.score:.4g}") for one in fits],
    }
