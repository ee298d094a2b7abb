"""What all figures share: one look, and a caption that says what was computed."""

from __future__ import annotations

import argparse

from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, RED, GREY = "#1f5fa8", "#d9772b", "#3a8f4d", "#c0392b", "#777777"


def new_figure(size: tuple[float, float], title: str, caption: str) -> Figure:
    """A figure with a title and a caption below it."""
    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(title, fontsize=13, fontweight="bold")
    figure.supxlabel(caption, fontsize=8, color=GREY)
    return figure


def plain(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Labels, a light grid, no frame to the right and on top."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def point(options: argparse.Namespace) -> str:
    """The operating point in words."""
    return (
        f"rig {options.rig}, {options.rpm:g} rpm, {options.load:g} N, radial clearance "
        f"{options.clearance:g} µm, "
        f"{options.film} film"
    )


def limit_line(axes: Axes, value: float, text: str) -> None:
    """A limit across the axes, named at its right end."""
    axes.axhline(value, color=RED, linewidth=0.9, linestyle="--")
    place = (0.995, value)
    axes.annotate(
        text,
        place,
        xycoords=axes.get_yaxis_transform(),
        color=RED,
        fontsize=8,
        ha="right",
        va="bottom",
    )
