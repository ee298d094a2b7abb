"""``orbitd gate``: the gate's process. Opens sockets and files, steps a hundred times a second,
closes them."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from firmware_py import __version__, background, launch, notify
from firmware_py.clock import Clock, MonotonicClock
from firmware_py.config import Config
from firmware_py.decoding import FILE_LIMIT_BYTES, OutsideError, from_json, read_file
from firmware_py.gate import keys, session
from firmware_py.gate.core import Gate, GateParts
from firmware_py.gate.models_file import ModelsFile
from firmware_py.gate.normal_file import NormalFile
from firmware_py.gate.page import Page
from firmware_py.gate.recorder import Recorder
from firmware_py.gate.station import GroundStation
from firmware_py.gate.telemetry import Telemetry
from firmware_py.launch import Launch, shelf_folder, state_dir
from firmware_py.model_sets.shelf import Shelf
from firmware_py.options import port
from firmware_py.routing import GATE_PERIOD_NS
from firmware_py.wire.peers import PeerClient, PeerServer

WATCHDOG_EVERY: Final = 50
"""Steps between two signs of life to the service manager."""

SHIPPED_MODELS: Final = Path(__file__).resolve().parents[2] / "models" / "artifacts"


def main(argv: list[str]) -> int:
    """Run the gate until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog="orbitd gate", description=__doc__)
    launch.add_options(parser)
    parser.add_argument(
        "--record",
        type=Path,
        metavar="DIR",
        help="folder of the recordings (default: "
        "recorder.directory, else the service's state folder, else ~/.local/state/orbitd)",
    )
    parser.add_argument(
        "--ground-station",
        type=port,
        default=0,
        metavar="PORT",
        help="speak MAVLink to the ground station on this UDP port of the loopback, e.g. 14550",
    )
    launch.add_peers(parser, "brain")
    launch.add_guard_user(parser)
    options = parser.parse_args(argv)
    started = launch.from_options(options)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    directory = options.record or recordings_dir(started.config, os.environ)
    run(
        started,
        directory,
        notify.from_environment(),
        stop.is_set,
        MonotonicClock(),
        options.ground_station,
        options.guard_user,
    )
    return 0


def run(
    started: Launch,
    recordings: Path,
    notifier: notify.Notifier,
    stopped: Callable[[], bool],
    clock: Clock,
    ground_station: int = 0,
    guard_uid: int | None = None,
) -> None:
    """Serve until ``stopped``; ``ground_station`` is a UDP port, 0 for none; ``guard_uid`` whose
    guard it must be.

    Raises
    ------
    SessionError, PeerError
        Another gate serves this instance, or an endpoint cannot be bound.
    """
    config = started.config
    models = read_models(config)
    parts = _open_parts(started, recordings, models, guard_uid)
    gate = Gate(config, parts, models, time.time_ns)
    if ground_station:
        gate.station = GroundStation(ground_station, config, gate.ask)
    page = gate.page = Page(config.metrics.port) if config.metrics.port else None
    background.restore()
    notifier.ready()
    try:
        _loop(gate, page, notifier, stopped, clock)
    finally:
        notifier.stopping()
        if page:
            page.close()
        if gate.station:
            gate.station.close()
        _close(parts)


def _loop(
    gate: Gate,
    page: Page | None,
    notifier: notify.Notifier,
    stopped: Callable[[], bool],
    clock: Clock,
) -> None:
    due_ns, steps = clock.now_ns(), 0
    while not stopped():
        gate.step(clock.now_ns())
        steps += 1
        if steps % WATCHDOG_EVERY == 0:
            notifier.watchdog()
        if page:
            page.step(gate, clock.now_ns())
        due_ns = max(due_ns + GATE_PERIOD_NS, clock.now_ns())
        clock.sleep_until(due_ns)


def _open_parts(started: Launch, recordings: Path, models: Any, guard_uid: int | None) -> GateParts:
    config, folder = started.config, started.runtime
    prefix = keys.prefix(config.device.site, config.device.rig)
    brain = PeerServer(folder / "gate.sock", started.peers)
    telemetry = Telemetry(
        session.open_device(config.zenoh, folder, prefix),
        prefix,
        session.SocketWatch(folder, prefix),
    )
    recorder = None
    if config.recorder.enabled:
        name = f"{config.device.site}-{config.device.rig}-{config.device.instance}"
        recorder = Recorder(
            recordings,
            name,
            metadata(config, models),
            config.recorder.max_megabytes * 10**6,
            time.time_ns,
            raw_frames=config.recorder.raw_frames,
        )
    state = state_dir(config, os.environ)
    if "STATE_DIRECTORY" in os.environ:  # of the service: people of its group add sets
        with contextlib.suppress(OSError):  # a disk that takes nothing is told by the recorder
            Shelf(shelf_folder(config, state)).make()
    return GateParts(
        PeerClient(folder / "guard.sock", "gate", guard_uid),
        brain,
        telemetry,
        recorder,
        NormalFile(state, time.time_ns),
        ModelsFile(shelf_folder(config, state), time.time_ns),
    )


def _close(parts: GateParts) -> None:
    parts.telemetry.close()
    parts.guard.close()
    parts.brain.close()
    parts.models.close()
    if parts.recorder:
        parts.recorder.close()


def metadata(config: Config, models: Any) -> dict[str, str]:
    """Head of each recording: what a replay needs to know of the device that made it."""
    return {
        "config": msgspec.json.encode(config).decode(),
        "models": json.dumps(models, sort_keys=True),
        "orbitd": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
    }


def read_models(config: Config) -> Any:
    """The manifest of the model folder, as it stands; empty when there is none."""
    folder = Path(config.models.directory) if config.models.directory else SHIPPED_MODELS
    shadow = _sha256(Path(config.models.shadow)) if config.models.shadow else {}
    try:
        return shadow | from_json(
            read_file(folder / "manifest.json"), dict[str, Any], FILE_LIMIT_BYTES
        )
    except (OSError, OutsideError):
        return shadow


def _sha256(shadow: Path) -> dict[str, Any]:
    """Digest of the model in shadow; empty where it cannot be read."""
    try:
        return {"shadow": hashlib.sha256(shadow.read_bytes()).hexdigest()}
    except OSError:
        return {}


def recordings_dir(config: Config, environment: Mapping[str, str]) -> Path:
    """Where recordings go when the command line does not say."""
    return (
        Path(config.recorder.directory)
        if config.recorder.directory
        else state_dir(config, environment)
    )
