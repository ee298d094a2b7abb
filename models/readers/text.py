"""Text files of any dialect: separators, decimal comma, quotes, heads of several lines, units,
byte order marks."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    """How a line is cut and a number written; ``separator`` a space stands for any white space.

    ``columns`` is how many fields a row has, ``numeric`` which of them hold numbers or times.
    """

    separator: str
    decimal: str
    quoted: bool
    columns: int = 0
    numeric: tuple[int, ...] = ()

    def cut(self, line: str) -> list[str]:
        """The fields of ``line``."""
        if self.quoted:
            row = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True), [])
            return [field.strip() for field in row]
        if self.separator == " ":
            return line.split()
        return [field.strip() for field in line.split(self.separator)]

    def number(self, field: str) -> float | None:
        """The number or time in ``field``, NaN where it is missing; None when it is neither."""
        if field.casefold() in MISSING:
            return np.nan
        try:
            plain = field.replace(",", ".") if self.decimal == "," else field
            return float(plain) if "_" not in plain else None
        except ValueError:
            return _stamp(field)

    def is_row(self, fields: Sequence[str]) -> bool:
        """Whether ``fields`` are a row of numbers."""
        if len(fields) != self.columns:
            return False
        values = [self.number(fields[i]) for i in self.numeric]
        return None not in values and any(v is not None and np.isfinite(v) for v in values)


def read(path: Path, rules: FileRules) -> SignalFile:
    """Columns of numbers, named by the last line before them; columns of text are noted."""
    lines = _lines(path)
    dialect = _dialect(path, lines, rules)
    first = _first_row(path, lines, dialect)
    head = [dialect.cut(text) for _, text in lines[:first]]
    notes = _check_head(path, lines[:first], dialect)
    names, unit_of = _head(head, dialect.columns)
    table = _table(path, lines[first:], dialect, names)
    numbers = np.array([number for number, _ in lines[first:]], np.intp)
    kept = [i for i in dialect.numeric if names[i] or np.isfinite(table[:, i]).any()]
    channels = tuple(
        Channel(names[i] or f"column {i + 1}", table[:, i], unit_of[i], lines=numbers) for i in kept
    )
    left = [i for i in range(dialect.columns) if i not in dialect.numeric]
    _check_text(path, lines[first:], dialect, names, left)
    notes += [f"{names[i] or f'column {i + 1}'}: text, left out" for i in left]
    facts = _facts([text for _, text in lines[:first]])
    return SignalFile(path, channels, facts, notes=tuple(notes))


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


def _dialect(path: Path, lines: Sequence[tuple[int, str]], rules: FileRules) -> Dialect:
    """The dialect in which most lines are rows of as many fields, and most of those numbers."""
    places = np.linspace(len(lines) // 10, len(lines) - 1, LOOKED_AT).astype(int)
    sample = [lines[i][1] for i in np.unique(places)]
    quoted = any('"' in line for line in sample)
    found: list[tuple[float, float, Dialect]] = []
    for separator in (rules.separator,) if rules.separator else SEPARATORS:
        for decimal in (rules.decimal,) if rules.decimal else (".", ","):
            if separator == decimal and not quoted:
                continue
            alike, dialect = _fitted(Dialect(separator, decimal, quoted), sample)
            if alike > 0.5 and dialect.numeric:
                found.append((alike, len(dialect.numeric) / dialect.columns, dialect))
    if not found:
        number, line = lines[len(lines) // 2]
        hint = "separators of thousands? write without them; else " if _GROUPED.search(line) else ""
        raise SignalFileError(
            f"{path.name}: line {number}: no row of numbers: {line[:60]!r}; {hint}give separator "
            "and decimal under [file] in channels.toml, or save it as CSV"
        )
    best = max(alike for alike, _, _ in found)
    found = [each for each in found if each[0] > best - 0.1]
    purest = max(pure for _, pure, _ in found)
    good = [dialect for _, pure, dialect in found if pure == purest]
    dialect = max(good, key=lambda each: each.columns)
    _check_comma(path, lines, dialect, good)
    return dialect


def _fitted(dialect: Dialect, sample: Sequence[str]) -> tuple[float, Dialect]:
    """Share of the lines with the commonest count of fields, and the dialect with that count and
    the columns that are numbers in most of them."""
    rows = [dialect.cut(line) for line in sample]
    columns, count = Counter(map(len, rows)).most_common(1)[0]
    rows = [row for row in rows if len(row) == columns]
    numeric = []
    for i in range(columns):
        values = [dialect.number(row[i]) for row in rows]
        if sum(v is not None for v in values) > 0.5 * len(rows):
            numeric.append(i)
    holds = any(
        np.isfinite(v) for i in numeric for r in rows if (v := dialect.number(r[i])) is not None
    )
    return count / len(sample), replace(
        dialect, columns=columns, numeric=tuple(numeric) if holds else ()
    )


def _check_comma(
    path: Path, lines: Sequence[tuple[int, str]], dialect: Dialect, good: Sequence[Dialect]
) -> None:
    """Refuse ``1,5`` where nothing tells whether it is one number or two."""
    other = [each for each in good if each.decimal == "," and each.columns < dialect.columns]
    if dialect.separator != "," or dialect.decimal != "." or not other:
        return
    head = [f for _, text in lines[:HEAD_MOST] if not dialect.is_row(f := dialect.cut(text))]
    if head and len(head[-1]) == dialect.columns:
        return
    raise SignalFileError(
        f"{path.name}: line {lines[-1][0]}: {lines[-1][1][:40]!r} may be {dialect.columns} numbers "
        f'or {other[0].columns} with decimal commas; say decimal = "," or separator = "," under '
        "[file] in channels.toml"
    )


def _first_row(path: Path, lines: Sequence[tuple[int, str]], dialect: Dialect) -> int:
    for i, (_, text) in enumerate(lines[: HEAD_MOST + 1]):
        if dialect.is_row(dialect.cut(text)):
            return i
    raise SignalFileError(
        f"{path.name}: no row of {dialect.columns} numbers in the first {HEAD_MOST} lines; cut its "
        "head"
    )


def _check_head(path: Path, head: Sequence[tuple[int, str]], dialect: Dialect) -> list[str]:
    """Refuse a line just before the numbers that names fewer columns; names beyond the last column
    are noted."""
    fields = dialect.cut(head[-1][1]) if head else []
    if dialect.separator == " " or len(fields) < 2:
        return []
    if len(fields) < dialect.columns:
        raise SignalFileError(
            f"{path.name}: line {head[-1][0]}: names {len(fields)} columns, the rows below have "
            f"{dialect.columns}; name each, or delete the line"
        )
    return [f"{name}: named, but has no column" for name in fields[dialect.columns :] if name]


def _check_text(
    path: Path,
    lines: Sequence[tuple[int, str]],
    dialect: Dialect,
    names: Sequence[str],
    left: Sequence[int],
) -> None:
    """Refuse a column that is text only because of its separators of thousands."""
    number, text = lines[0]
    fields = dialect.cut(text)
    for i in left:
        if _GROUPED.search(fields[i]) and not re.search(r"[A-Za-z:]", fields[i]):
            raise SignalFileError(
                f"{path.name}: line {number}, {names[i] or f'column {i + 1}'}: {fields[i]!r} is no "
                "number; a separator of thousands? write the number without it"
            )


def _head(head: Sequence[list[str]], columns: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns; empty where the file gives none."""
    rows = [fields[:columns] for fields in head if len(fields) >= columns]
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
    """All rows, shape (n, columns); what is missing, and text, is NaN, what should be a number and
    is none is refused."""
    texts = [text for _, text in lines]
    if not dialect.quoted and len(dialect.numeric) == dialect.columns:
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
    values = [np.nan] * len(fields)
    for i in dialect.numeric:
        value = dialect.number(fields[i])
        if value is None:
            hint = (
                "a separator of thousands? write the number without it"
                if _GROUPED.search(fields[i])
                else "correct it, or delete the line"
            )
            raise SignalFileError(
                f"{path.name}: line {number}, {names[i] or f'column {i + 1}'}: {fields[i][:30]!r} "
                f"is no number; {hint}"
            )
        values[i] = value
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
