"""Recordings are made once: one file a build in a folder named after everything that decides them.

An interrupted recording goes on where it stopped; a file appears under its name only when it is
whole.
"""

from __future__ import annotations

import hashlib
import inspect
import io
import zipfile
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.guard.envelope import (
    admissible,
    load_estimate,
    retreat,
    shield,
    vibration_hold,
)
from models import PHYSICS_VERSION
from models.diagnosis import clearance_loops, recordings
from models.diagnosis.dataset import DatasetError
from models.diagnosis.recordings import Raw, RecordingPlan, record_build
from models.manifest import write_whole
from models.workers import map_in_order
from sim_hil.rigs import load_rig


def folder_of(out: Path, plan: RecordingPlan) -> Path:
    """Where the recordings of ``plan`` lie."""
    guard = admissible, retreat, shield, load_estimate, vibration_hold
    code = [inspect.getsource(module) for module in (recordings, clearance_loops, *guard)]
    rig = load_rig(plan.rig).digest
    key = repr((PHYSICS_VERSION, code, rig, plan.seed, plan.rate_hz, plan.seconds))
    return out / f"recordings-{plan.draw.__name__}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"


def make_recordings(
    out: Path, plan: RecordingPlan, builds: int, workers: int, progress: Callable[[int], None]
) -> list[Path]:
    """Files of the first ``builds`` builds of ``plan``, recording those that are not there yet.

    What lies in a file follows from plan and build alone, whatever the number of workers.
    """
    folder = folder_of(out, plan)
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"build-{number:05d}.npz" for number in range(builds)]
    missing = [number for number, file in enumerate(files) if not file.exists()]
    progress(builds - len(missing))
    made = map_in_order(partial(_make, plan), missing, workers)
    for done, (number, content) in enumerate(zip(missing, made, strict=True), 1):
        write_whole(files[number], content)
        progress(builds - len(missing) + done)
    return files


def load(file: Path) -> list[Raw]:
    """The recordings in one file.

    Raises
    ------
    DatasetError
        The file is not whole.
    """
    names = [f.name for f in fields(Raw)]
    try:
        with np.load(file) as stored:
            columns = {name: stored[name] for name in stored.files}
            return [
                Raw(*(_plain(columns[f"{i}_{name}"]) for name in names))
                for i in range(int(columns["count"]))
            ]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise DatasetError(
            f"{file}: not a whole recording ({error}); delete it, it is then made again"
        ) from error


def _plain(array: NDArray[Any]) -> Any:
    return array if array.ndim else array.item()


def _make(plan: RecordingPlan, number: int) -> bytes:
    """The file of one build: made in any process, on any computer, and written by one."""
    recordings = record_build(plan, number)
    columns = {
        f"{i}_{f.name}": getattr(raw, f.name)
        for i, raw in enumerate(recordings)
        for f in fields(Raw)
    }
    stream = io.BytesIO()
    np.savez(stream, count=len(recordings), **columns)
    return stream.getvalue()
