"""One labelled panel as PNG; the figures of a run are made of these."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot


def panel(path: Path, draw: Callable[[Any], None], *, x: str, y: str) -> None:
    """One labelled panel as PNG."""
    figure, axes = pyplot.subplots(figsize=(6.0, 4.0), layout="constrained")
    draw(axes)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
