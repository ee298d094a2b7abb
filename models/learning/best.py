"""The best point of a search by a held-out score, and when to stop looking for a better one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class BestSoFar:
    """Keeps the point with the lowest score.

    Parameters
    ----------
    monitor
        Score of a point on held-out data; None takes the training cost.
    patience
        Points without a better score after which the search is exhausted.
    """

    def __init__(self, monitor: Callable[[Floats], float] | None, patience: int) -> None:
        self._monitor = monitor
        self._patience = patience
        self._since = 0
        self.score = np.inf
        self.scores: list[float] = []
        self.theta: Floats = np.empty(0)

    @property
    def exhausted(self) -> bool:
        """True after ``patience`` points without a better score."""
        return self._since >= self._patience

    def offer(self, theta: Floats, cost: float) -> None:
        """Take ``theta`` if it scores better than every point before it."""
        score = cost if self._monitor is None else self._monitor(theta)
        self.scores.append(score)
        if score < self.score:
            self.theta, self.score, self._since = theta, score, 0
        else:
            self._since += 1
