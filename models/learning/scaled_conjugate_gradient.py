"""Scaled conjugate gradient (Moller 1993, Neural Networks 6:525): no line search, no step size to
choose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.learning.best import BestSoFar

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ScgResult:
    """Best point by ``monitor`` (or the last one without it), and the cost where the search
    ended."""

    theta: Floats
    cost: float
    score: float
    iterations: int
    reason: str


def scaled_conjugate_gradient(
    cost_and_gradient: Callable[[Floats], tuple[float, Floats]],
    start: Floats,
    *,
    iterations: int = 500,
    gradient_tolerance: float = 1e-7,
    monitor: Callable[[Floats], float] | None = None,
    patience: int = 50,
    progress: Callable[[int, float], None] | None = None,
) -> ScgResult:
    """Minimise a smooth cost; symbols as in the paper (lambda, sigma, delta, mu, alpha, beta).

    Parameters
    ----------
    cost_and_gradient
        ``theta -> (E, dE/dtheta)``.
    gradient_tolerance
        Stop on the infinity norm of the gradient.
    monitor, patience
        Score on held-out data; the best ``theta`` by it is returned, and the search stops after
        ``patience`` successful steps without a better one.

    Raises
    ------
    ValueError
        When cost or gradient at ``start`` is not finite.
    """
    w = start
    cost, gradient = cost_and_gradient(w)
    if not (np.isfinite(cost) and np.all(np.isfinite(gradient))):
        raise ValueError(
            "cost or gradient at the start is not finite: scale the data or choose another start"
        )
    best = BestSoFar(monitor, patience)
    best.offer(w, cost)
    r = p = -gradient
    lam, lam_bar, delta, success = 1e-6, 0.0, 0.0, True
    reason, k = "iterations", 0
    for k in range(1, iterations + 1):
        p2 = float(p @ p)
        if success:  # second-order information along p
            sigma = 1e-5 / np.sqrt(p2)
            delta = float(p @ (cost_and_gradient(w + sigma * p)[1] + r)) / sigma
        delta += (lam - lam_bar) * p2
        if delta <= 0.0:  # make the Hessian estimate positive definite
            lam_bar = 2.0 * (lam - delta / p2)
            delta = -delta + lam * p2
            lam = lam_bar
        mu = float(p @ r)
        alpha = mu / delta
        trial_cost, trial_gradient = cost_and_gradient(w + alpha * p)
        comparison = 2.0 * delta * (cost - trial_cost) / mu**2 if np.isfinite(trial_cost) else -1.0
        success = comparison >= 0.0
        lam_bar = 0.0 if success else lam
        if success:
            w, cost = w + alpha * p, trial_cost
            p, r = _next_direction(p, r, -trial_gradient, mu, restart=k % start.size == 0)
            best.offer(w, cost)
            if progress is not None:
                progress(k, cost)
        lam = _next_scale(lam, comparison, delta, p2)
        if np.max(np.abs(r)) <= gradient_tolerance:
            reason = "gradient"
            break
        if best.exhausted:
            reason = "patience"
            break
    return ScgResult(best.theta, cost, best.score, k, reason)


def _next_direction(
    p: Floats, r: Floats, r_new: Floats, mu: float, *, restart: bool
) -> tuple[Floats, Floats]:
    """Conjugate direction and residual; steepest descent at a restart or when rounding has lost
    descent."""
    p_new = r_new + float(r_new @ (r_new - r)) / mu * p
    return (r_new, r_new) if restart or p_new @ r_new <= 0.0 else (p_new, r_new)


def _next_scale(lam: float, comparison: float, delta: float, p2: float) -> float:
    """Lambda of the next step: less where the quadratic model holds, more where it does not."""
    if comparison >= 0.75:
        return 0.25 * lam
    return min(lam + delta * (1.0 - comparison) / p2, 1e50) if comparison < 0.25 else lam
