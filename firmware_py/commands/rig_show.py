"""``orbitd rig show RIG``: what an engineer checks first, each table with what it is good for.

Film, stiffness, whirl, admissible clearances and the error budget are those of the guard's own
laws; damping and critical speeds need the extra `sim`.
"""

from __future__ import annotations

import argparse
import sys

import msgspec
from rich.console import Console
from rich.table import Table

from firmware_py import launch
from firmware_py.commands.rig_figures import Cell, RigFigures
from firmware_py.commands.rig_tables import tables

WIDTH = 140
"""Columns where the output is no terminal."""


def run(options: argparse.Namespace) -> int:
    """Print the tables, or all of them as JSON."""
    config, _ = launch.verified(options.rig)
    found = list(tables(config))
    figures = [each for each in found if isinstance(each, RigFigures)]
    left_out = [each for each in found if isinstance(each, str)]
    if options.json:
        out = {
            "rig": config.device.rig,
            "machine": config.machine.name,
            "tables": {each.key: each._asdict() for each in figures},
            "left_out": left_out,
        }
        sys.stdout.write(msgspec.json.encode(out).decode() + "\n")
        return 0
    console = Console(width=None if Console().is_terminal else WIDTH, highlight=False)
    for each in figures:
        console.print(_table(each), "")
    for line in left_out:
        console.print(line, markup=False)
    return 0


def _table(figures: RigFigures) -> Table:
    table = Table(
        title=figures.title, caption=figures.meaning, title_justify="left",
        caption_justify="left", show_edge=False,
    )  # fmt: skip
    for i, name in enumerate(figures.columns):
        text = i == 0 or any(isinstance(row[i], str) for row in figures.rows)
        table.add_column(name, justify="left" if text else "right")
    for row in figures.rows:
        table.add_row(*map(_cell, row))
    return table


def _cell(value: Cell) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{value:.0f}" if 1000.0 <= abs(value) < 1e5 else f"{value:.3g}"
