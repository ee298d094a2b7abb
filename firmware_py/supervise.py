"""Starts processes, keeps them alive, stops them: for laptops and demos, where systemd is not at
hand."""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final


@dataclass(frozen=True)
class Program:
    """One process to keep alive; its output goes to ``log``."""

    name: str
    argv: tuple[str, ...]
    log: Path
    restart_after_s: float = 0.1


PAUSE_MAX_S: Final = 10.0
"""The pause before a restart doubles from the program's own up to this."""

GOOD_LIFE_S: Final = 60.0
"""Who lived so long starts again after the first pause."""

GOOD_START_S: Final = 5.0
"""Who worked for so long and was then killed from outside as well: that is no crash of its own."""

FROM_OUTSIDE: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)

WRONG_INPUT: Final = 2
"""Exit code of a process whose configuration, files or options are wrong: that never mends
itself."""

LAST_LINES: Final = 5
LAST_BYTES: Final = 4096


@dataclass
class _Running:
    program: Program
    process: subprocess.Popen[bytes]
    started_s: float
    log_at: int
    pause_s: float
    starts: int = 1
    restart_at_s: float | None = None


@dataclass(frozen=True)
class Exit:
    """A process that ended without being asked to; ``restart_in_s`` is None when it is not started
    again."""

    name: str
    code: int
    starts: int
    restart_in_s: float | None
    last_words: tuple[str, ...]

    @property
    def cause(self) -> str:
        """How it ended, for a person."""
        return (
            f"by {signal.Signals(-self.code).name}"
            if self.code < 0
            else f"with exit code {self.code}"
        )


@dataclass
class Supervisor:
    """Owns a set of :class:`Program`; every child dies with it."""

    _children: dict[str, _Running] = field(default_factory=dict)

    def start(self, program: Program) -> None:
        """Start ``program``; its name must be new."""
        self._children[program.name] = _begin(program, time.monotonic())

    def poll(self, now_s: float) -> list[Exit]:
        """Restart what died and has paused; the deaths seen since the last call."""
        exits = []
        for child in self._children.values():
            if child.restart_at_s is not None:
                if now_s >= child.restart_at_s:
                    again = _begin(child.program, now_s)
                    child.process, child.log_at, child.started_s = (
                        again.process,
                        again.log_at,
                        now_s,
                    )
                    child.restart_at_s = None
                    child.starts += 1
            elif (code := child.process.poll()) is not None:
                exits.append(self._died(child, code, now_s))
        return exits

    def _died(self, child: _Running, code: int, now_s: float) -> Exit:
        lived_s = now_s - child.started_s
        if lived_s >= GOOD_LIFE_S or (lived_s >= GOOD_START_S and -code in FROM_OUTSIDE):
            child.pause_s = child.program.restart_after_s
        pause_s = None if code == WRONG_INPUT else child.pause_s
        child.restart_at_s = math.inf if pause_s is None else now_s + pause_s
        child.pause_s = max(child.program.restart_after_s, min(PAUSE_MAX_S, 2.0 * child.pause_s))
        return Exit(
            child.program.name,
            code,
            child.starts,
            pause_s,
            last_words(child.program.log, child.log_at),
        )

    def pid(self, name: str) -> int:
        """Process id of ``name`` as last started."""
        return self._children[name].process.pid

    def kill(self, name: str, sig: signal.Signals = signal.SIGKILL) -> None:
        """Send ``sig`` to ``name``; a killed one is restarted by :meth:`poll`."""
        with contextlib.suppress(ProcessLookupError):
            self._children[name].process.send_signal(sig)

    def stop(self, timeout_s: float = 3.0) -> None:
        """Ask all to stop, in reverse order of their start; kill those that do not within
        ``timeout_s``."""
        children = [c for c in reversed(self._children.values()) if c.restart_at_s is None]
        for child in children:
            child.process.terminate()
        end_s = time.monotonic() + timeout_s
        for child in children:
            try:
                child.process.wait(max(0.05, end_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
        self._children.clear()


_libc = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """Ask the kernel to end this child when its supervisor dies, however that happens
    (prctl(2))."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def last_words(log: Path, start: int) -> tuple[str, ...]:
    """The last lines that ``log`` holds from byte ``start`` on, whatever bytes are in it."""
    try:
        with log.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(start, file.tell() - LAST_BYTES))
            text = file.read(LAST_BYTES).decode("utf-8", "replace")
    except OSError:
        return ()
    return tuple(line.rstrip() for line in text.splitlines() if line.strip())[-LAST_LINES:]


def _begin(program: Program, now_s: float) -> _Running:
    """Start ``program``, and remember where its words begin in the log."""
    log_at = program.log.stat().st_size if program.log.exists() else 0
    return _Running(program, _spawn(program), now_s, log_at, program.restart_after_s)


def _spawn(program: Program) -> subprocess.Popen[bytes]:
    """Start in its own session, so that a Ctrl-C at the terminal reaches the supervisor alone."""
    program.log.parent.mkdir(parents=True, exist_ok=True)
    with program.log.open("ab") as log:
        return subprocess.Popen(
            program.argv,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
            preexec_fn=die_with_parent,
            env={
                "OMP_NUM_THREADS": "1",
                **os.environ,
            },  # as the service units: matrices are small, threads only spin
        )
