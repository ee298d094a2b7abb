"""Figures of a run: classifier and actor."""

from __future__ import annotations

import csv
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.dataset import CLASSES
from models.diagnosis.scores import CALIBRATION_BINS, Decisions, severity_grid
from models.panel import panel as _figure

Floats = NDArray[np.float64]


def classifier(folder: Path, decisions: Decisions) -> None:
    """Confusion of the classes, reliability of the named one, and the share named rightly over the
    severities."""

    def confusion(axes: Any) -> None:
        counts = np.zeros((len(CLASSES), len(CLASSES)))
        np.add.at(counts, (decisions.kind, decisions.named), 1)
        share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
        for (row, column), value in np.ndenumerate(share):
            axes.text(
                column,
                row,
                f"{value:.2f}",
                ha="center",
                va="center",
                fontsize=7,
                color="wk"[int(value < 0.6)],
            )
        names = [name.replace("_", " ") for name in CLASSES]
        axes.set_xticks(range(len(names)), names, rotation=30, ha="right", fontsize=7)
        axes.set_yticks(range(len(names)), names, fontsize=7)

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

    _figure(folder / "confusion.png", confusion, x="named", y="true")
    _figure(
        folder / "reliability.png", reliability, x="probability of the named class", y="share right"
    )
    _figure(
        folder / "severity.png",
        severity,
        x="preload left, %, or balance grade G",
        y="share named rightly",
    )


def actor(folder: Path, report: dict[str, Any]) -> None:
    """For each scoreboard: returns over training steps, power against time in violation, every
    agent's power."""
    with (folder / "metrics.csv").open(encoding="utf-8") as stream:
        logged = list(csv.DictReader(stream))
    for board in (each for each in ("clearance", "pair") if each in report):
        rows = np.array(
            [
                [float(row[k]) for k in ("agent", "step", "return")]
                for row in logged
                if row["board"] == board
            ]
        )
        found = report[board]
        _figure(
            folder / f"{board}_learning.png",
            partial(_curves, rows=rows),
            x="environment steps",
            y="return of an episode",
        )
        _figure(
            folder / f"{board}_pareto.png",
            partial(_pareto, found=found),
            x="time in violation, s",
            y="mean power, W",
        )
        _figure(
            folder / f"{board}_agents.png",
            partial(_agents, found=found),
            x="agent",
            y="mean power, W",
        )


def _curves(axes: Any, *, rows: Floats) -> None:
    """Every agent thin, their mean with its 95 % interval thick."""
    for agent in np.unique(rows[:, 0]):
        axes.plot(*rows[rows[:, 0] == agent, 1:].T, lw=0.5, color="0.6")
    steps = np.unique(rows[:, 1])
    groups = [rows[rows[:, 1] == step, 2] for step in steps]
    mean = np.array([group.mean() for group in groups])
    half = np.array([1.96 * group.std() / max(1.0, len(group) - 1.0) ** 0.5 for group in groups])
    axes.plot(steps, mean, lw=1.5, label="mean of the agents, 95 %")
    axes.fill_between(steps, mean - half, mean + half, alpha=0.3)
    axes.legend(fontsize=7)


def _pareto(axes: Any, *, found: dict[str, Any]) -> None:
    """Every policy and agent, filled behind the shield, open without it; both references as
    lines."""
    for name, row in found["policies"].items():
        alone = name.endswith("_without_shield")
        axes.plot(
            row["violation_s"],
            row["power_W"],
            "s",
            mfc="none" if alone else None,
            color="C1" if alone else "C0",
        )
        text = name.removesuffix("_without_shield").replace("_", " ")
        axes.annotate(text, (row["violation_s"], row["power_W"]), fontsize=6)
    for key, look in (("ddpg_all_seeds", {}), ("ddpg_all_seeds_without_shield", {"mfc": "none"})):
        rows = found[key]
        axes.plot(
            rows["violation_s_each_seed"], rows["power_W_each_seed"], ".", color="0.3", **look
        )
    for name, power in {**found["references_W"], "best fixed": found["best_fixed_W"]}.items():
        axes.axhline(power, ls="--", lw=0.8, color="0.4")
        axes.annotate(
            name, (0.98, power), xycoords=("axes fraction", "data"), fontsize=6, ha="right"
        )
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlim(left=-0.3)
    axes.set_title("open: without the shield; dots: every DDPG agent", fontsize=7)


def _agents(axes: Any, *, found: dict[str, Any]) -> None:
    """Every agent's power, the interquartile mean's interval, and the table's."""
    rows = found["ddpg_all_seeds"]
    axes.plot(range(len(rows["power_W_each_seed"])), rows["power_W_each_seed"], "o")
    axes.axhspan(*rows["power_W_iqm_interval"], alpha=0.2, label="interquartile mean, 95 %")
    axes.axhline(found["policies"]["lookup"]["power_W"], ls="--", color="0.4", label="lookup table")
    axes.legend(fontsize=7)
