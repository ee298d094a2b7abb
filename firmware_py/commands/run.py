"""``orbitd run``: guard, brain and gate together, each in its own process, restarted when it
dies."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from pathlib import Path

from firmware_py import launch
from firmware_py.supervise import WRONG_INPUT, Exit, Program, Supervisor

PROCESSES = ("guard", "brain", "gate")


def programs(options: list[str], log_folder: Path) -> list[Program]:
    """The three processes as programs; ``options`` are passed to each."""
    return [
        Program(
            process,
            (sys.executable, "-m", "firmware_py", process, *options),
            log_folder / f"{process}.log",
        )
        for process in PROCESSES
    ]


def main(argv: list[str]) -> int:
    """Start the three processes and keep them alive until interrupted."""
    parser = argparse.ArgumentParser(prog="orbitd run", description=__doc__)
    launch.add_options(parser)
    options = parser.parse_args(argv)
    started = launch.from_options(options)
    device, folder = started.config.device, started.runtime
    passed = [
        "--rig",
        str(started.source.path),
        "--instance",
        device.instance,
        "--runtime-dir",
        str(folder),
    ]
    print(
        f"orbitd run: {device.site}/{device.rig}, logs in {folder / 'log'}; Ctrl-C stops",
        flush=True,
    )
    return _keep_alive(programs(passed, folder / "log"), folder / "log")


def _keep_alive(programs: list[Program], log_folder: Path) -> int:
    supervisor = Supervisor()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for process in programs:
            supervisor.start(process)
        while True:
            for died in supervisor.poll(time.monotonic()):
                print("\n".join(_words(died, log_folder)), file=sys.stderr, flush=True)
                if died.restart_in_s is None:
                    return WRONG_INPUT
            time.sleep(0.05)
    finally:
        supervisor.stop()


def _words(died: Exit, log_folder: Path) -> list[str]:
    """What a person reads of a death: who, how, its last words, and what happens next."""
    then = (
        "all stop: correct what it says, then start again"
        if died.restart_in_s is None
        else f"starting it again in {died.restart_in_s:g} s"
    )
    return [
        f"orbitd run: {died.name} ended {died.cause} (start {died.starts}); {then}; log: "
        f"{log_folder / died.name}.log",
        *(f"    {line}" for line in died.last_words),
    ]
