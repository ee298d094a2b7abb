"""Figures of a film surrogate: parity, error against eccentricity, and how the searches learned."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.film.fit import Fit
from models.film.judge import force_scale
from models.panel import panel

Floats = NDArray[np.float64]


def film(folder: Path, state: Floats, truth: Floats, force: Floats, fits: Sequence[Fit]) -> None:
    """All three, from the judged states ``(m, 9 or more)``, their forces ``(m, 2)`` in truth and by
    the network."""
    eps = np.hypot(*state[:, :2].T) / state[:, 5]
    error = 100.0 * np.hypot(*(force - truth).T) / np.hypot(*truth.T)
    scale = force_scale(state[:, :9])
    sizes = [np.hypot(*f.T) / scale for f in (truth, force)]

    def over_eccentricity(axes: Any) -> None:
        axes.scatter(eps, error, s=10)
        axes.set_yscale("log")

    def parity(axes: Any) -> None:
        axes.loglog(*sizes, ".", ms=4)
        ends = [min(sizes[0]), max(sizes[0])]
        axes.loglog(ends, ends, "k--", lw=0.8)

    panel(
        folder / "error_over_eccentricity.png",
        over_eccentricity,
        x="eccentricity ratio",
        y="force error, %",
    )
    panel(
        folder / "parity.png",
        parity,
        x="force over mu R L^3 |v_s| / c^3, Reynolds",
        y="the same, network",
    )
    panel(
        folder / "learning_curve.png",
        lambda axes: _learned(axes, fits),
        x="accepted steps",
        y="validation error",
    )


def _learned(axes: Any, fits: Sequence[Fit]) -> None:
    """Best validation error so far: median and range over the seeds, each going on with its
    last."""
    longest = max(len(one.scores) for one in fits)
    best = [np.minimum.accumulate(one.scores) for one in fits]
    curves = np.array(
        [np.append(curve, np.full(longest - len(curve), curve[-1])) for curve in best]
    )
    axes.semilogy(np.median(curves, axis=0), label=f"median of {len(fits)} seeds")
    axes.fill_between(
        np.arange(longest), curves.min(axis=0), curves.max(axis=0), alpha=0.3, label="range"
    )
    axes.legend()
