"""Parquet by pyarrow: one file of columns, or a data set in the layout of ``bearing-datasets``.

That layout: ``metadata.parquet`` has a row for each signal (one channel of one recording), with
``signal_file``, ``signal_row_group`` and ``signal_row`` telling where under ``signals/`` its
samples stand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from models.readers import units
from models.readers.channel_map import FileRules
from models.readers.signal_file import (
    Channel,
    Floats,
    SignalFile,
    SignalFileError,
    guarded,
    library,
)

METADATA: Final = "metadata.parquet"
NEEDED: Final = (
    "recording_id",
    "channel",
    "fs",
    "fault_type",
    "signal_file",
    "signal_row_group",
    "signal_row",
)
OLD_NAMES: Final = {"condition": "fault_type", "rpm": "speed_rpm"}
"""Names of version 1 of the layout."""
_NOTHING: Final = ("", "none", "unknown", "counts", "normalized")


@dataclass(frozen=True)
class StoredRecording:
    """A recording of such a data set: its channels, and what its rows say of it."""

    file: SignalFile
    row: Mapping[str, Any]


def read(path: Path, rules: FileRules) -> SignalFile:
    """The columns of one file that hold numbers."""
    parquet = library("pyarrow.parquet", path)
    table = guarded(path, "Parquet file", lambda: parquet.read_table(path))
    channels, notes = [], []
    for name in table.column_names:
        values = guarded(
            path,
            "Parquet file",
            lambda c=name: table[c].to_numpy(zero_copy_only=False),  # type: ignore[misc]
        )
        if np.issubdtype(values.dtype, np.datetime64):
            seconds = (values - values[0]) / np.timedelta64(1, "ns") * 1e-9
            channels.append(Channel(name, np.asarray(seconds, np.float64), "s"))
        elif np.issubdtype(values.dtype, np.number):
            channels.append(Channel(name, np.asarray(values, np.float64)))
        else:
            notes.append(f"{name}: no numbers, left out")
    return SignalFile(path, tuple(channels), notes=tuple(notes))


def is_dataset(folder: Path) -> bool:
    """Whether ``folder`` is a data set in the layout of ``bearing-datasets``."""
    return (folder / METADATA).is_file() and (folder / "signals").is_dir()


def recordings(folder: Path) -> Iterator[StoredRecording]:
    """Every recording of a data set, in the order of its table.

    Raises
    ------
    SignalFileError
        The table lacks a column, or names samples that are not there.
    """
    path = folder / METADATA
    parquet = library("pyarrow.parquet", path)
    table = guarded(path, "Parquet file", lambda: parquet.read_table(path))
    columns = [
        OLD_NAMES[name] if name in OLD_NAMES and OLD_NAMES[name] not in table.column_names else name
        for name in table.column_names
    ]
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        raise SignalFileError(
            f"{path}: lacks the columns {', '.join(missing)}; build the data set again with "
            "bearing-datasets"
        )
    rows: list[dict[str, Any]] = table.rename_columns(columns).to_pylist()
    of: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        of.setdefault(str(row["recording_id"]), []).append(row)
    groups = _Groups(folder, parquet)
    for name, signals in of.items():
        yield StoredRecording(
            SignalFile(folder / name, tuple(_channel(groups, row) for row in signals)), signals[0]
        )


class _Groups:
    """The row groups of the signal files; the newest is kept, neighbours stand together."""

    def __init__(self, folder: Path, parquet: Any) -> None:
        self._folder, self._parquet = folder, parquet
        self._kept: tuple[str, int] | None = None
        self._lists: Any = None

    def samples(self, file: str, group: int, row: int) -> Floats:
        path = self._folder / "signals" / file
        if not path.is_file():
            raise SignalFileError(f"{path}: no such file; build the data set again")
        if self._kept != (file, group):
            self._lists = guarded(
                path,
                "Parquet file",
                lambda: (
                    self._parquet.ParquetFile(path)
                    .read_row_group(group, columns=["signal"])
                    .column(0)
                    .combine_chunks()
                ),
            )
            self._kept = (file, group)
        if not 0 <= row < len(self._lists):
            raise SignalFileError(f"{path}: row group {group} has no row {row}; build it again")
        values = self._lists[row].values.to_numpy(zero_copy_only=False)
        return np.asarray(values, np.float64)


def _channel(groups: _Groups, row: Mapping[str, Any]) -> Channel:
    """One signal; volts of a sensor are brought to its unit where its sensitivity is told."""
    values = groups.samples(
        str(row["signal_file"]), int(row["signal_row_group"]), int(row["signal_row"])
    )
    unit = str(row.get("unit") or "")
    words = str(row.get("sensitivity") or "none").split()
    if len(words) == 2 and "/" in words[1]:
        stored, _, physical = words[1].partition("/")
        here, volt = units.unit(unit), units.unit(stored)
        if here is not None and volt is not None and here.quantity == volt.quantity:
            values = values * here.factor / (float(words[0]) * volt.factor)
            unit = physical.strip("()")
    return Channel(str(row["channel"]), values, "" if unit in _NOTHING else unit, float(row["fs"]))
