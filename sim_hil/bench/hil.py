"""The real-time rig loop beside an empty loop on the same grid: two processes at the same time, one
of them idle.

Each says when it is ready, runs for some seconds from the same word on, and prints what it met.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from firmware_py.clock import Clock, MonotonicClock
from firmware_py.config import SHIPPED, load
from firmware_py.wire.link import open_link
from sim_hil.console import SOCKET_NAME, Console
from sim_hil.server import PERIOD_NS, make_rig, serve, warm_up

RATE_HZ = 5000


class Witness(MonotonicClock):
    """A clock that notes how late its loop wakes, ns, and how often the loop has left a point of
    its grid out."""

    def __init__(self) -> None:
        self.late_ns: list[int] = []
        self.missed = 0
        self._due_ns: int | None = None

    def sleep_until(self, t_ns: int) -> None:
        """As the clock does, with notes."""
        self.missed += self._due_ns is not None and t_ns > self._due_ns + PERIOD_NS
        self._due_ns = t_ns
        super().sleep_until(t_ns)
        self.late_ns.append(self.now_ns() - t_ns)


def idle(clock: Clock, running: Callable[[], bool]) -> None:
    """The loop of :func:`serve` without a rig."""
    due_ns = clock.now_ns()
    while running():
        due_ns = max(due_ns + PERIOD_NS, clock.now_ns())
        clock.sleep_until(due_ns)


def loop(kind: str, seconds: float, folder: Path) -> dict[str, float]:
    """Run the loop ``rig`` or ``empty`` and say how it kept its grid and what it took."""
    clock = Witness()
    if kind == "rig":
        config, _ = load(SHIPPED / "bench")
        config = config.replaced(bus=msgspec.structs.replace(config.bus, channel=folder.name))
        warm_up(config, "bench")
        rig = make_rig(config, "bench", 1)
        if config.sampling.rate_hz != RATE_HZ:
            raise ValueError(
                f"sampling.rate_hz = {config.sampling.rate_hz} of the rig bench: {RATE_HZ} is "
                f"measured here"
            )
        link, console = open_link(config, "rig"), Console(folder / SOCKET_NAME, rig)
        running = _from_now_on(clock, seconds)
        busy = time.process_time()
        serve(rig, link, console, clock, running)
        link.close()
        console.close()
    else:
        running = _from_now_on(clock, seconds)
        busy = time.process_time()
        idle(clock, running)
    late_us = np.array(clock.late_ns) * 1e-3
    return {
        "late_p50_us": float(np.median(late_us)),
        "late_p99_us": float(np.quantile(late_us, 0.99)),
        "late_max_us": float(late_us.max()),
        "missed_share": clock.missed / len(late_us),
        "cpu_share": (time.process_time() - busy) / seconds,
    }


def _from_now_on(clock: Clock, seconds: float) -> Callable[[], bool]:
    """Say that the loop is ready, wait for the word, and then hold for ``seconds``."""
    print("ready", flush=True)
    sys.stdin.readline()
    end_ns = clock.now_ns() + round(seconds * 1e9)
    return lambda: clock.now_ns() < end_ns


def rig_beside_empty(seconds: float) -> dict[str, dict[str, float]]:
    """What the two loops met in the same ``seconds``, by name."""
    with tempfile.TemporaryDirectory(prefix="orbitd-bench-") as name:
        environment = {**os.environ, "ORBITD_BUS_DIR": str(Path(name) / "bus")}
        processes = {
            kind: subprocess.Popen(
                [sys.executable, "-m", "sim_hil.bench.hil", kind, str(seconds), name],
                env=environment,
                text=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            for kind in ("rig", "empty")
        }
        try:
            for process in processes.values():
                assert process.stdout is not None
                process.stdout.readline()
            for process in processes.values():
                assert process.stdin is not None
                process.stdin.write("go\n")
                process.stdin.flush()
            return {
                kind: json.loads(process.communicate()[0]) for kind, process in processes.items()
            }
        finally:
            for process in processes.values():
                process.kill()
                process.wait()


if __name__ == "__main__":
    print(json.dumps(loop(sys.argv[1], float(sys.argv[2]), Path(sys.argv[3]))))
