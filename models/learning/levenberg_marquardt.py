"""Levenberg-Marquardt for sums of squares with an L2 penalty, in float64.

Marquardt (1963) scaling by the running maximum of the normal matrix's diagonal (More 1978), damping
after Nielsen (1999).  The cost is equation (6) up to the constant ``m``: ``1/2 sum r**2 + lambda/2
sum theta**2`` over the penalised parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.learning.best import BestSoFar
from models.learning.squares import Squares

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LmResult:
    """Best point by the monitor (without one: the last), the last cost, and why the search ended.

    ``scores`` are the monitor's, at the start and after every accepted step.
    """

    theta: Floats
    cost: float
    score: float
    iterations: int
    reason: str
    scores: list[float]


@dataclass(frozen=True)
class LmOptions:
    """Stops: relative fall of the cost, infinity norm of the scaled gradient, patience of the
    monitor."""

    iterations: int = 300
    cost_tolerance: float = 1e-12
    gradient_tolerance: float = 1e-10
    damping: float = 1e-3
    patience: int = 40


@dataclass(frozen=True)
class _Point:
    """Sum of squares and penalised cost at ``theta``."""

    theta: Floats
    squares: Squares
    decay: Floats

    @property
    def cost(self) -> float:
        return self.squares.cost + 0.5 * float((self.decay * self.theta) @ self.theta)

    @property
    def gradient(self) -> Floats:
        slope: Floats = self.squares.gradient + self.decay * self.theta
        return slope

    @property
    def normal(self) -> Floats:
        matrix: Floats = self.squares.normal + np.diag(self.decay)
        return matrix


def levenberg_marquardt(
    squares: Callable[[Floats], Squares],
    start: Floats,
    *,
    l2: float = 0.0,
    penalised: NDArray[np.bool_] | None = None,
    monitor: Callable[[Floats], float] | None = None,
    options: LmOptions = LmOptions(),
    progress: Callable[[int, float], None] | None = None,
) -> LmResult:
    """Minimise ``1/2 |r(theta)|**2 + l2/2 |theta[penalised]|**2``, the residuals ``r`` known by
    their squares.

    Parameters
    ----------
    squares
        Half the sum of squares at ``theta``, with its gradient and Gauss-Newton matrix.
    start
        First ``theta``, ``(p,)``.
    l2, penalised
        Weight decay lambda of equation (6) and the parameters it acts on (all by default).
    monitor
        Score on held-out data; the best ``theta`` by it is returned, and the search stops after
        ``options.patience`` accepted steps without a better one.
    progress
        Called with iteration and cost after every accepted step.

    Raises
    ------
    ValueError
        When the residuals at ``start`` are not finite.
    """
    decay = l2 * (np.ones(start.size) if penalised is None else penalised.astype(np.float64))
    point = _Point(start, squares(start), decay)
    if not np.isfinite(point.cost):
        raise ValueError(
            "residuals at the start are not finite: scale the data or choose another start"
        )
    best = BestSoFar(monitor, options.patience)
    best.offer(start, point.cost)
    damping, growth, scale = options.damping, 2.0, np.full(start.size, np.finfo(float).tiny)
    normal, gradient = point.normal, point.gradient
    reason, iteration = "iterations", 0
    for iteration in range(1, options.iterations + 1):
        scale = np.maximum(scale, np.diag(normal))
        if np.max(np.abs(gradient) / np.sqrt(scale)) <= options.gradient_tolerance * (
            1.0 + point.cost
        ):
            reason = "gradient"
            break
        step = np.linalg.solve(normal + damping * np.diag(scale), -gradient)
        trial = _Point(point.theta + step, squares(point.theta + step), decay)
        gain = _gain(
            point.cost, trial.cost, 0.5 * float(step @ (damping * scale * step - gradient))
        )
        if gain <= 0.0:
            damping, growth = damping * growth, growth * 2.0
            if damping > 1e16:
                reason = "step"
                break
            continue
        fall, point = point.cost - trial.cost, trial
        normal, gradient = point.normal, point.gradient
        damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
        best.offer(point.theta, point.cost)
        if progress is not None:
            progress(iteration, point.cost)
        if best.exhausted or fall <= options.cost_tolerance * point.cost:
            reason = "patience" if best.exhausted else "cost"
            break
    return LmResult(best.theta, point.cost, best.score, iteration, reason, best.scores)


def _gain(cost: float, trial_cost: float, expected: float) -> float:
    """Fall of the cost as a share of what the quadratic model expects; negative for a step to
    refuse."""
    return (cost - trial_cost) / expected if np.isfinite(trial_cost) and expected > 0.0 else -1.0
