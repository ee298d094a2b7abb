"""Starts processes, keeps them alive, stops them: for laptops and demos, where systemd is not at hand."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Program:
    """One process to keep alive; its output goes to ``log``."""

    name: str
    argv: tuple[str, ...]
    log: Path
    restart_after_s: float = 0.1


@dataclass
class _Running:
    program: Program
    process: subprocess.Popen[bytes]
    starts: int = 1
    restart_at_s: float | None = None


@dataclass(frozen=True)
class Exit:
    """A process that ended without being asked to."""

    name: str
    code: int
    starts: int


@dataclass
class Supervisor:
    """Owns a set of :class:`Program`; every child dies with it."""

    _children: dict[str, _Running] = field(default_factory=dict)

    def start(self, program: Program) -> None:
        """Start ``program``; its name must be new."""
        self._children[program.name] = _Running(program, _spawn(program))

    def poll(self, now_s: float) -> list[Exit]:
        """Restart what died ``restart_after_s`` ago; the deaths seen since the last call."""
        exits = []
        for child in self._children.values():
            if child.restart_at_s is not None:
                if now_s >= child.restart_at_s:
                    child.process, child.restart_at_s = _spawn(child.program), None
                    child.starts += 1
            elif (code := child.process.poll()) is not None:
                child.restart_at_s = now_s + child.program.restart_after_s
                exits.append(Exit(child.program.name, code, child.starts))
        return exits

    def pid(self, name: str) -> int:
        """Process id of ``name`` as last started."""
        return self._children[name].process.pid

    def kill(self, name: str, sig: signal.Signals = signal.SIGKILL) -> None:
        """Send ``sig`` to ``name``; a killed one is restarted by :meth:`poll`."""
        with contextlib.suppress(ProcessLookupError):
            self._children[name].process.send_signal(sig)

    def stop(self, timeout_s: float = 3.0) -> None:
        """Ask all to stop, in reverse order of their start; kill those that do not within ``timeout_s``."""
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
    """Ask the kernel to end this child when its supervisor dies, however that happens (prctl(2))."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


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
            env={"OMP_NUM_THREADS": "1", **os.environ},  # as the service units: matrices are small, threads only spin
        )
