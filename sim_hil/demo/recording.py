"""A flight recording of a run on the simulated clock, written by the gate's own recorder."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firmware_py.config import Config
from firmware_py.errors import OrbitdError
from firmware_py.gate.loop import metadata, read_models
from firmware_py.gate.recorder import Recorder
from sim_hil.closed_loop import Listener


class RecordingIncompleteError(OrbitdError):
    """The disk did not keep up; the recording is not given."""


@contextmanager
def recorded(path: Path | None, config: Config) -> Iterator[tuple[Listener, ...]]:
    """Listeners that record the run into ``path``; none when ``path`` is None.

    Raises
    ------
    RecordingIncompleteError
        A record was lost on the way to the disk.
    """
    if path is None:
        yield ()
        return
    with tempfile.TemporaryDirectory(prefix="orbitd-recording-") as name:
        folder = Path(name)
        head = metadata(config, read_models(config))
        recorder = Recorder(
            folder, "demo", head, config.recorder.max_megabytes * 10**6, time.time_ns
        )
        yield (recorder.write,)
        recorder.close()
        files = list(folder.glob("*.mcap"))
        if recorder.counters["recorder_lost"] or len(files) != 1:
            lost = recorder.counters["recorder_lost"]
            raise RecordingIncompleteError(
                f"{path}: {lost} records lost in {len(files)} files; use a faster disk"
            )
        shutil.copyfile(files[0], path)
