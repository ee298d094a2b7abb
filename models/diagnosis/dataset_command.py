"""``orbitd dataset FOLDER``: what is read of a folder of recordings, and all that is wrong with
it."""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from models import readers
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import (
    MeasuredRecording,
    listed,
    named_normal,
    plan_of,
    scan_folder,
)
from models.diagnosis.folder_table import DEFAULT_GROUP, TABLE, signal_files
from models.diagnosis.measured_features import too_short
from models.readers.assemble import roles
from models.readers.channel_map import FILE_NAME, FileMap, FileRules
from models.readers.signal_file import SignalFile, SignalFileError

EXIT_BAD_INPUT = 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="orbitd dataset", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of recordings (docs/recordings.md)")
    parser.add_argument(
        "--channels", type=Path, help=f"channel map (default: {FILE_NAME} of the folder)"
    )
    parser.add_argument(
        "--group", default=DEFAULT_GROUP, help="column whose values never cross a split"
    )
    parser.add_argument(
        "--write",
        action="store_true",
        help=f"write {TABLE} and {FILE_NAME} to fill in, where the folder has none",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry of ``orbitd dataset``; returns the exit code."""
    args = _parser().parse_args(argv)
    try:
        if args.write:
            return _write(args.folder, args.channels)
        found, problems = scan_folder(args.folder, args.group, args.channels)
    except DatasetError as error:
        print(f"orbitd dataset: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    _show(named_normal(found), problems, as_json=args.json)
    if problems and not args.json:
        print(f"orbitd dataset: {args.folder}: {listed(problems)}", file=sys.stderr)
    return EXIT_BAD_INPUT if problems else 0


def _show(found: Sequence[MeasuredRecording], problems: Sequence[str], *, as_json: bool) -> None:
    rows = [
        {
            "recording": each.name,
            "label": each.label,
            "group": each.group,
            "seconds": round(len(each.samples) / each.rate_hz, 3),
            "rate_hz": each.rate_hz,
            "channels": ", ".join(
                f"{name} ({unit or '?'})"
                for name, unit in zip(each.channels, each.units, strict=True)
            ),
            "turns": "" if each.turns is None else round(float(each.turns[-1] - each.turns[0]), 1),
            "notes": "; ".join([*each.notes, *filter(None, [too_short(each)])]),
        }
        for each in found
    ]
    if as_json:
        print(json.dumps({"recordings": rows, "problems": problems}, indent=2))
        return
    table = Table()
    for name in rows[0] if rows else ():
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*(str(value) for value in row.values()))
    Console(width=None if sys.stdout.isatty() else 160).print(table)


def _write(folder: Path, channels: Path | None) -> int:
    """Write drafts of the table and the map; what is there stays as it is."""
    files = signal_files(folder) if folder.is_dir() else []
    if not files:
        raise DatasetError(f"{folder}: no recording in it; give the folder that holds the files")
    made = [
        _draft(folder / TABLE, _table_of(folder, files)),
        _draft(folder / FILE_NAME, _map_of(files[0], plan_of(folder, channels).file)),
    ]
    print("\n".join(made))
    print(f"fill them in, then: orbitd dataset {folder}")
    return 0


def _draft(path: Path, text: str) -> str:
    try:
        with path.open("x", encoding="utf-8", newline="") as stream:
            stream.write(text)
    except FileExistsError:
        return f"{path}: is there already, left as it is"
    return f"{path}: written"


def _table_of(folder: Path, files: Sequence[Path]) -> str:
    """A row for each file; its label is guessed from its subfolder, else from its name."""
    from io import StringIO

    out = StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(
        ["file", "label", "group", "machine", "rate_hz", "speed_rpm", "start_s", "end_s"]
    )
    for path in files:
        name = path.relative_to(folder)
        word = re.match(r"[^\W\d_]*(?:[ _-][^\W\d_]+)*", path.stem)
        label = name.parts[0] if len(name.parts) > 1 else (word[0] if word else "")
        table.writerow([str(name), label, str(name), "", "", "", "", ""])
    return out.getvalue()


def _map_of(path: Path, rules: FileRules) -> str:
    """The columns of one file, each as it is understood, to be corrected."""
    try:
        file = readers.read(path, rules)
    except SignalFileError as error:
        said = "\n".join(f"# {line}" for line in str(error).splitlines())
        return f"# {path.name} could not be read as it is:\n{said}\n[file]\n# rate_hz = 10000\n"
    apart = roles(file, FileMap(file=rules))
    signals = [i for i in range(len(file.channels)) if i not in apart]
    lines = [*_head_of(file, apart), *(line for i in signals for line in _entry(file, i))]
    return "\n".join(lines) + "\n"


def _head_of(file: SignalFile, apart: Sequence[int | None]) -> list[str]:
    lines = [
        f"# Columns of {file.path.name} as they are understood: correct names, units and scales,",
        "# delete what is no signal.",
        "[file]",
        "# rate_hz = 10000        # where the files do not tell it",
        "# resample_hz = 5000     # all recordings are brought to this rate",
    ]
    examples = (("time", "stamps that tell the rate"), ("speed", "or [mark]: gives orders"))
    for (what, words), index in zip((*examples, ("mark", "pulses")), apart, strict=True):
        channel = file.channels[index] if index is not None else None
        off = "# " if channel is None else ""
        column = what if channel is None or index is None else _column(file, index)
        lines.append(f"{off}[{what}]{' ' * 16}# {words}")
        lines.append(f"{off}column = {column if channel else json.dumps(column)}")
        if channel is not None and channel.unit and what != "mark":
            lines.append(f"unit = {json.dumps(channel.unit)}")
    return [*lines, ""]


def _column(file: SignalFile, index: int) -> str:
    """How the map names a channel: a JSON string is a TOML string."""
    name = file.channels[index].name
    return str(index + 1) if name.startswith("column ") else json.dumps(name, ensure_ascii=False)


def _entry(file: SignalFile, index: int) -> list[str]:
    channel = file.channels[index]
    return [
        "[[channel]]",
        f"column = {_column(file, index)}",
        f"name = {json.dumps(channel.name, ensure_ascii=False)}",
        f"unit = {json.dumps(channel.unit, ensure_ascii=False)}",
        "# scale = 1.0",
        "# polarity = 1",
        "",
    ]
