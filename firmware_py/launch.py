"""What every process of the device is started with: configuration, instance, runtime directory,
peers.

Without options, a person who may reach the system service gets the service: its sockets, its
configuration.
"""

from __future__ import annotations

import argparse
import importlib
import os
import pwd
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.config import (
    SHIPPED,
    Check,
    Config,
    ConfigError,
    DeviceConfig,
    Source,
    load,
    read_device,
)
from firmware_py.machine import folder
from firmware_py.machine.values import NAME_PATTERN, WORDS
from firmware_py.wire.listener import INSTANCE_MODE
from firmware_py.wire.peer_socket import PeerError
from firmware_py.wire.peers import checked_dir, runtime_dir

SERVICE_RUNTIME: Final = Path("/run/orbitd")
SERVICE_STATE: Final = Path("/var/lib/orbitd")
"""State folder of the gate of the service, which is in the sockets' group."""
SERVICE_RIGS: Final = (Path("/etc/orbitd/rig"), Path("/etc/orbitd/orbitd.toml"))
"""Where `orbitd install` puts the rig of the system service, and where it once did."""

LAWS: Final = (
    "firmware_py.guard.envelope.carrying:check_carried",
    "firmware_py.guard.envelope.shield_check:check_safe",
)
"""What else every process asks of a configuration, by name as entry points are: this module lies
below the guard."""


@dataclass(frozen=True)
class Launch:
    """A checked configuration, the folder of this instance's sockets, and the user of each peer
    (None: our own)."""

    config: Config
    source: Source
    runtime: Path
    peers: Mapping[str, int | None]


def add_options(parser: argparse.ArgumentParser) -> None:
    """``--rig``, ``--instance`` and ``--runtime-dir``, the same for every process."""
    folder.add_option(
        parser, "shipped rig, rig folder or file (default: the running service's, else bench)"
    )
    parser.add_argument(
        "--instance", type=instance_name, metavar="NAME", help="name of this device on this machine"
    )
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", help="folder of this instance's sockets"
    )
    parser.set_defaults(peers=())


def add_peers(parser: argparse.ArgumentParser, *roles: str) -> None:
    """``--ROLE-user`` for each role that calls at this process's socket; after
    :func:`add_options`."""
    parser.set_defaults(peers=roles)
    for role in roles:
        parser.add_argument(
            f"--{role}-user",
            type=user_id,
            metavar="USER",
            help=f"user that the {role} must be (default: this one)",
        )


def add_guard_user(parser: argparse.ArgumentParser) -> None:
    """``--guard-user``: whose guard this process talks to, when it is another user's."""
    parser.add_argument(
        "--guard-user",
        type=user_id,
        metavar="USER",
        help="user that the guard must be (default: this one, root, or the socket's owner in a "
        "folder "
        "that the administrator shares)",
    )


def instance_name(name: str) -> str:
    """``name`` if it may be one of a device, and so of a folder; else a refusal of argparse."""
    if not re.search(NAME_PATTERN, name):
        raise argparse.ArgumentTypeError(f"{name!r} is not {WORDS[NAME_PATTERN]}")
    return name


def user_id(name: str) -> int:
    """The id of user ``name``; a refusal of argparse when there is none."""
    try:
        return pwd.getpwnam(name).pw_uid
    except KeyError as error:
        cause = f"no user {name!r} on this machine; `orbitd install` makes the service's users"
        raise argparse.ArgumentTypeError(cause) from error


def verified(path: Path) -> tuple[Config, Source]:
    """The configuration as every process of the device, and ``orbitd check``, reads it.

    Raises
    ------
    ConfigError
        With every fault of the file, its values and the guard's laws.
    """
    config, source = load(path, laws())
    if config.machine.foreign is None and not config.machine.map:
        return config, source
    from firmware_py.config import foreign  # reads a DBC, which few rigs have

    wrong = [source.fault(*found) for found in foreign.faults(config, path)]
    if wrong:
        raise ConfigError(wrong)
    return config, source


def laws() -> list[Check]:
    """The checks of :data:`LAWS`."""
    parts = [name.partition(":") for name in LAWS]
    return [getattr(importlib.import_module(module), function) for module, _, function in parts]


def from_options(options: argparse.Namespace) -> Launch:
    """Read and verify the configuration and make the runtime directory.

    Raises
    ------
    ConfigError, PeerError
        The configuration is wrong, or the directory is not safe to use.
    """
    path, service = _chosen(options)
    loaded, source = verified(path)
    if options.instance:
        loaded = as_instance(loaded, options.instance)
    runtime = SERVICE_RUNTIME if service else _folder(options.runtime_dir, loaded.device.instance)
    return Launch(
        loaded, source, runtime, {role: getattr(options, f"{role}_user") for role in options.peers}
    )


@dataclass(frozen=True)
class Place:
    """Where a device runs, and what it is called."""

    device: DeviceConfig
    runtime: Path


def place(options: argparse.Namespace) -> Place:
    """As :func:`from_options`, for whoever only speaks to a device: of a file with faults the names
    are enough.

    A running device has read its configuration long ago; one that was edited badly since bars
    nobody from `disarm`.

    Raises
    ------
    ConfigError, PeerError
        The file does not name the device, or the directory is not safe to use.
    """
    path, service = _chosen(options)
    device = read_device(path)
    if options.instance:
        device = msgspec.structs.replace(device, instance=options.instance)
    return Place(
        device, SERVICE_RUNTIME if service else _folder(options.runtime_dir, device.instance)
    )


def shelf_folder(config: Config, state: Path) -> Path:
    """Where the sets of models of this device lie (:mod:`firmware_py.model_sets.shelf`)."""
    return state / "models" / config.device.rig


@dataclass(frozen=True)
class ShelfPlace:
    """A device's configuration, what it was read from, and its shelf of models."""

    config: Config
    source: Source
    folder: Path


def shelf_place(options: argparse.Namespace) -> ShelfPlace:
    """As :func:`from_options`, for whoever deals with the models of a device, running or not.

    Raises
    ------
    ConfigError
        The configuration is wrong.
    """
    path, service = _chosen(options)
    loaded, source = verified(path)
    if options.instance:
        loaded = as_instance(loaded, options.instance)
    state = SERVICE_STATE if service else state_dir(loaded, os.environ)
    return ShelfPlace(loaded, source, shelf_folder(loaded, state))


def _chosen(options: argparse.Namespace) -> tuple[Path, bool]:
    """The configuration that the options mean, and whether the system service is meant."""
    chosen = options.instance or options.runtime_dir or "RUNTIME_DIRECTORY" in os.environ
    service = not chosen and service_runs(SERVICE_RUNTIME)
    return options.rig or (service_rig() if service else SHIPPED / "bench"), service


def service_rig() -> Path:
    """The rig of the system service: its folder, else the one file of older installations."""
    return next((path for path in SERVICE_RIGS if path.exists()), SERVICE_RIGS[0])


def as_instance(loaded: Config, instance: str) -> Config:
    """``loaded`` under another instance name, on a hub of its own, so that two devices do not share
    a bus."""
    if instance == loaded.device.instance:
        return loaded
    device = msgspec.structs.replace(loaded.device, instance=instance)
    bus = loaded.bus
    if bus.interface == "orbitd_hub":
        bus = msgspec.structs.replace(bus, channel=f"{bus.channel}-{instance}")
    return loaded.replaced(device=device, bus=bus)


def _folder(given: Path | None, instance: str) -> Path:
    if given is None:
        return runtime_dir(instance, runtime_base())
    try:
        given.mkdir(mode=INSTANCE_MODE, parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise PeerError(
            f"runtime directory {given}: {error}; name a folder that this user may make"
        ) from error
    return checked_dir(given)


def folder_of(config: Config) -> Path:
    """Where the sockets of the device of ``config`` lie; nothing is made."""
    return runtime_base() / config.device.instance


def service_runs(runtime: Path) -> bool:
    """Whether the system service has its sockets in ``runtime`` and this user may use them."""
    return any(os.access(runtime / name, os.W_OK) for name in ("guard.sock", "gate.sock"))


def runtime_base() -> Path:
    """Where runtime directories lie: the given one, the session's, or a private one."""
    if given := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(given.partition(":")[0])
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "orbitd"
    return Path(f"/tmp/orbitd-{os.getuid()}")


def state_dir(config: Config, environment: Mapping[str, str]) -> Path:
    """The one folder that the device writes to: the service's, else the user's."""
    if state := environment.get("STATE_DIRECTORY", "").partition(":")[0]:
        return Path(state)
    home = environment.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(home) / "orbitd" / config.device.instance
