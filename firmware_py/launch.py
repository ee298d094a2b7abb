"""What every process of the device is started with: configuration, instance, runtime directory."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

import msgspec

from firmware_py.config import SHIPPED, Config, ConfigFile, load
from firmware_py.wire.rooms import runtime_dir


@dataclass(frozen=True)
class Launch:
    """A checked configuration and the folder of this instance's sockets."""

    config: Config
    source: ConfigFile
    runtime: Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """``--config``, ``--instance`` and ``--runtime-dir``, the same for every process."""
    parser.add_argument(
        "--config",
        type=Path,
        default=SHIPPED / "bench.toml",
        metavar="FILE",
        help="TOML configuration (default: the shipped bench.toml)",
    )
    parser.add_argument("--instance", metavar="NAME", help="name of this device on this machine")
    parser.add_argument("--runtime-dir", type=Path, metavar="DIR", help="folder of this instance's sockets")


def from_options(options: argparse.Namespace) -> Launch:
    """Read the configuration and make the runtime directory.

    Raises
    ------
    ConfigError, RoomError
        The configuration is wrong, or the directory is not safe to use.
    """
    loaded, source = load(options.config)
    if options.instance:
        device = msgspec.structs.replace(loaded.device, instance=options.instance)
        loaded = msgspec.structs.replace(loaded, device=device)
    if options.runtime_dir:
        folder: Path = options.runtime_dir
        folder.mkdir(mode=0o770, parents=True, exist_ok=True)
    else:
        folder = runtime_dir(loaded.device.instance, runtime_base())
    return Launch(loaded, source, folder)


def runtime_base() -> Path:
    """Where runtime directories lie: systemd's, the system service's, the session's, or a private one."""
    if given := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(given.partition(":")[0])
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "orbitd"
    return Path(f"/tmp/orbitd-{os.getuid()}")
