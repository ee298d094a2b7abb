"""``orbitd install``: renders the systemd units to this installation and hands them to the host."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from firmware_py import config
from firmware_py.errors import OrbitdError

UNITS = "usr/lib/systemd/system"
FILES = {
    "systemd/orbitd.target": f"{UNITS}/orbitd.target",
    "systemd/orbitd-guard.service": f"{UNITS}/orbitd-guard.service",
    "systemd/orbitd-brain.service": f"{UNITS}/orbitd-brain.service",
    "systemd/orbitd-gate.service": f"{UNITS}/orbitd-gate.service",
    "systemd/orbitd.sysusers.conf": "usr/lib/sysusers.d/orbitd.conf",
    "systemd/orbitd.tmpfiles.conf": "usr/lib/tmpfiles.d/orbitd.conf",
    "network/80-orbitd-can0.network": "usr/lib/systemd/network/80-orbitd-can0.network",
    "network/80-orbitd-serial.rules": "usr/lib/udev/rules.d/80-orbitd-serial.rules",
}
"""Source under ``deploy/`` and place under the prefix."""

CONFIG = "etc/orbitd/orbitd.toml"
HOST_STEPS = (
    ("systemd-sysusers",),
    ("systemd-tmpfiles", "--create", "orbitd.conf"),
    ("systemctl", "daemon-reload"),
)


class InstallError(OrbitdError):
    """The service could not be installed; the text says which step and what to do."""


@dataclass(frozen=True)
class Target:
    """Where to: ``prefix`` is ``/`` on the host itself, another folder for packaging or tests."""

    prefix: Path
    python: str

    @property
    def is_host(self) -> bool:
        """Whether the units go to the running system."""
        return self.prefix == Path("/")


def main(argv: list[str]) -> int:
    """Install, or remove with ``--remove``."""
    parser = argparse.ArgumentParser(prog="orbitd install", description=__doc__)
    parser.add_argument("--config", type=Path, default=config.SHIPPED / "bench.toml", help="configuration to install")
    parser.add_argument("--prefix", type=Path, default=Path("/"), help="root of the system to install into (/)")
    parser.add_argument("--python", default=sys.executable, help="interpreter that runs orbitd there")
    parser.add_argument("--remove", action="store_true", help="remove the units; the configuration stays")
    options = parser.parse_args(argv)
    target = Target(options.prefix, options.python)
    if options.remove:
        return _remove(target)
    config.load(options.config)
    return _install(target, options.config)


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


def _install(target: Target, config_path: Path) -> int:
    source = source_folder()
    words = {"@python@": target.python, "@config@": f"/{CONFIG}", "@share@": str(source.parent)}
    try:
        for name, place in FILES.items():
            path = target.prefix / place
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(_render((source / name).read_text(), words))
        _install_config(target, config_path)
    except PermissionError as error:
        raise InstallError(f"may not write {error.filename}; run as root or give --prefix") from error
    _host_steps(target)
    print(f"installed under {target.prefix}; configuration {target.prefix / CONFIG}")
    print("next: orbitd check /etc/orbitd/orbitd.toml && systemctl enable --now orbitd.target")
    return 0


def _install_config(target: Target, config_path: Path) -> None:
    """Copy the configuration; one that a person has edited is kept."""
    place = target.prefix / CONFIG
    if place.exists():
        print(f"kept {place}")
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(config_path, place)


def _remove(target: Target) -> int:
    if target.is_host:
        subprocess.run(["systemctl", "disable", "--now", "orbitd.target"], check=False)
    for place in FILES.values():
        (target.prefix / place).unlink(missing_ok=True)
    print(f"removed the units under {target.prefix}; {target.prefix / CONFIG} stays")
    return 0


def _host_steps(target: Target) -> None:
    if not target.is_host:
        return
    for step in HOST_STEPS:
        try:
            done = subprocess.run(step, capture_output=True, text=True, check=False)
        except FileNotFoundError as error:
            raise InstallError(f"{step[0]} is missing: this host runs no systemd; use `orbitd run`") from error
        if done.returncode:
            raise InstallError(f"{' '.join(step)} failed: {done.stderr.strip()}; the files stay in place")


def _render(text: str, words: dict[str, str]) -> str:
    for word, value in words.items():
        text = text.replace(word, value)
    return text
