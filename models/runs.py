"""The runs folder: settings beside the weights, metrics as they come, a report, figures and the model's card."""

from __future__ import annotations

import csv
import json
import shutil
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import msgspec
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from models import ARTIFACTS
from models.manifest import write_manifest


class SettingsError(ValueError):
    """The training settings cannot be used; the text names file, key and next step."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every trainer's settings: frozen, unknown keys refused, saved beside the weights."""


S = TypeVar("S", bound=Settings)


def load_settings(kind: type[S], path: Path | None) -> S:
    """Settings of ``kind`` from the TOML file ``path``, or the defaults."""
    if path is None:
        return kind()
    try:
        return msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), kind)
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: cannot be read ({error}); give the path of a TOML file") from error
    except (tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        known = ", ".join(kind.__struct_fields__)
        raise SettingsError(f"{path}: {error}; known keys: {known}") from error


class Run:
    """One training: folder ``out/<kind>-seed<seed>``.

    Parameters
    ----------
    out
        Parent folder.
    kind, seed, smoke
        What is trained; a smoke run has its own folder.
    settings
        Saved as ``config.json``.
    """

    def __init__(self, out: Path, kind: str, seed: int, settings: Settings, *, smoke: bool) -> None:
        self.kind, self.seed, self.settings, self.smoke = kind, seed, settings, smoke
        self.folder = out / f"{kind}-seed{seed}{'-smoke' if smoke else ''}"
        self.folder.mkdir(parents=True, exist_ok=True)
        config = {"model": kind, "seed": seed, "smoke": smoke, **msgspec.to_builtins(settings)}
        self.write_json("config.json", config)
        (self.folder / "metrics.csv").unlink(missing_ok=True)

    @property
    def model(self) -> Path:
        """The ONNX file of this run."""
        return self.folder / f"{self.kind}.onnx"

    @property
    def command(self) -> str:
        """Exact line that reproduces this run."""
        return f"orbitd train {self.kind} --seed {self.seed}{' --smoke' if self.smoke else ''}"

    def log(self, row: Mapping[str, object]) -> None:
        """Append a row to ``metrics.csv``; the first row names the columns."""
        path = self.folder / "metrics.csv"
        first = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, fieldnames=list(row))
            if first:
                writer.writeheader()
            writer.writerow(row)

    def write_json(self, name: str, content: object) -> None:
        """Write ``content`` beside the model."""
        text = json.dumps(content, indent=2, sort_keys=True) + "\n"
        (self.folder / name).write_text(text, encoding="utf-8")

    def ship(self) -> None:
        """Copy model, report and card to ``models/artifacts`` and renew the manifest."""
        for suffix in ("onnx", "json", "md"):
            shutil.copyfile(self.folder / f"{self.kind}.{suffix}", ARTIFACTS / f"{self.kind}.{suffix}")
        write_manifest(ARTIFACTS)


@contextmanager
def progress_bar(text: str, total: int) -> Iterator[ProgressTo]:
    """A progress bar; the yielded object is called with the work done so far."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, transient=False) as bar:
        to = ProgressTo(bar, bar.add_task(text, total=total))
        yield to
        to(total)  # a search that stops early is done as well


class ProgressTo:
    """Sets a bar to an absolute position."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar, self._task = bar, task

    def __call__(self, done: int, _cost: float = 0.0) -> None:
        """Set the bar to ``done``; the second argument lets a search report its cost to it."""
        self._bar.update(self._task, completed=done)
