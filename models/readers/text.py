"""Text files of any dialect: separators, decimal comma, quotes, heads of several lines, units,
byte order marks."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from models.readers import units
from models.readers.channel_map import FileRules
from models.readers.signal_file import Channel, Floats, SignalFile, SignalFileError

SEPARATORS: Final = (";", "\t", ",", "|", " ")
LOOKED_AT: Final = 60
"""Lines by which the dialect is found, spread over the file."""
HEAD_MOST: Final = 100
"""Lines before the first row of numbers."""
MISSING: Final = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "nil"})
_BRACKET: Final = re.compile(r"^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_GROUPED: Final = re.compile(
    r"\d{1,3}(?:\.\d{3})+,\d|\d{1,3}(?:,\d{3})+\.\d|^[+-]?\d{1,3}([.,]\d{3})+$"
)
"""A number with separators of thousands."""
_RATE: Final = re.compile(
    r"(?i)\b(sampl\w*[ _-]*(?:rate|freq\w*)|fs|abtastrate|rate_hz|sample_rate)\b[^\d]*"
    r"([\d.,]+(?:e[+-]?\d+)?)\s*(k?hz)?"
)


@dataclass(frozen=True)
class Dialect:
    """How a line is cut and a number written; ``separator`` a space stands for any white space."""

    separator: str
    decimal: str
    quoted: bool

    def cut(self, line: str) -> list[str]:
        """The fields of ``line``."""
        if self.quoted:
            row = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True), [])
            return [field.strip() for field in row]
        if self.separator == " ":
            return line.split()
        return [field.strip() for field in line.split(self.separator)]

    def number(self, field: str) -> float | None:
        """The number in ``field``, NaN where it is missing; None when it is none."""
        if field.casefold() in MISSING:
            return np.nan
        try:
            plain = field.replace(",", ".") if self.decimal == "," else field
            return float(plain) if "_" not in plain else None
        except ValueError:
            return None


def read(path: Path, rules: FileRules) -> SignalFile:
    """Columns of numbers, named by the last line before them that has as many fields."""
    lines = _lines(path)
    dialect, columns = _dialect(path, lines, rules)
    first = _first_row(path, lines, dialect, columns)
    _check_head(path, lines[:first], dialect, columns)
    names, unit_of = _head([text for _, text in lines[:first]], dialect, columns)
    table = _table(path, lines[first:], dialect, names)
    numbers = np.array([number for number, _ in lines[first:]], np.intp)
    kept = [i for i in range(columns) if names[i] or np.isfinite(table[:, i]).any()]
    channels = tuple(
        Channel(names[i] or f"column {i + 1}", table[:, i], unit_of[i], lines=numbers) for i in kept
    )
    return SignalFile(path, channels, _facts([text for _, text in lines[:first]]))


def _lines(path: Path) -> list[tuple[int, str]]:
    """Lines that hold anything, with their numbers counted from 1."""
    data = path.read_bytes()
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", errors="replace")
    elif b"\x00" in data[:4096]:
        raise SignalFileError(
            f"{path.name}: holds binary data, no text; give it the suffix of its format"
        )
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
    found = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not found:
        raise SignalFileError(f"{path.name}: no line holds anything; record it again")
    return found


def _dialect(path: Path, lines: Sequence[tuple[int, str]], rules: FileRules) -> tuple[Dialect, int]:
    """The dialect in which most lines are rows of as many numbers, and that number."""
    sample = [
        lines[i][1]
        for i in np.unique(np.linspace(len(lines) // 10, len(lines) - 1, LOOKED_AT).astype(int))
    ]
    quoted = any('"' in line for line in sample)
    found: list[tuple[float, int, Dialect]] = []
    for separator in (rules.separator,) if rules.separator else SEPARATORS:
        for decimal in (rules.decimal,) if rules.decimal else (".", ","):
            if separator == decimal and not quoted:
                continue
            dialect = Dialect(separator, decimal, quoted)
            share, columns = _fit(dialect, sample)
            if share > 0.5:
                found.append((share, columns, dialect))
    if not found:
        number, line = lines[len(lines) // 2]
        hint = "separators of thousands? write without them; else " if _GROUPED.search(line) else ""
        raise SignalFileError(
            f"{path.name}: line {number}: no row of numbers: {line[:60]!r}; {hint}give separator "
            "and decimal under [file] in channels.toml, or save it as CSV"
        )
    best = max(share for share, _, _ in found)
    good = [(columns, dialect) for share, columns, dialect in found if share > best - 0.1]
    columns, dialect = max(good, key=lambda each: each[0])
    _check_comma(path, lines, columns, dialect, good)
    return dialect, columns


def _fit(dialect: Dialect, sample: Sequence[str]) -> tuple[float, int]:
    """Share of the lines that are rows of numbers with the commonest count of fields."""
    counts: Counter[int] = Counter()
    for line in sample:
        fields = dialect.cut(line)
        values = [dialect.number(field) for field in fields]
        whole = all(
            v is not None or _stamp(f) is not None for v, f in zip(values, fields, strict=True)
        )
        if whole and any(v is not None and np.isfinite(v) for v in values):
            counts[len(fields)] += 1
    if not counts:
        return 0.0, 0
    columns, count = counts.most_common(1)[0]
    return count / len(sample), columns


def _check_comma(
    path: Path,
    lines: Sequence[tuple[int, str]],
    columns: int,
    dialect: Dialect,
    good: Sequence[tuple[int, Dialect]],
) -> None:
    """Refuse ``1,5`` where nothing tells whether it is one number or two."""
    other = [(n, d) for n, d in good if d.decimal == "," and n < columns]
    if dialect.separator != "," or dialect.decimal != "." or not other:
        return
    head = [text for _, text in lines[:HEAD_MOST] if _fit(dialect, [text])[0] == 0.0]
    if head and len(dialect.cut(head[-1])) == columns:
        return
    raise SignalFileError(
        f"{path.name}: line {lines[-1][0]}: {lines[-1][1][:40]!r} may be {columns} numbers or "
        f'{other[0][0]} with decimal commas; say decimal = "," or separator = "," under [file] in '
        "channels.toml"
    )


def _first_row(path: Path, lines: Sequence[tuple[int, str]], dialect: Dialect, columns: int) -> int:
    for i, (_, text) in enumerate(lines[: HEAD_MOST + 1]):
        fields = dialect.cut(text)
        if len(fields) == columns and _fit(dialect, [text])[0] == 1.0:
            return i
    raise SignalFileError(
        f"{path.name}: no row of {columns} numbers in the first {HEAD_MOST} lines; cut its head"
    )


def _check_head(
    path: Path, head: Sequence[tuple[int, str]], dialect: Dialect, columns: int
) -> None:
    """Refuse a line of names just before the numbers that names more or fewer columns."""
    fields = dialect.cut(head[-1][1]) if head else []
    if dialect.separator != " " and len(fields) > 1 and len(fields) != columns:
        raise SignalFileError(
            f"{path.name}: line {head[-1][0]}: names {len(fields)} columns, the rows below have "
            f"{columns}; name each, or delete the line"
        )


def _head(head: Sequence[str], dialect: Dialect, columns: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns; empty where the file gives none."""
    rows = [fields for text in head if len(fields := dialect.cut(text)) == columns]
    unit_of = [""] * columns
    if len(rows) > 1 and all(not f or _bare(f) in ("-", "") or units.unit(f) for f in rows[-1]):
        unit_of = ["" if _bare(f) == "-" else _bare(f) for f in rows.pop()]
    names = rows[-1] if rows else [""] * columns
    for i, name in enumerate(names):
        found = _BRACKET.match(name)
        if found and found[1] and (units.unit(found[2]) or not unit_of[i]):
            names[i], unit_of[i] = found[1], found[2]
    count = Counter(names)
    names = [
        f"{name} (column {i})" if name and count[name] > 1 else name
        for i, name in enumerate(names, 1)
    ]
    return names, unit_of


def _bare(text: str) -> str:
    return text.strip().strip("[]()").strip()


def _facts(head: Sequence[str]) -> dict[str, float]:
    """The sampling rate, where a line before the numbers tells it."""
    for text in head:
        found = _RATE.search(text)
        if found:
            try:
                value = float(found[2].replace(",", "."))
            except ValueError:
                continue
            return {"rate_hz": value * (1e3 if (found[3] or "").lower() == "khz" else 1.0)}
    return {}


def _table(
    path: Path, lines: Sequence[tuple[int, str]], dialect: Dialect, names: Sequence[str]
) -> Floats:
    """All rows, shape (n, columns); what is missing is NaN, what is no number is refused."""
    texts = [text for _, text in lines]
    if not dialect.quoted:
        plain = [t.replace(",", ".") for t in texts] if dialect.decimal == "," else texts
        separator = None if dialect.separator == " " else dialect.separator
        try:
            table = np.loadtxt(plain, delimiter=separator, ndmin=2, comments=None)
            if table.shape[1] == len(names):
                return table
        except ValueError:
            pass  # something in it is no plain number: found below, with its place
    return np.array([_row(path, number, text, dialect, names) for number, text in lines])


def _row(path: Path, number: int, text: str, dialect: Dialect, names: Sequence[str]) -> list[float]:
    fields = dialect.cut(text)
    if len(fields) != len(names):
        raise SignalFileError(
            f"{path.name}: line {number}: {len(fields)} fields, the others have {len(names)}: "
            f"{text[:60]!r}; complete the line or delete it"
        )
    values = []
    for i, field in enumerate(fields):
        value = dialect.number(field)
        if value is None:
            value = _stamp(field)
        if value is None:
            hint = (
                "a separator of thousands? write the number without it"
                if _GROUPED.search(field)
                else "correct it, or delete the line"
            )
            raise SignalFileError(
                f"{path.name}: line {number}, {names[i] or f'column {i + 1}'}: {field[:30]!r} is "
                f"no number; {hint}"
            )
        values.append(value)
    return values


def _stamp(field: str) -> float | None:
    """Seconds since 1970 of a date and time (ISO 8601), or since midnight of a time; None when it
    is neither."""
    if len(field) < 8 or not field[0].isdigit() or ":" not in field:
        return None
    plain = field.replace(",", ".")
    try:
        if re.match(r"\d{4}-\d\d-\d\d", plain):
            whole, _, part = plain.partition(".")
            digits = re.match(r"\d*", part)
            share = float(f"0.{digits[0]}") if digits and digits[0] else 0.0
            return (datetime.fromisoformat(whole) - datetime(1970, 1, 1)).total_seconds() + share
        hours, minutes, seconds = plain.split(":")
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    except (TypeError, ValueError):
        return None
