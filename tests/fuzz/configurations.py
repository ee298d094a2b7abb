"""Random configurations: what is called good is built and runs, what is refused is refused with
every fault named.

Case ``i`` of a seed is always the same.  :func:`run` judges in process: within :data:`SECONDS_MAX`,
no exception but :class:`~firmware_py.config.ConfigError`, each fault with a file, a cause and a
next step; a good one is built as ``orbitd check`` does, and guard and brain of every tenth run
:data:`RUN_S` of scripted frames.  :func:`run_started` starts the real processes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from firmware_py import launch
from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import Models, load_models
from firmware_py.commands import building
from firmware_py.config import Config, ConfigError
from firmware_py.records import PeerRecord

from ..guard.scripted_node import Bench
from .config_cases import Files, case, varied, written
from .outcome import Outcome

SECONDS_MAX: Final = 2.0
RUN_S: Final = 1.2
"""Long enough for the first window of the diagnosis (0.8 s) and some advices."""

DRIVE_EVERY: Final = 10
STARTED_S: Final = 1.0
ROLES: Final = ("guard", "brain", "gate")


# ---------------------------------------------------------------------- in process


def judge(files: Files, folder: Path, *, drive: bool) -> tuple[bool, str]:
    """Whether the configuration is called good, and what is wrong with that; empty when nothing
    is."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        return _judge(written(files, Path(place)), folder, drive=drive)


def _judge(path: Path, folder: Path, *, drive: bool) -> tuple[bool, str]:
    began = time.process_time()
    try:
        config = launch.verified(path)[0]
        building.surroundings(config, folder, {"STATE_DIRECTORY": str(folder)})
        building.build(config, _models(config))
    except ConfigError as error:
        return False, _complaint(error) or _late(began)
    except Exception as error:  # noqa: BLE001 -- any other exception is what is looked for
        return False, f"{type(error).__name__}: {error}"
    late = _late(began)
    if late or not drive:
        return True, late
    try:
        run_device(config)
    except Exception as error:  # noqa: BLE001 -- the same
        return True, f"called good, but running: {type(error).__name__}: {error}"
    return True, ""


def _late(began: float) -> str:
    took = time.process_time() - began
    return f"took {took:.1f} s" if took > SECONDS_MAX else ""


def _complaint(error: ConfigError) -> str:
    """What is wrong with a refusal."""
    if error.exit_code != 2 or not error.faults:
        return "refused without exit code 2 or without a fault"
    for fault in error.faults:
        if not (fault.file and fault.cause and fault.next_step and str(fault).isprintable()):
            return f"a fault that does not say all: {fault!r}"
    return ""


def _models(config: Config) -> Models:
    """The models, loaded once for all configurations that they tell apart no further."""
    bearing, models = config.machine.bearing, config.models
    key = (
        config.device.rig,
        config.sampling.rate_hz,
        bearing.length_m / bearing.journal_radius_m,
        models.directory,
        *models.public_keys,
    )
    if key not in _LOADED:
        if len(_LOADED) > 20:
            _LOADED.clear()
        _LOADED[key] = load_models(config)
    return _LOADED[key]


_LOADED: dict[tuple[Any, ...], Models] = {}


def run_device(config: Config) -> None:
    """The guard on scripted frames at a declared speed, armed, and the brain on what the guard
    says."""
    with np.errstate(all="ignore"):
        bench = Bench(config)
        bench.node.speed_rpm = 0.5 * (
            config.machine.operating.speed_min_rpm + config.machine.operating.speed_max_rpm
        )
        bench.node.oil_C = config.machine.lubricant.inlet_max_C
        brain = BrainCore(config, _models(config))
        for step in range(round(RUN_S * 1000)):
            decision = bench.cycle()
            records: list[PeerRecord] = [*decision.blocks, *decision.readings]
            if decision.state is not None:
                records.append(decision.state)
            if step % 20 == 0 or records:
                brain.step(records, bench.now_ns)
            if step == 1000:
                bench.ask("mode", mode=2)
                bench.ask("arm")


def run(seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Judge ``n`` cases from ``first`` on, with files in ``folder``."""
    outcome = Outcome()
    for i in range(first, first + n):
        good, wrong = judge(case(seed, i), folder, drive=i % DRIVE_EVERY == 0)
        outcome.add(f"seed {seed} case {i}", good, [wrong] if wrong else [])
    return outcome


# ---------------------------------------------------------------------- real processes


def run_started(seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Start guard, brain and gate of ``n`` cases, let good ones run a second each, and end them."""
    outcome = Outcome()
    for i in range(first, first + n):
        files = varied(seed, i) if i % 2 else case(seed, i)  # the first are good more often
        good, wrong = _start(files, folder / f"case{i}")
        outcome.add(f"seed {seed} case {i}", good, wrong)
    return outcome


def _start(files: Files, folder: Path) -> tuple[bool, list[str]]:
    """Whether the configuration is called good, and what is wrong with the starts."""
    path = written(files, folder / "rig")
    environment = {
        **os.environ,
        "ORBITD_BUS_DIR": str(folder),
        "STATE_DIRECTORY": str(folder / "state"),
        "HOME": str(folder),
        "PYTHONWARNINGS": "default",
    }
    checked = _called_good(path, folder)
    if checked is None:
        return False, []
    processes = {role: _process(role, path, folder, environment) for role in ROLES}
    wrong = []
    try:
        if checked:
            deadline = time.monotonic() + 30.0
            sockets = [folder / "guard.sock", folder / "gate.sock"]
            while time.monotonic() < deadline and not all(socket.exists() for socket in sockets):
                time.sleep(0.05)
            time.sleep(STARTED_S)
            for role, process in processes.items():
                if process.poll() is not None:
                    wrong.append(f"called good, but {role} ended with {process.returncode}")
                process.send_signal(signal.SIGTERM)
        for role, process in processes.items():
            try:
                _, said = process.communicate(timeout=30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                _, said = process.communicate()
                wrong.append(f"{role} did not end")
            if b"Traceback" in said:
                wrong.append(f"{role}: {said.decode(errors='replace').strip().splitlines()[-1]}")
            if process.returncode not in ((0, -signal.SIGTERM) if checked else (2,)) and not wrong:
                wrong.append(f"{role}: exit code {process.returncode}, {said[-300:]!r}")
            if not checked and b"config error: " not in said:
                wrong.append(f"{role}: refused without a word, {said[-300:]!r}")
    finally:
        for process in processes.values():
            if process.poll() is None:
                process.kill()
    return checked, wrong


def _called_good(path: Path, folder: Path) -> bool | None:
    """None where only the machine lacks something, which not every process needs."""
    try:
        config = launch.verified(path)[0]
    except ConfigError:
        return False
    return None if building.surroundings(config, folder, {"STATE_DIRECTORY": str(folder)}) else True


def _process(
    role: str, path: Path, folder: Path, environment: dict[str, str]
) -> subprocess.Popen[bytes]:
    command = [
        sys.executable,
        "-m",
        "firmware_py",
        role,
        "--rig",
        str(path),
        "--runtime-dir",
        str(folder),
    ]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment
    )
