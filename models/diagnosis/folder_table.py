"""What a folder of recordings says of each: its table, the names of its subfolders, or the rows of
a Parquet data set."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from models.diagnosis.dataset import DatasetError
from models.readers import READERS
from models.readers.channel_map import FILE_NAME

TABLE: Final = "recordings.csv"
REQUIRED: Final = ("file", "label")
DEFAULT_GROUP: Final = "group"
SUFFIXES: Final = tuple(READERS)


@dataclass(frozen=True)
class AnnouncedRecording:
    """One recording as it is announced; ``place`` is where, for messages.

    ``columns`` holds every column of the table; ``rate_hz`` and ``rpm`` are None where it tells
    none, ``channels`` is empty then.
    """

    place: str
    file: str
    label: str
    group: str
    machine: str = ""
    rate_hz: float | None = None
    rpm: float | None = None
    channels: tuple[str, ...] = ()
    span_s: tuple[float, float] = (0.0, math.inf)
    columns: Mapping[str, str] = field(default_factory=dict)


def rows_of(folder: Path, group: str) -> tuple[list[AnnouncedRecording], list[str]]:
    """Rows of the table in ``folder`` and what is wrong with others; without a table, one row a
    file with its subfolder as label.

    Parameters
    ----------
    group
        Column that tells what must not cross a split.  Without a column of the default name every
        file is a group of its own.

    Raises
    ------
    DatasetError
        Nothing of the table can be used, or there is neither table nor subfolder.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder; give the folder of the recordings")
    if not (folder / TABLE).is_file():
        return list(_by_subfolder(folder, group)), []
    rows: list[AnnouncedRecording] = []
    problems: list[str] = []
    for number, cells in _cells(folder / TABLE, group):
        try:
            rows.append(_row(f"{folder / TABLE}:{number}", cells, group))
        except DatasetError as error:
            problems.append(str(error))
    if not rows and not problems:
        raise DatasetError(f"{folder / TABLE}: names no recording; add a row for each file")
    return rows, problems


def _by_subfolder(folder: Path, group: str) -> Iterator[AnnouncedRecording]:
    files = signal_files(folder)
    flat = [path for path in files if path.parent == folder]
    if not files:
        raise DatasetError(
            f"{folder}: no recording in it (looked for {', '.join(SUFFIXES)}); give the folder "
            "that holds the files, or one subfolder a class"
        )
    if flat:
        raise DatasetError(
            f"{folder}: no {TABLE}, and {flat[0].name} lies in no subfolder, so its class is not "
            f"known; `orbitd dataset {folder} --write` writes a table to fill in, or put the files "
            "of each class into a subfolder of its name"
        )
    if group != DEFAULT_GROUP:
        raise DatasetError(
            f"{folder}: no {TABLE}, so there is no column {group!r}; `orbitd dataset {folder} "
            "--write` writes a table: add the column there"
        )
    for path in files:
        name = path.relative_to(folder)
        yield AnnouncedRecording(str(path), str(name), name.parts[0], str(name))


def signal_files(folder: Path) -> list[Path]:
    """Files under ``folder`` that a reader knows, in the order of their names."""
    return sorted(
        path
        for path in folder.rglob("*")
        if path.is_file()
        and path.suffix.lower() in SUFFIXES
        and path.name not in (TABLE, FILE_NAME)
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    )


def _cells(path: Path, group: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Number and cells of every line; separated by comma, semicolon or tab."""
    data = path.read_bytes()
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    lines = text.splitlines()
    head = lines[0] if lines else ""
    separator = max(",;\t", key=head.count)
    names = [name.strip().casefold() for name in next(csv.reader([head], delimiter=separator), [])]
    needed = REQUIRED if group == DEFAULT_GROUP else (*REQUIRED, group.casefold())
    missing = [name for name in needed if name not in names]
    if missing:
        raise DatasetError(
            f"{path}: lacks the columns {', '.join(missing)}; its first line names "
            f"{', '.join(filter(None, names)) or 'none'}; see docs/recordings.md"
        )
    for number, row in enumerate(csv.reader(lines[1:], delimiter=separator), 2):
        if any(cell.strip() for cell in row):
            yield number, dict(zip(names, (cell.strip() for cell in row), strict=False))


def _row(place: str, cells: Mapping[str, str], group: str) -> AnnouncedRecording:
    column = group.casefold()
    needed = [*REQUIRED, *([column] if column in cells else [])]
    empty = [name for name in needed if not cells.get(name)]
    if empty:
        raise DatasetError(f"{place}: {', '.join(empty)} is empty; fill it or drop the row")
    return AnnouncedRecording(
        place,
        cells["file"],
        cells["label"],
        cells.get(column) or cells["file"],
        cells.get("machine", ""),
        _number(place, cells, "rate_hz", "not a sampling rate; give it in hertz"),
        _number(place, cells, "speed_rpm", "not a speed; give it in revolutions a minute"),
        tuple(cells.get("channels", "").split()),
        (
            _number(place, cells, "start_s", "not a time; give seconds", 0.0) or 0.0,
            _number(place, cells, "end_s", "not a time; give seconds", 0.0) or math.inf,
        ),
        cells,
    )


def _number(
    place: str, cells: Mapping[str, str], name: str, why: str, least: float = 1e-9
) -> float | None:
    """The number in the column ``name``, whose decimals may stand behind a comma; None: empty."""
    text = cells.get(name, "")
    if not text:
        return None
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if not least <= value < math.inf:
        raise DatasetError(f"{place}: {name} = {text}: {why}")
    return value
