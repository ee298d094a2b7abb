"""Three views of the same recordings: features of windows, a raw window, a waveform over shaft
angle."""

from __future__ import annotations

import hashlib
import inspect
import io
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache, partial
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire import channel_map as channel_code
from firmware_py.acquire import channel_ok as ok_code
from firmware_py.acquire import features as feature_code
from firmware_py.acquire import film_check as film_code
from firmware_py.acquire import orders as order_code
from firmware_py.acquire import recorded_windows as recorded_code
from firmware_py.acquire import ringing as ringing_code
from firmware_py.acquire import windows as window_code
from firmware_py.acquire.channel_ok import ChannelOk
from firmware_py.acquire.features import FEATURE_NAMES, at_one_rate, features
from firmware_py.acquire.orders import BINS, ROTATING, by_angle
from firmware_py.acquire.recorded_windows import iter_windows
from firmware_py.acquire.windows import TURNS, Window
from firmware_py.brain.verdict import WINDOWS
from firmware_py.config import Config, read_machine
from firmware_py.config import load as load_config
from firmware_py.machine import Machine
from firmware_py.machine import contact as contact_code
from firmware_py.machine.folder import find
from firmware_py.records import Quality
from models.diagnosis.data_cache import folder_of, load, make_recordings
from models.diagnosis.dataset import Dataset, DatasetError, join, pooled
from models.diagnosis.recordings import Raw, RecordingPlan, record_build
from models.manifest import write_whole
from models.runs import progress_bar
from models.workers import map_in_order

ALL_OK: Final = 0xFF
"""Bits of all channels of the standard instrumentation."""
RAW_POINTS: Final = 800
"""Length of the paper's windows; at 5 kHz 0.16 s."""


@dataclass(frozen=True)
class Views:
    """``orders``: features of windows, or their means over decisions; ``raw``, ``waves``: one row a
    recording."""

    orders: Dataset
    raw: Dataset
    waves: Dataset


@dataclass(frozen=True)
class WindowSampling:
    """How recordings are looked at: every window, or means of ``windows``; raw rows of the first
    ``raw_builds``."""

    windows: int = 1
    raw_builds: int = 0
    keep_samples: bool = True
    """Whether the recordings stay on disk, to be looked at again in another way."""


def views_of(
    out: Path, plan: RecordingPlan, builds: int, workers: int, look: WindowSampling
) -> Views:
    """Views of the recordings of ``plan`` under ``out``, recorded and analysed when they are not
    there yet."""
    path = (
        folder_of(out, plan)
        / f"views-{builds}-{look.windows}-{look.raw_builds}-{_code_hash(plan.rig)}.npz"
    )
    if path.exists():
        return _read(path)
    if look.keep_samples:
        with progress_bar(f"recordings of {builds} builds", builds) as bar:
            files = make_recordings(out, plan, builds, workers, bar)
        with progress_bar(f"features of {builds} builds", builds) as bar:
            views = _analysed(files, plan.rig, look, workers, bar)
    else:
        with progress_bar(f"recordings of {builds} builds", builds) as bar:
            views = _heard(path, plan, builds, look, workers, bar)
    write_whole(path, _packed(views))
    shutil.rmtree(path.with_suffix(""), ignore_errors=True)
    return views


def _heard(
    path: Path,
    plan: RecordingPlan,
    builds: int,
    look: WindowSampling,
    workers: int,
    progress: Callable[[int], None],
) -> Views:
    """Views of builds that are recorded and looked at in one go; each is kept beside ``path``
    until all are there."""
    parts = path.with_suffix("")
    parts.mkdir(parents=True, exist_ok=True)
    files = [parts / f"{number:05d}.npz" for number in range(builds)]
    missing = [number for number, file in enumerate(files) if not file.exists()]
    progress(builds - len(missing))
    made = map_in_order(partial(_recorded_views, plan, look), missing, workers)
    for done, (number, content) in enumerate(zip(missing, made, strict=True), 1):
        write_whole(files[number], content)
        progress(builds - len(missing) + done)
    return joined_views([_read(file) for file in files])


def _recorded_views(plan: RecordingPlan, look: WindowSampling, build: int) -> bytes:
    """One build, on any computer."""
    return _packed(_looked_at(record_build(plan, build), look, plan.rig, build))


def _packed(views: Views) -> bytes:
    """The bytes of a file of ``views``."""
    stream = io.BytesIO()
    columns = {
        f"{view.name}_{column.name}": getattr(getattr(views, view.name), column.name)
        for view in fields(Views)
        for column in fields(Dataset)
    }
    np.savez(stream, **columns)
    return stream.getvalue()


def per_decision(views: Views) -> Views:
    """Features averaged over the windows of one decision; raw windows and waveforms stay one a
    recording."""
    return Views(pooled(views.orders, WINDOWS), views.raw, views.waves)


@cache
def _machine(rig: str) -> Machine:
    """The machine of a recorded rig, read once in each process."""
    return read_machine(rig)


@cache
def _config(rig: str, rate_hz: int) -> Config:
    """The device's configuration of a recorded rig, at the rate of the recording."""
    config, _ = load_config(find(rig))
    return config.replaced(sampling=msgspec.structs.replace(config.sampling, rate_hz=rate_hz))


def usable_windows(raw: Raw, rig: str) -> list[Window]:
    """Windows of a recording with whole turns, as the device cuts them and judges their
    channels."""
    judge = ChannelOk.of(_config(rig, raw.rate_hz)).step
    windows = iter_windows(
        raw.counts, raw.start_us, raw.marks_us, raw.rate_hz, readings=raw.readings, judge=judge
    )
    return [window for window in windows if not window.quality & Quality.NO_MARK]


def _analysed(
    files: list[Path], rig: str, look: WindowSampling, workers: int, progress: Callable[[int], None]
) -> Views:
    parts = []
    of_build = partial(_views_of_build, look, rig)
    for done, part in enumerate(map_in_order(of_build, files, workers), 1):
        parts.append(part)
        progress(done)
    return joined_views(parts)


def _views_of_build(look: WindowSampling, rig: str, file: Path) -> Views:
    return _looked_at(load(file), look, rig, int(file.stem.partition("-")[2]))


def _looked_at(recordings: list[Raw], look: WindowSampling, rig: str, build: int) -> Views:
    views = joined_views(
        [_views(raw, rig, build, 100 * build + i) for i, raw in enumerate(recordings)]
    )
    orders = pooled(views.orders, look.windows) if look.windows > 1 else views.orders
    raw_rows = slice(None) if build < look.raw_builds else slice(0)
    return Views(orders, views.raw.subset(raw_rows), views.waves.subset(raw_rows))


def joined_views(parts: list[Views]) -> Views:
    """All rows of ``parts``."""
    return Views(*(join([getattr(part, f.name) for part in parts]) for f in fields(Views)))


def _views(raw: Raw, rig: str, build: int, number: int) -> Views:
    windows, machine = usable_windows(raw, rig), _machine(rig)
    bad = np.array([w.channel_ok != ALL_OK for w in windows], bool)
    rows = np.array([features(w, machine) for w in windows], np.float32).reshape(
        -1, len(FEATURE_NAMES)
    )
    points = raw.counts[-RAW_POINTS:].reshape(1, -1).astype(np.float32)
    waves = np.array([waveform(w) for w in windows[-1:]], np.float32).reshape(
        -1, len(ROTATING) * TURNS * BINS
    )
    views = ((rows, bad), (points, bad[-1:]), (waves, bad[-1:]))
    return Views(*(_labelled(x, of_row, raw, build, number) for x, of_row in views))


def waveform(window: Window) -> NDArray[np.float64]:
    """The last :data:`TURNS` turns over shaft angle, shape (7 x 1024,); missing turns are zero."""
    window = at_one_rate(window)
    angle = by_angle(window.samples, window.marks[-1 - min(window.turns, TURNS) :])
    angle -= angle.mean(axis=1, keepdims=True)
    return np.pad(angle, ((0, 0), (TURNS * BINS - angle.shape[1], 0))).ravel()


def _labelled(
    rows: NDArray[np.float32], bad: NDArray[np.bool_], raw: Raw, build: int, number: int
) -> Dataset:
    labels = (raw.kind, raw.severity, build, number, raw.loop, raw.duty)
    bad = bad if len(bad) == len(rows) else np.full(len(rows), False)
    return Dataset(*[rows, *(np.full(len(rows), label) for label in labels), bad])


def _code_hash(rig: str) -> str:
    """Changes with the code that cuts and analyses windows, and with the machine."""
    digest = hashlib.sha256(msgspec.json.encode(_machine(rig)))
    for module in (
        ok_code,
        channel_code,
        window_code,
        recorded_code,
        order_code,
        ringing_code,
        contact_code,
        film_code,
        feature_code,
    ):
        digest.update(inspect.getsource(module).encode())
    return digest.hexdigest()[:12]


def _read(path: Path) -> Views:
    try:
        with np.load(path) as stored:
            return Views(
                *(
                    Dataset(*(stored[f"{view.name}_{column.name}"] for column in fields(Dataset)))
                    for view in fields(Views)
                )
            )
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise DatasetError(
            f"{path}: not whole ({error}); delete it, it is then made again"
        ) from error
