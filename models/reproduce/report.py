"""The report: one HTML page that holds its figures, and the same rows as JSON."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from matplotlib.figure import Figure

from models import ARTIFACTS
from models.reproduce.claims import MISPRINTS, OPEN, PAPER

_BARS = ("model", "figure", "reached", "bar", "holds")

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em;
color: #222; }
table { border-collapse: collapse; width: 100%; margin: 1em 0; }
td, th { border-bottom: 1px solid #ddd; padding: .4em .6em; text-align: left; vertical-align: top; }
th { background: #f5f5f5; } img { max-width: 100%; }
code { background: #f5f5f5; padding: .1em .3em; } figcaption { color: #555; font-size: 13px; }
"""


@dataclass(frozen=True)
class ClaimRow:
    """One claim: as printed, by the paper's own method, by ours, what must be known, and what
    judges ours further."""

    series: str
    claim: str
    paper_method: str
    our_method: str
    caveat: str
    command: str


@dataclass(frozen=True)
class Series:
    """What one series of tests gives: rows of the table, all figures behind them, and drawings with
    captions."""

    title: str
    rows: Sequence[ClaimRow]
    measured: dict[str, object]
    drawings: Sequence[tuple[Figure, str]]


def write(out: Path, series: Sequence[Series], command: str, seconds: float) -> Path:
    """``report.html`` and ``report.json`` in ``out``; returns the page."""
    out.mkdir(parents=True, exist_ok=True)
    series = [
        replace(one, rows=[_with_command(row, command) for row in one.rows]) for one in series
    ]
    table = {
        "paper": PAPER,
        "command": command,
        "claims": [asdict(row) for one in series for row in one.rows],
        "shipped": [dict(zip(_BARS, bar, strict=True)) for bar in shipped()],
        "measured": {one.title: one.measured for one in series},
        "misprints": [dict(zip(("where", "printed", "repair"), m, strict=True)) for m in MISPRINTS],
        "open": OPEN,
    }
    (out / "report.json").write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")
    page = out / "report.html"
    page.write_text(_page(series, command, seconds), encoding="utf-8")
    return page


def _with_command(row: ClaimRow, command: str) -> ClaimRow:
    return replace(row, command=f"{command}; {row.command}")


def shipped(artifacts: Path = ARTIFACTS) -> list[tuple[str, ...]]:
    """Every bar of the shipped models as their frozen evaluation left it: model, figure, reached,
    bar, holds."""
    rows: list[tuple[str, ...]] = []
    for path in sorted(artifacts.glob("*.json")):
        verdict = json.loads(path.read_text(encoding="utf-8")).get("frozen_evaluation")
        for bar in verdict["bars"] if verdict else ():
            limits = (
                f"{word} {bar[word]:g}" for word in ("least", "most") if bar[word] is not None
            )
            reached = "not given" if bar["reached"] is None else f"{bar['reached']:.4g}"
            rows.append(
                (
                    path.stem,
                    bar["figure"],
                    reached,
                    ", ".join(limits),
                    "yes" if bar["holds"] else "no",
                )
            )
    return rows


def _page(series: Sequence[Series], command: str, seconds: float) -> str:
    rows = [list(asdict(row).values()) for one in series for row in one.rows]
    parts = [
        "<!doctype html><html lang=en><head><meta charset=utf-8><title>The paper, "
        "reproduced</title>",
        f"<style>{_STYLE}</style></head><body><h1>The paper, reproduced</h1>",
        f"<p>{html.escape(PAPER)}. Rig <code>seed</code>, simulated. Made by "
        f"<code>{html.escape(command)}</code> in ",
        f"{seconds:.0f} s.</p>",
        _table(
            ("series", "claim as printed", "the paper's own method", "ours", "caveat", "command"),
            rows,
        ),
        *(_section(one) for one in series),
        "<h2>Misprints and their repairs</h2>",
        _table(("where", "as printed", "repair"), MISPRINTS),
        "<h2>What the paper leaves open</h2><ul>",
        *(f"<li>{html.escape(text)}</li>" for text in OPEN),
        "</ul>",
        "<h2>The models that ship, on rig bench</h2><p><code>orbitd evaluate MODEL "
        "--qualify</code></p>",
        _table(_BARS, shipped()),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _section(series: Series) -> str:
    drawn = (
        f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{_png(figure)}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        for figure, caption in series.drawings
    )
    numbers = html.escape(json.dumps(series.measured, indent=2))
    return (
        f"<h2>{html.escape(series.title)}</h2>{''.join(drawn)}<details><summary>all "
        f"figures</summary><pre>{numbers}</pre></details>"
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    cells = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    heads = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    return f"<table><tr>{heads}</tr>{cells}</table>"


def _png(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return base64.b64encode(buffer.getvalue()).decode()
