"""How well this machine keeps time: an empty 1 kHz loop beside the device, in a process of its own.

``python -m sim_hil.demo.host`` runs until it is told to stop (SIGTERM) and then prints one line of
JSON. On a shared machine even this loop stalls; the device's own figures are read beside it.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from types import FrameType

from firmware_py.supervise import die_with_parent

PERIOD_NS = 1_000_000
PRIORITY = 20
"""The guard's own SCHED_FIFO priority."""

STALL_MS = 20.0


@dataclass(frozen=True)
class HostTiming:
    """Stalls of the empty loop, ms."""

    stalls_over_20ms: int
    worst_ms: float


class HostProbe:
    """Starts the empty loop; :meth:`stop` tells what it saw."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __spec__.name],
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=die_with_parent,
        )

    def stop(self) -> HostTiming:
        """End the loop and return its account."""
        self._process.terminate()
        output, _ = self._process.communicate(timeout=5)
        return HostTiming(**json.loads(output))


def _empty_loop() -> HostTiming:
    stop: list[int] = []

    def on_term(signum: int, frame: FrameType | None) -> None:
        stop.append(signum)

    signal.signal(signal.SIGTERM, on_term)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    stalls, worst_ns = 0, 0
    due = time.monotonic_ns() + PERIOD_NS
    while not stop:
        time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
        late_ns = time.monotonic_ns() - due
        stalls += late_ns > STALL_MS * 1e6
        worst_ns = max(worst_ns, late_ns)
        due += PERIOD_NS * (1 + late_ns // PERIOD_NS)
    return HostTiming(stalls, round(worst_ns * 1e-6, 2))


if __name__ == "__main__":
    print(json.dumps(_empty_loop().__dict__))
