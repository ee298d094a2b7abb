"""The brain's process: ``orbitd brain``."""

from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from firmware_py import background, launch, notify
from firmware_py.brain.core import BrainCore
from firmware_py.brain.library import ShelfLibrary
from firmware_py.clock import Clock, MonotonicClock
from firmware_py.records import Advice
from firmware_py.routing import BRAIN_PERIOD_NS, Stage, in_order, receivers
from firmware_py.wire.peers import PeerClient

_CPU_FLAGS: Final = ("avx", "fma", "avx2", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")


def main(argv: list[str]) -> int:
    """Run the brain until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog="orbitd brain", description=__doc__)
    launch.add_options(parser)
    start = launch.from_options(parser.parse_args(argv))
    state = launch.state_dir(start.config, os.environ)
    library = ShelfLibrary(start.config, launch.shelf_folder(start.config, state))
    models, sets = library.in_use()
    for kind, text in models.off.items():
        print(f"orbitd brain: {kind} is off: {text}", file=sys.stderr, flush=True)
    for kind, text in models.refusals.items():
        print(f"orbitd brain: {kind} not used: {text}", file=sys.stderr, flush=True)
    core = BrainCore(start.config, models, cpu_features(), sets, library)
    stopped: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda signum, _frame: stopped.append(signum))
    gc.freeze()
    run(core, start.runtime, MonotonicClock(), notify.from_environment(), lambda: bool(stopped))
    return 0


def run(
    core: BrainCore,
    runtime: Path,
    clock: Clock,
    notifier: notify.Notifier,
    stopped: Callable[[], bool],
) -> None:
    """Read, step, write, sleep, until ``stopped()``.

    What goes to whom says :mod:`firmware_py.routing`; the advice is the heartbeat.
    """
    guard = PeerClient(runtime / "guard.sock", "brain")
    gate = PeerClient(runtime / "gate.sock", "brain")
    peers = {Stage.GUARD: guard, Stage.GATE: gate}
    background.restore()
    notifier.ready()
    next_ns, late = clock.now_ns(), (0, 0)
    while not stopped():
        now_ns, connections = clock.now_ns(), gate.counters["connected"]
        records = [*gate.poll(now_ns), *guard.poll(now_ns)]
        if gate.counters["connected"] != connections:
            core.record_from_here()
        for record in in_order(Stage.BRAIN, core.step(records, now_ns, late)):
            for stage in receivers(Stage.BRAIN, record):
                peers[stage].send(record)
            if isinstance(record, Advice):
                notifier.watchdog()
        late = core.take_late()
        next_ns = max(next_ns + BRAIN_PERIOD_NS, clock.now_ns())
        clock.sleep_until(next_ns)
    notifier.stopping()
    guard.close()
    gate.close()


def cpu_features(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The vector extensions on which the last bits of a diagnosis depend; ``unknown`` where they
    are not told."""
    try:
        words = set(
            cpuinfo.read_text(encoding="ascii", errors="replace").partition("\n\n")[0].split()
        )
    except OSError:
        return "unknown"
    return " ".join(flag for flag in _CPU_FLAGS if flag in words) or "unknown"
