"""Latency of the protection, beside a plain echo on the same bus in the same run at the same
priority.

A guard of its own, with the danger delay set to zero, on a hub of its own; nothing else of the demo
runs.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py.config.written import rig_texts, write_rig
from firmware_py.supervise import Program, Supervisor, die_with_parent
from sim_hil.demo.reaction import PRIORITY
from sim_hil.demo.setting import Setting

ECHO: Final = Path(__file__).resolve().parents[2] / "deploy" / "examples" / "echo_client.py"
"""A client with no code of the project beyond the bus plugin."""

ECHO_COUNT: Final = 2000
TIMEOUT_S: Final = 120.0


def measure(setting: Setting, trials: int) -> dict[str, Any]:
    """Reaction of the guard (danger delay 0) and round trip of the echo, both in ms; None where it
    failed."""
    limits = msgspec.structs.replace(setting.config.limits, danger_delay_s=0.0)
    shipped_ms = 1000 * setting.config.limits.danger_delay_s
    with tempfile.TemporaryDirectory(prefix="orbitd-latency-") as name:
        folder = Path(name)
        config = setting.on(channel=folder.name).config.replaced(limits=limits)
        write_rig(rig_texts(config), folder / "rig")
        options = ("--rig", str(folder / "rig"), "--runtime-dir", str(folder))
        supervisor = Supervisor()
        guard = (sys.executable, "-m", "firmware_py", "guard", *options)
        supervisor.start(Program("guard", guard, folder / "guard.log"))
        try:
            pong = _start(str(ECHO), "pong", folder.name)
            ping = _start(str(ECHO), "ping", folder.name, str(ECHO_COUNT))
            reaction = _start("-m", "sim_hil.demo.reaction", *options, "--trials", str(trials))
            found = {"exceedance_to_safe": _result(reaction), "echo": _result(ping)}
            pong.terminate()
            return {**found, "shipped_danger_delay_ms": shipped_ms}
        finally:
            supervisor.stop()


def _first_in_line() -> None:
    """The guard's own priority, where that is allowed."""
    die_with_parent()
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def _start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_first_in_line,
    )


def _result(process: subprocess.Popen[str]) -> dict[str, Any]:
    """The JSON object that ``process`` prints; its complaint when it prints none."""
    try:
        output, complaint = process.communicate(timeout=TIMEOUT_S)
        found: dict[str, Any] = json.loads(output)
        return found
    except (subprocess.TimeoutExpired, ValueError):
        process.kill()
        return {"failed": (complaint if process.returncode else "no answer in time").strip()[-900:]}
