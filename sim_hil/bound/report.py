"""The bound as tables."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from sim_hil.bound.study import FIXED, NOMINAL, Entry

BASELINES = (NOMINAL, FIXED)
_COLUMNS = (
    "way",
    "clearance",
    "pressure",
    "mean power",
    "film >=",
    "orbit <=",
    "violation",
    "vs nominal",
    "vs best fixed",
)
_TEXTS = 3


def savings(entry: Entry, entries: list[Entry]) -> dict[str, float]:
    """Share of power saved against each baseline."""
    return {
        base.name: 1 - entry.verdict.mean_power_W / base.verdict.mean_power_W
        for base in entries
        if base.name in BASELINES
    }


def show(results: dict[str, list[Entry]]) -> None:
    """Print a table for each case."""
    console = Console(width=None if Console().is_terminal else 150)
    for title, entries in results.items():
        table = Table(title=title, title_justify="left", show_edge=False)
        for i, name in enumerate(_COLUMNS):
            table.add_column(name, justify="left" if i < _TEXTS else "right")
        for entry in entries:
            table.add_row(*_cells(entry, savings(entry, entries)))
        console.print(table, "")


def _cells(entry: Entry, saving: dict[str, float]) -> list[str]:
    v = entry.verdict
    return [
        entry.name,
        _span(entry.clearance_m, 1e6, "um"),
        _span(entry.pressure_Pa, 1e-5, "bar"),
        f"{v.mean_power_W:.2f} W",
        f"{v.min_film_m * 1e6:.2f} um",
        f"{100 * v.orbit_share:.1f} % c",
        f"{v.violation_s:.2f} s",
        *(f"{-100 * saving[b]:+.2f} %" if b in saving else "-" for b in BASELINES),
    ]


def _span(bounds: tuple[float, float], scale: float, unit: str) -> str:
    low, high = (f"{scale * bound:.3g}" for bound in bounds)
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"
