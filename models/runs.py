"""The runs folder: settings beside the weights, metrics as they come, checkpoints, a report,
figures and cards."""

from __future__ import annotations

import csv
import json
import multiprocessing
import shutil
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from models import checkpoint


class SettingsError(ValueError):
    """The training settings cannot be used; the text names file, key and next step."""


PLACES: Final = ("rig", "surrogate")
"""Settings that name a folder or a file."""

Count = Annotated[int, msgspec.Meta(ge=1)]
"""How many; none is refused."""


class TrainerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every trainer's settings: frozen, unknown keys refused, saved beside the weights."""


S = TypeVar("S", bound=TrainerSettings)
T = TypeVar("T")


def load_settings(kind: type[S], path: Path | None) -> S:
    """Settings of ``kind`` from the TOML file ``path``, or the defaults."""
    if path is None:
        return kind()
    try:
        return msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), kind)
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(
            f"{path}: cannot be read ({error}); give the path of a TOML file"
        ) from error
    except (tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        known = ", ".join(kind.__struct_fields__)
        raise SettingsError(f"{path}: {error}; known keys: {known}") from error


def without_places(settings: object, home: Path | None = None) -> dict[str, Any]:
    """Settings as they are told: a file or folder by its own name, for runs and cards travel, and
    ``home`` without a name, for it may be copied under another; not how many processes worked, on
    which nothing depends."""
    told: dict[str, Any] = {}
    for key, value in msgspec.to_builtins(settings).items():
        if key == "workers":
            continue
        if isinstance(value, dict):
            told[key] = without_places(value, home)
        elif key in PLACES and value:
            told[key] = "." if Path(str(value)) == home else Path(str(value)).name
        else:
            told[key] = value
    return told


class TrainingRun:
    """One training: folder ``out/<kind>-seed<seed>``.

    Parameters
    ----------
    out
        Parent folder.
    kind, seed, smoke
        What is trained; a smoke run has its own folder.
    settings
        Saved as ``config.json``.
    resume
        Go on from the checkpoints of the same folder, which must have been made with the same
        settings.
    config
        The file that the settings came from, for the line that reproduces the run.
    command
        That line itself, where this run is a part of another command.
    home
        Folder of the machine, where the run lies in it and travels with it.
    """

    def __init__(
        self,
        out: Path,
        kind: str,
        seed: int,
        settings: TrainerSettings,
        *,
        smoke: bool,
        resume: bool = False,
        config: Path | None = None,
        command: str = "",
        home: Path | None = None,
    ) -> None:
        self.kind, self.seed, self.settings, self.smoke, self._config = (
            kind,
            seed,
            settings,
            smoke,
            config,
        )
        self._command = command
        self.folder = out / f"{kind}-seed{seed}{'-smoke' if smoke else ''}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self._board: Any = None
        self._logged = 0
        self._started = time.monotonic()
        content = {"model": kind, "seed": seed, "smoke": smoke, **without_places(settings, home)}
        if resume:
            self._check_same(content)
        else:
            for name in ("checkpoints", "tensorboard"):
                shutil.rmtree(self.folder / name, ignore_errors=True)
            (self.folder / "metrics.csv").unlink(missing_ok=True)
        self.write_json("config.json", content)

    def _check_same(self, content: object) -> None:
        path = self.folder / "config.json"
        if not path.is_file():
            raise SettingsError(
                f"{path}: not there, so there is nothing to resume; train without --resume"
            )
        if json.loads(path.read_text(encoding="utf-8")) != json.loads(json.dumps(content)):
            raise SettingsError(
                f"{path}: made with other settings; give the same ones, or train without --resume"
            )

    @property
    def model(self) -> Path:
        """The ONNX file of this run."""
        return self.folder / f"{self.kind}.onnx"

    @property
    def minutes(self) -> float:
        """Since this run began; a resumed one counts from its resumption."""
        return (time.monotonic() - self._started) / 60.0

    @property
    def command(self) -> str:
        """Exact line that reproduces this run."""
        if self._command:
            return self._command
        config = f" --config {self._config}" if self._config else ""
        return (
            f"orbitd train {self.kind} --seed {self.seed}{config}{' --smoke' if self.smoke else ''}"
        )

    def has(self, name: str) -> bool:
        """Whether the checkpoint ``name`` is there."""
        return self._checkpoint(name).is_file()

    def _checkpoint(self, name: str) -> Path:
        return self.folder / "checkpoints" / f"{name}.ckpt"

    def kept(self, name: str, work: Callable[[], T], rng: np.random.Generator | None = None) -> T:
        """The result of ``work``, done once: a resumed training takes it from the checkpoint
        ``name``.

        ``rng`` goes on as if the work had been done now, so that what follows draws the same
        numbers.

        Raises
        ------
        checkpoint.CheckpointError
            The checkpoint is damaged; nothing is overwritten.
        """
        path = self._checkpoint(name)
        if path.is_file():
            result, state = checkpoint.load(path)
            if rng is not None:
                rng.bit_generator.state = state
        else:
            result = work()
            checkpoint.save(path, (result, rng.bit_generator.state if rng is not None else None))
        done: T = result
        return done

    def log(self, row: Mapping[str, object]) -> None:
        """Append a row to ``metrics.csv`` (the first names the columns) and its numbers to the
        TensorBoard events."""
        path = self.folder / "metrics.csv"
        first = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, fieldnames=list(row))
            if first:
                writer.writeheader()
            writer.writerow(row)
        numbers = {
            name: float(value) for name, value in row.items() if isinstance(value, (int, float))
        }
        self._logged += 1
        step = int(numbers.pop("step", self._logged))
        for name, value in numbers.items():
            self._tensorboard().add_scalar(name, value, step)
        self._tensorboard().flush()

    def _tensorboard(self) -> Any:
        """Writer of the events, made with the first row."""
        if self._board is None:
            from torch.utils.tensorboard import SummaryWriter

            self._board = SummaryWriter(str(self.folder / "tensorboard"))
        return self._board

    def close(self) -> None:
        """Finish the TensorBoard events."""
        if self._board is not None:
            self._board.close()

    def write_json(self, name: str, content: object) -> None:
        """Write ``content`` beside the model."""
        text = json.dumps(content, indent=2, sort_keys=True) + "\n"
        (self.folder / name).write_text(text, encoding="utf-8")


@contextmanager
def progress_bar(text: str, total: int) -> Iterator[ProgressTo]:
    """A progress bar; the yielded object is called with the work done so far.  Only the main
    process shows any."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    hidden = multiprocessing.parent_process() is not None
    with Progress(*columns, console=Console(stderr=True), transient=False, disable=hidden) as bar:
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
