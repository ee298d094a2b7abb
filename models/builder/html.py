"""Parts of a page that opens anywhere, offline: tables and bars, nothing loaded from elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}
h1{font-size:1.6em}h2{margin-top:2em;border-bottom:1px solid #ccc}
table{border-collapse:collapse;margin:.6em 0}
td,th{padding:.15em .7em;border-bottom:1px solid #e4e4e4;text-align:left;vertical-align:top}
td.n{text-align:right;font-variant-numeric:tabular-nums}
.trial,.warn{background:#fff3cd;border:1px solid #e0c36a;padding:.7em 1em}
.quiet{color:#666}svg text{font:12px system-ui,sans-serif}
"""


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page."""
    head = f"<title>{escape(title)}</title><style>{STYLE}</style>"
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">{head}</head>\n'
        f"<body>\n<h1>{escape(title)}</h1>\n{body}\n</body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """A heading with what stands below it."""
    return f"<h2>{escape(title)}</h2>\n" + "\n".join(parts)


def text(words: str, look: str = "") -> str:
    """A paragraph; ``look``: class of its style."""
    return f'<p class="{look}">{escape(words)}</p>' if look else f"<p>{escape(words)}</p>"


def shown(value: Any) -> str:
    """A figure as people read it."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return " .. ".join(shown(each) for each in value) if value else "none"
    return str(value)


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table; numbers stand to the right."""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "\n".join(f"<tr>{''.join(_cell(value) for value in row)}</tr>" for row in rows)
    return f"<table><tr>{top}</tr>\n{body}</table>"


def _cell(value: Any) -> str:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"<td{' class=n' if number else ''}>{escape(shown(value))}</td>"


def listed(figures: Mapping[str, Any]) -> str:
    """Nested figures as rows of dotted names."""
    return table(("figure", "value"), list(_flat(figures)))


def _flat(figures: Mapping[str, Any], above: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in figures.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key}: ")
        else:
            yield f"{above}{key}".replace("_", " "), value


def bars(
    rows: Sequence[tuple[str, float | None]], most: float, mark: float | None = None, unit: str = ""
) -> str:
    """Horizontal bars from 0 to ``most``, with a line at ``mark``."""
    left, wide, high = 330, 420, 20
    tall = high * len(rows) + 8
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + wide + 90}" height="{tall}" '
        'role="img">'
    ]
    for i, (name, value) in enumerate(rows):
        y = i * high + 4
        out.append(f'<text x="{left - 8}" y="{y + 13}" text-anchor="end">{escape(name)}</text>')
        if value is None or not math.isfinite(value):
            out.append(f'<text x="{left + 4}" y="{y + 13}">–</text>')
            continue
        width = wide * min(max(value / most, 0.0), 1.0)
        out.append(
            f'<rect x="{left}" y="{y + 2}" width="{width:.1f}" height="{high - 6}" fill="#4477aa"/>'
        )
        out.append(
            f'<text x="{left + width + 5:.1f}" y="{y + 13}">{escape(shown(value))}{unit}</text>'
        )
    if mark is not None:
        x = left + wide * mark / most
        out.append(
            f'<line x1="{x:.1f}" y1="0" x2="{x:.1f}" y2="{tall}" stroke="#cc3311" '
            'stroke-dasharray="4 3"/>'
        )
    return "".join([*out, "</svg>"])
