"""Figures of a run; matplotlib is imported here alone."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

from models.diagnosis.scores import CALIBRATION_BINS, Decisions, severity_grid
from models.film.states import JudgedFilms

matplotlib.use("Agg")
from matplotlib import pyplot

Floats = NDArray[np.float64]


def _figure(path: Path, draw: Callable[[Any], None], *, x: str, y: str) -> None:
    """One labelled panel as PNG."""
    figure, axes = pyplot.subplots(figsize=(6.0, 4.0), layout="constrained")
    draw(axes)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def surrogate(folder: Path, judged: JudgedFilms, force: Floats) -> None:
    """Relative force error against eccentricity, over the direction of the squeeze velocity."""
    eps, gamma = np.hypot(*judged.ab.T), np.degrees(np.arctan2(judged.ab[:, 1], judged.ab[:, 0]))
    error = 100.0 * np.hypot(*(force - judged.force).T) / np.hypot(*judged.force.T)

    def draw(axes: Any) -> None:
        points = axes.scatter(eps, error, c=gamma, s=10, cmap="viridis")
        axes.set_yscale("log")
        axes.figure.colorbar(points, label="angle from eccentricity to squeeze velocity, deg")

    _figure(folder / "error_over_eccentricity.png", draw, x="eccentricity ratio", y="relative force error, %")


def classifier(folder: Path, decisions: Decisions) -> None:
    """Reliability of the named class, and the share named rightly over the severities."""

    def reliability(axes: Any) -> None:
        confidence, right = decisions.probability.max(axis=1), decisions.named == decisions.kind
        bins = np.minimum((confidence * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
        means = [(confidence[bins == k].mean(), right[bins == k].mean()) for k in np.unique(bins)]
        axes.plot([0, 1], [0, 1], "k--", lw=0.8)
        axes.plot(*np.array(means).T, "o-")

    def severity(axes: Any) -> None:
        for name, row in severity_grid(decisions).items():
            axes.plot(list(row), list(row.values()), "o-", label=name.replace("_", " "))
        axes.legend(fontsize=7)

    _figure(folder / "reliability.png", reliability, x="probability of the named class", y="share right")
    _figure(folder / "severity.png", severity, x="preload left, %, or balance grade G", y="share named rightly")


def actor(folder: Path, report: dict[str, Any]) -> None:
    """Returns over training steps, every agent; power against time in violation; every agent's power."""
    with (folder / "metrics.csv").open(encoding="utf-8") as stream:
        rows = np.array([[float(row[k]) for k in ("agent", "step", "return")] for row in csv.DictReader(stream)])

    def curve(axes: Any) -> None:
        for agent in np.unique(rows[:, 0]):
            axes.plot(*rows[rows[:, 0] == agent, 1:].T, lw=0.8, label=f"agent {agent:.0f}")
        axes.legend(fontsize=6, ncol=2)

    def pareto(axes: Any) -> None:
        for name, found in report["policies"].items():
            axes.plot(found["violation_s"], found["power_W"], "o")
            axes.annotate(name.replace("_", " "), (found["violation_s"], found["power_W"]), fontsize=6)
        for name, power in report["references_W"].items():
            axes.axhline(power, ls="--", lw=0.8, color="0.4")
            axes.annotate(name, (0.98, power), xycoords=("axes fraction", "data"), fontsize=6, ha="right")

    def agents(axes: Any) -> None:
        power = report["ddpg_all_seeds"]["power_W_each_seed"]
        axes.plot(range(len(power)), power, "o")
        axes.axhspan(*report["ddpg_all_seeds"]["power_W_iqm_interval"], alpha=0.2, label="interquartile mean, 95 %")
        axes.axhline(report["policies"]["lookup"]["power_W"], ls="--", color="0.4", label="lookup table")
        axes.legend(fontsize=7)

    if len(rows):
        _figure(folder / "learning_curve.png", curve, x="environment steps", y="return of an episode")
    _figure(folder / "pareto.png", pareto, x="time in violation, s", y="mean shaft power, W")
    _figure(folder / "agents.png", agents, x="agent", y="mean shaft power, W")
