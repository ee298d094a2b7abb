"""A folder of measured recordings, as users bring it; ``docs/recordings.md`` describes what it may
hold."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models import readers
from models.diagnosis.dataset import DatasetError
from models.diagnosis.folder_table import DEFAULT_GROUP, AnnouncedRecording, rows_of
from models.readers import parquet
from models.readers.assemble import EvenSamples, assemble
from models.readers.channel_map import FILE_NAME, FileMap, read_map
from models.readers.signal_file import SignalFileError

LEAST_SAMPLES: Final = 64
PROBLEMS_MOST: Final = 20
"""Problems that are named one by one."""
NORMAL: Final = "normal"
"""Label of a machine in good order."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredRecording:
    """One recording: samples ``(n, channels)`` in SI, its label, the group that never crosses a
    split, its machine.

    ``units`` are SI, empty where not known; ``turns`` ``(n,)`` is the shaft's angle in turns, None
    where neither mark nor speed is known.
    """

    name: str
    samples: Floats
    rate_hz: float
    channels: tuple[str, ...]
    label: str
    group: str
    machine: str = ""
    units: tuple[str, ...] = ()
    turns: Floats | None = None
    notes: tuple[str, ...] = ()
    file: str = ""

    @property
    def fingerprint(self) -> str:
        """Short name of the samples, by all of their content."""
        return hashlib.sha256(np.ascontiguousarray(self.samples).tobytes()).hexdigest()[:16]


def read_folder(
    folder: Path, group: str = DEFAULT_GROUP, channels: Path | None = None
) -> list[MeasuredRecording]:
    """Recordings of ``folder``, in the order of its table.

    Parameters
    ----------
    group
        Column that tells what must not cross a split: ``group``, or another column of the table.
    channels
        Channel map; default: ``channels.toml`` of the folder, where it has one.

    Raises
    ------
    DatasetError
        Every problem at once, each with file, place, cause and next step.
    """
    found, problems = scan_folder(folder, group, channels)
    if problems:
        raise DatasetError(listed(problems))
    return named_normal(found)


def scan_folder(
    folder: Path, group: str = DEFAULT_GROUP, channels: Path | None = None
) -> tuple[list[MeasuredRecording], list[str]]:
    """What can be read, and all that is wrong, with a file or between files; as
    :func:`read_folder`, which refuses the folder then."""
    plan = plan_of(folder, channels)
    if parquet.is_dataset(folder):
        found, problems = _all(_stored(folder, group, plan))
    else:
        rows, problems = rows_of(folder, group)
        found, more = _all((row, _reading(folder, row, plan)) for row in rows)
        problems = [*problems, *more]
    return found, [*problems, *_disagreements(found, group, whole=not problems)]


def plan_of(folder: Path, channels: Path | None) -> FileMap:
    """The channel map of ``folder``.

    Raises
    ------
    DatasetError
        It is wrong, or the one named is not there.
    """
    path = channels or folder / FILE_NAME
    if channels is None and not path.is_file():
        return FileMap()
    try:
        return read_map(path)
    except SignalFileError as error:
        raise DatasetError(str(error)) from error


def listed(problems: Sequence[str]) -> str:
    """All problems as one text; one alone stands without a head."""
    each = [line for problem in problems for line in problem.splitlines()]
    if len(each) == 1:
        return each[0]
    shown = [f"  {line}" for line in each[:PROBLEMS_MOST]]
    more = [f"  and {len(each) - PROBLEMS_MOST} more"] if len(each) > PROBLEMS_MOST else []
    return "\n".join([f"{len(each)} problems:", *shown, *more])


def _all(
    announced: Iterator[tuple[AnnouncedRecording, Callable[[], EvenSamples]]],
) -> tuple[list[MeasuredRecording], list[str]]:
    found: list[MeasuredRecording] = []
    problems: list[str] = []
    try:
        for row, make in announced:
            try:
                found.append(_recording(row, make()))
            except SignalFileError as error:
                problems += [_placed(row, line) for line in str(error).splitlines()]
    except SignalFileError as error:
        problems.append(str(error))
    return found, problems


def _placed(row: AnnouncedRecording, line: str) -> str:
    """``line`` with the place of its recording; where that ends in the file's name, once."""
    name = Path(row.file).name
    return f"{row.place}: {line.removeprefix(f'{name}: ') if row.place.endswith(name) else line}"


def _reading(folder: Path, row: AnnouncedRecording, plan: FileMap) -> Callable[[], EvenSamples]:
    return lambda: assemble(
        readers.read(folder / row.file, plan.file),
        plan,
        rate_hz=row.rate_hz,
        rpm=row.rpm,
        span_s=row.span_s,
        names=row.channels,
    )


def _stored(
    folder: Path, group: str, plan: FileMap
) -> Iterator[tuple[AnnouncedRecording, Callable[[], EvenSamples]]]:
    """The recordings of a Parquet data set: ``fault_type`` is the label, ``bearing_id`` the group
    where there is one."""
    for each in parquet.recordings(folder):
        row, name = each.row, str(each.file.path.name)
        column = "bearing_id" if group == DEFAULT_GROUP and "bearing_id" in row else group
        if column not in row and group != DEFAULT_GROUP:
            raise SignalFileError(
                f"{folder / parquet.METADATA}: lacks the column {group}; it has {', '.join(row)}"
            )
        rpm = row.get("speed_rpm")
        yield (
            AnnouncedRecording(
                f"{folder.name}/{name}",
                name,
                str(row["fault_type"]),
                str(row.get(column, name)),
                str(row.get("dataset", "")),
                rpm=float(rpm) if rpm else None,
            ),
            lambda file=each.file, rpm=rpm: assemble(  # type: ignore[misc]
                file, plan, rpm=float(rpm) if rpm else None
            ),
        )


def _recording(row: AnnouncedRecording, samples: EvenSamples) -> MeasuredRecording:
    if len(samples.values) < LEAST_SAMPLES:
        raise SignalFileError(
            f"{row.file} has {len(samples.values)} samples, at least {LEAST_SAMPLES} are needed"
        )
    name = row.file
    if row.span_s[0] > 0.0 or row.span_s[1] < np.inf:
        name = f"{row.file} from {row.span_s[0]:g} s"
    return MeasuredRecording(
        name,
        samples.values,
        samples.rate_hz,
        samples.names,
        row.label,
        row.group,
        row.machine,
        samples.units,
        samples.turns,
        samples.notes,
        row.file,
    )


def _disagreements(found: list[MeasuredRecording], group: str, *, whole: bool) -> Iterator[str]:
    """What does not fit together; ``whole``: nothing is missing, so that labels can be counted."""
    for check in (_alike, _spelling, _copies, _rows_of_files):
        yield from check(found, group)
    if whole:
        yield from _labels(found, group)


def _alike(found: list[MeasuredRecording], group: str) -> Iterator[str]:
    """Mixed rates, channels and units: features of one are not those of another."""
    for what, words in (
        ("channels", "bring all to one in channels.toml, or make a folder for each"),
        ("units", "say the unit of each channel in channels.toml"),
        ("rate_hz", "bring all to one: resample_hz = {least} under [file] in channels.toml"),
    ):
        values = Counter(getattr(recording, what) for recording in found)
        if len(values) < 2:
            continue
        usual = values.most_common(1)[0][0]
        least = f"{min(r.rate_hz for r in found):g}"
        for odd in (r for r in found if getattr(r, what) != usual):
            yield (
                f"{odd.name}: {what} = {getattr(odd, what)}, most recordings have {usual}; "
                f"{words.format(least=least)}"
            )


def _spelling(found: list[MeasuredRecording], group: str) -> Iterator[str]:
    """Labels and groups that a person means as one: 20 and 20.0 would stand on both sides of a
    split."""
    for what, column in (("label", "label"), ("group", group)):
        spelled: dict[str, str] = {}
        for recording in found:
            value = getattr(recording, what)
            other = spelled.setdefault(_meant(value), value)
            if other != value:
                yield (
                    f"{recording.name}: {column} {value!r}, another recording has {other!r}: spell "
                    "them alike if they are one, or tell them apart by more"
                )


def _meant(value: str) -> str:
    """The same for all spellings of one number or word."""
    try:
        return repr(float(value))
    except ValueError:
        return " ".join(value.casefold().replace("_", " ").replace("-", " ").split())


def _copies(found: list[MeasuredRecording], group: str) -> Iterator[str]:
    """The same samples twice: under two labels one is wrong, under two groups both sides would hold
    them."""
    seen: dict[str, MeasuredRecording] = {}
    for recording in found:
        first = seen.setdefault(recording.fingerprint, recording)
        if first is not recording:
            yield (
                f"{recording.name}: the same samples as {first.name} (label {first.label}, group "
                f"{first.group}); keep one of them"
            )


def _rows_of_files(found: list[MeasuredRecording], group: str) -> Iterator[str]:
    """Files that stand twice, or on both sides of a split."""
    for name, count in Counter(recording.name for recording in found).items():
        if count > 1:
            yield f"{name}: stands {count} times in the table; each file once, with one label"
    groups_of: dict[str, str] = {}
    for each in found:
        other = groups_of.setdefault(each.file or each.name, each.group)
        if other != each.group:
            yield (
                f"{each.file}: parts of it stand in the groups {other} and {each.group}, on both "
                "sides of a split; give all parts of a file one group"
            )


def _labels(found: list[MeasuredRecording], group: str) -> Iterator[str]:
    """Too few classes, recordings or groups to learn and judge."""
    labels = Counter(recording.label for recording in found)
    if len(labels) < 2 and found[0].label.casefold() != NORMAL:
        yield (
            f"only one label ({found[0].label}): there is nothing to tell apart; add another "
            f"class, or call it {NORMAL!r} to detect what differs from it"
        )
    for label, count in labels.items():
        if count < 2:
            yield f"label {label} has {count} recording, 2 are needed: record more or leave it out"
    if len({recording.group for recording in found}) < 2:
        yield f"only one {group} ({found[0].group}): nothing can be left out for judging"


def named_normal(found: list[MeasuredRecording]) -> list[MeasuredRecording]:
    """The same with the label of healthy machines spelled as :data:`NORMAL`."""
    return [
        replace(each, label=NORMAL) if each.label.casefold() == NORMAL else each for each in found
    ]
