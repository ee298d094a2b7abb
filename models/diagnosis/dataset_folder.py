"""A folder of measured recordings, as users bring it; :file:`models/diagnosis/DATASET.md` describes
the format."""

from __future__ import annotations

import csv
import hashlib
import math
import zipfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.dataset import DatasetError

TABLE: Final = "recordings.csv"
REQUIRED: Final = ("file", "label", "group", "rate_hz", "channels")
LEAST_SAMPLES: Final = 64

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredRecording:
    """One recording: samples ``(n, channels)`` in SI, its label, the group that never crosses a
    split, its machine."""

    name: str
    samples: Floats
    rate_hz: float
    channels: tuple[str, ...]
    label: str
    group: str
    machine: str = ""


def read_folder(folder: Path, group: str = "group") -> list[MeasuredRecording]:
    """Recordings of ``folder``, in the order of its table.

    Parameters
    ----------
    group
        Column that tells what must not cross a split: ``group``, or another column of the table.

    Raises
    ------
    DatasetError
        Names the file, the row, what is wrong and what to do.
    """
    rows = list(_rows(folder, group))
    if not rows:
        raise DatasetError(f"{folder / TABLE}: names no recording; add a row for each file")
    found = [_recording(folder, number, row, group) for number, row in rows]
    _check_alike(found)
    _check_spelling(found, group)
    _check_labels(found, group)
    _check_copies(found)
    return found


def _rows(folder: Path, group: str) -> Iterator[tuple[int, dict[str, str]]]:
    path = folder / TABLE
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in (*REQUIRED, group) if name not in (reader.fieldnames or ())]
            if missing:
                raise DatasetError(
                    f"{path}: lacks the columns {', '.join(missing)}; see "
                    f"models/diagnosis/DATASET.md"
                )
            yield from enumerate(reader, 2)
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(
            f"{path}: cannot be read ({error}); a dataset folder holds this table"
        ) from error


def _recording(folder: Path, number: int, row: dict[str, str], group: str) -> MeasuredRecording:
    place = f"{folder / TABLE}:{number}"
    empty = [name for name in (*REQUIRED, group) if not (row.get(name) or "").strip()]
    if empty:
        raise DatasetError(f"{place}: {', '.join(empty)} is empty; fill it or drop the row")
    channels = tuple(row["channels"].split())
    try:
        rate = float(row["rate_hz"])
    except ValueError:
        rate = math.nan
    if not 0.0 < rate < math.inf:
        raise DatasetError(
            f"{place}: rate_hz = {row['rate_hz']}: not a sampling rate; give it in hertz"
        )
    samples = _samples(folder / row["file"], place)
    if samples.ndim != 2 or samples.shape[1] != len(channels):
        raise DatasetError(
            f"{place}: {row['file']} has shape {samples.shape}, the table names {len(channels)} "
            f"channels; "
            "one column a channel, one row an instant"
        )
    if len(samples) < LEAST_SAMPLES:
        raise DatasetError(
            f"{place}: {row['file']} has {len(samples)} samples, at least {LEAST_SAMPLES} are "
            f"needed"
        )
    bad = np.argwhere(~np.isfinite(samples))
    if len(bad):
        raise DatasetError(
            f"{place}: {row['file']}: {len(bad)} samples are not finite, the first in row "
            f"{bad[0][0]}, channel "
            f"{channels[bad[0][1]]}; cut them out or drop the recording"
        )
    return MeasuredRecording(
        row["file"],
        samples,
        rate,
        channels,
        row["label"].strip(),
        row[group].strip(),
        (row.get("machine") or "").strip(),
    )


def _samples(path: Path, place: str) -> Floats:
    """``samples`` of an .npz, or the columns of a .csv with one line of names."""
    try:
        if path.suffix == ".npz":
            with np.load(path) as stored:
                return np.asarray(stored["samples"], np.float64)
        if path.suffix == ".csv":
            return np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise DatasetError(
            f"{place}: {path} cannot be read ({error}); see models/diagnosis/DATASET.md"
        ) from error
    raise DatasetError(f"{place}: {path.name}: neither .npz nor .csv; save it as one of them")


def _check_alike(found: list[MeasuredRecording]) -> None:
    """Refuse mixed rates and channels: features of one are not those of another."""
    for what in ("rate_hz", "channels"):
        values = Counter(getattr(recording, what) for recording in found)
        if len(values) > 1:
            odd = next(r for r in found if getattr(r, what) != values.most_common(1)[0][0])
            raise DatasetError(
                f"{odd.name}: {what} = {getattr(odd, what)}, most recordings have "
                f"{values.most_common(1)[0][0]}; "
                "bring all to one, or make a folder for each"
            )


def _check_spelling(found: list[MeasuredRecording], group: str) -> None:
    """Refuse labels and groups that a person means as one: 20 and 20.0 would stand on both sides of
    a split."""
    for what, column in (("label", "label"), ("group", group)):
        spelled: dict[str, str] = {}
        for recording in found:
            value = getattr(recording, what)
            other = spelled.setdefault(_meant(value), value)
            if other != value:
                raise DatasetError(
                    f"{recording.name}: {column} {value!r}, another recording has {other!r}: spell "
                    f"them "
                    "alike if they are one, or tell them apart by more"
                )


def _meant(value: str) -> str:
    """The same for all spellings of one number or word."""
    try:
        return repr(float(value))
    except ValueError:
        return " ".join(value.casefold().replace("_", " ").replace("-", " ").split())


def _check_copies(found: list[MeasuredRecording]) -> None:
    """Refuse the same samples twice: under two labels one is wrong, under two groups both sides
    would hold them."""
    seen: dict[bytes, MeasuredRecording] = {}
    for recording in found:
        first = seen.setdefault(hashlib.sha256(recording.samples.tobytes()).digest(), recording)
        if first is not recording:
            raise DatasetError(
                f"{recording.name}: the same samples as {first.name} (label {first.label}, group "
                f"{first.group}); keep one of them"
            )


def _check_labels(found: list[MeasuredRecording], group: str) -> None:
    names = Counter(recording.name for recording in found)
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise DatasetError(
            f"{twice[0]}: stands {names[twice[0]]} times in the table; each file once, with one "
            f"label"
        )
    labels = Counter(recording.label for recording in found)
    if len(labels) < 2:
        raise DatasetError(
            f"only one label ({found[0].label}): there is nothing to tell apart; add another class"
        )
    for label, count in labels.items():
        if count < 2:
            raise DatasetError(
                f"label {label} has {count} recording, 2 are needed: record more or leave it out"
            )
    if len({recording.group for recording in found}) < 2:
        raise DatasetError(
            f"only one {group} ({found[0].group}): nothing can be left out for judging"
        )
