"""`orbitd run` as real processes for the tests of machines that are only monitored."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from firmware_py import replay
from firmware_py.gate.client import Client
from firmware_py.gate.session import SessionError
from firmware_py.gate.view import DeviceState

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 90.0
T = TypeVar("T")


@contextmanager
def device(rig: Path, prefix: str, folder: Path) -> Iterator[Client]:
    """The device of a rig folder as a user starts it; at the end its recording is replayed and
    must decide and diagnose the same.

    ``folder`` gets the runtime folder ``run``, the process's ``log`` and its recordings, which the
    rig must keep in ``folder / "recorded"``.
    """
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "firmware_py", "run", "--rig", str(rig),
             "--runtime-dir", str(folder / "run")],
            cwd=ROOT, stdout=log, stderr=log, env={**os.environ, "XDG_STATE_HOME": str(folder)},
        )  # fmt: skip
    try:
        yield until(lambda: Client(folder / "run", prefix))
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)
    (recording,) = (folder / "recorded").glob("*.mcap")
    assert replay.main([str(recording)]) == 0, "a replay decides and diagnoses the same"


def until(ask: Callable[[], T | None]) -> T:
    """What ``ask`` gives, once it gives anything."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            found = ask()
        except (SessionError, OSError):
            found = None
        if found:
            return found
        time.sleep(0.2)
    raise AssertionError("nothing within the patience of this test")


def state(client: Client, holds: Callable[[DeviceState], object]) -> DeviceState:
    """The device's state, once ``holds`` is true of it."""
    return until(lambda: found if holds(found := client.status()) else None)
