"""``orbitd install``: renders the systemd units to this installation and hands them to the host."""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from firmware_py import launch
from firmware_py.commands.migrate import migrated
from firmware_py.config import Bus
from firmware_py.config.foreign import read_dbc
from firmware_py.config.written import write_rig
from firmware_py.errors import OrbitdError
from firmware_py.machine.folder import SHIPPED, add_option, own_set

UNITS = "usr/lib/systemd/system"
DROP_INS = f"{UNITS}/orbitd-.service.d"
FILES = {
    "systemd/orbitd.target": f"{UNITS}/orbitd.target",
    "systemd/orbitd-guard.service": f"{UNITS}/orbitd-guard.service",
    "systemd/orbitd-brain.service": f"{UNITS}/orbitd-brain.service",
    "systemd/orbitd-gate.service": f"{UNITS}/orbitd-gate.service",
    "systemd/orbitd-hardening.conf": f"{DROP_INS}/hardening.conf",
    "systemd/orbitd.sysusers.conf": "usr/lib/sysusers.d/orbitd.conf",
    "systemd/orbitd.tmpfiles.conf": "usr/lib/tmpfiles.d/orbitd.conf",
    "network/80-orbitd-can.network": "usr/lib/systemd/network/80-orbitd-can.network",
}
"""Source under ``deploy/`` and place under the prefix."""

RIG = "etc/orbitd/rig"
FIRST = "etc/orbitd/orbitd.toml"
"""Place of the rig folder, and of the one file of older installations, which is kept."""

HIDDEN = ("home", "root", "run/user", "tmp", "var/tmp")
"""Folders of the root that ``ProtectHome=`` and ``PrivateTmp=`` hide from the services."""

RELOAD = ("systemctl", "daemon-reload")
HOST_STEPS = (
    ("systemd-sysusers", "orbitd.conf"),
    ("systemd-tmpfiles", "--create", "orbitd.conf"),
    RELOAD,
)


class InstallError(OrbitdError):
    """The service could not be installed; the text says which step and what to do."""


@dataclass(frozen=True)
class InstallPlace:
    """Where to: ``prefix`` is ``/`` on the host itself, another folder for packaging or tests."""

    prefix: Path
    python: Path

    @property
    def is_host(self) -> bool:
        """Whether the units go to the running system."""
        return self.prefix == Path("/")


def main(argv: list[str]) -> int:
    """Install, or remove with ``--remove``."""
    parser = argparse.ArgumentParser(prog="orbitd install", description=__doc__)
    add_option(
        parser,
        "rig to install, unless one is there (default: the shipped bench)",
        default=SHIPPED / "bench",
    )
    parser.add_argument(
        "--prefix",
        type=Path,
        default=Path("/"),
        metavar="DIR",
        help="root of the system to install into (default: /)",
    )
    parser.add_argument(
        "--python",
        type=Path,
        default=Path(sys.executable),
        metavar="FILE",
        help="interpreter that runs orbitd there (default: this one)",
    )
    parser.add_argument(
        "--remove",
        action="store_true",
        help="stop and remove the service; rig, recordings and users stay",
    )
    options = parser.parse_args(argv)
    target = InstallPlace(options.prefix, options.python)
    try:
        return _remove(target) if options.remove else _install(target, options.rig)
    except OSError as error:
        raise InstallError(
            f"cannot write {error.filename}: {error.strerror}; run as root or give --prefix"
        ) from error


def source_folder() -> Path:
    """The ``deploy`` folder: of the source tree, or the one that came with the wheel.

    Raises
    ------
    InstallError
        Neither is there.
    """
    tree = Path(__file__).resolve().parents[2] / "deploy"
    shared = Path(sysconfig.get_path("data")) / "share" / "orbitd"
    for folder in (tree, shared):
        if (folder / "systemd" / "orbitd.target").exists():
            return folder
    raise InstallError(f"no unit files in {tree} or {shared}; install orbitd again")


def _install(target: InstallPlace, wanted: Path) -> int:
    _check_python(target.python)
    there = [name for name in (RIG, FIRST) if (target.prefix / name).exists()]
    name, kept = (there[0], True) if there else (RIG, False)
    place = target.prefix / name
    settings, _ = launch.verified(place if kept else wanted)
    source = source_folder()
    words = _words(target, source, f"/{name}", settings.bus)
    for template, path in FILES.items():
        text = (source / template).read_text(encoding="utf-8")
        _write(target.prefix / path, _render(text, words))
    if not kept:
        place.parent.mkdir(parents=True, exist_ok=True)
        write_rig(_texts(wanted), place, own_set(wanted))
    _host_steps(target)
    print(f"installed under {target.prefix}; rig {place}{' (kept as it was)' if kept else ''}")
    print(f"next: orbitd check /{name} && systemctl enable --now orbitd.target")
    return 0


def _texts(wanted: Path) -> dict[str, str]:
    """The files of the rig to install; one of the first schema becomes a folder."""
    if not wanted.is_dir():
        return migrated(wanted)
    tables = {p.name: p.read_text(encoding="utf-8") for p in sorted(wanted.glob("*.toml"))}
    return tables | {path.name: read_dbc(path) for path in sorted(wanted.glob("*.dbc"))}


def _check_python(python: Path) -> None:
    """Refuse an interpreter that the services could not see."""
    for path in (python.absolute(), python.resolve()):
        hidden = [Path(path.anchor, name) for name in HIDDEN]
        if any(map(path.is_relative_to, hidden)):
            raise InstallError(
                f"python = {path}: the services do not see {', '.join(map(str, hidden))}; make "
                "the environment elsewhere (python3 -m venv /opt/orbitd) and install from there"
            )


def _words(target: InstallPlace, source: Path, rig: str, bus: Bus) -> dict[str, str]:
    """What stands for what in the templates.

    The guard has the last processor for itself where there are two; which ones the machine has is
    known only on the host itself.
    """
    cpus = [str(cpu) for cpu in sorted(os.sched_getaffinity(0))] if target.is_host else []
    apart = len(cpus) > 1
    return {
        "@python@": str(target.python.absolute()),
        "@rig@": rig,
        "@share@": str(source),
        "@can@": bus.channel if bus.interface == "socketcan" else "can0",
        "@nominal_bitrate@": str(bus.nominal_bitrate),
        "@data_bitrate@": str(bus.data_bitrate),
        "@guard_cpus@": cpus[-1] if apart else "",
        "@other_cpus@": " ".join(cpus[:-1]) if apart else "",
    }


def _render(text: str, words: dict[str, str]) -> str:
    for word, value in words.items():
        text = text.replace(word, value)
    return text


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _host_steps(target: InstallPlace) -> None:
    if target.is_host:
        for step in HOST_STEPS:
            _host(*step)


def _host(*step: str) -> None:
    try:
        done = subprocess.run(step, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise InstallError(
            f"{step[0]} is missing: this host runs no systemd; use `orbitd run`"
        ) from error
    if done.returncode:
        raise InstallError(
            f"{' '.join(step)} failed: {done.stderr.strip()}; the files stay in place"
        )


def _remove(target: InstallPlace) -> int:
    if target.is_host and (target.prefix / FILES["systemd/orbitd.target"]).exists():
        _host("systemctl", "disable", "--now", "orbitd.target")
    for place in FILES.values():
        (target.prefix / place).unlink(missing_ok=True)
    with contextlib.suppress(FileNotFoundError):
        (target.prefix / DROP_INS).rmdir()
    if target.is_host:
        _host(*RELOAD)
    print(f"removed the service under {target.prefix}; {target.prefix / RIG} stays")
    return 0
