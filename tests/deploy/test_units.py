"""The service's files as ``orbitd install`` renders them, judged by systemd itself."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import socket
import subprocess
from pathlib import Path

import pytest

from firmware_py import config, launch
from firmware_py.commands import install
from firmware_py.commands.install import FILES, FIRST, RIG, UNITS, InstallError
from tests.first_schema import BENCH

EXPOSURE_MAX = 2.0
PYTHON = "/bin/sh"
"""Stands for the interpreter: verify wants a file that can be executed where the services may see
it."""

needs_systemd = pytest.mark.skipif(
    not shutil.which("systemd-analyze"), reason="systemd-analyze is not installed"
)


def installed(prefix: Path, *extra: str) -> Path:
    assert install.main(["--prefix", str(prefix), "--python", PYTHON, *extra]) == 0
    return prefix


def files(prefix: Path) -> dict[str, str]:
    return {
        str(path.relative_to(prefix)): path.read_text()
        for path in prefix.rglob("*")
        if path.is_file()
    }


def services(prefix: Path) -> list[Path]:
    return sorted((prefix / UNITS).glob("orbitd-*.service"))


@needs_systemd
def test_verify_prints_nothing(tmp_path: Path) -> None:
    paths = [*services(installed(tmp_path)), tmp_path / UNITS / "orbitd.target"]
    said = subprocess.run(
        ["systemd-analyze", "verify", *paths], capture_output=True, text=True, check=False
    )
    assert (said.returncode, said.stdout, said.stderr) == (0, "", "")


@needs_systemd
def test_verify_sees_a_wrong_key_in_the_shared_hardening(tmp_path: Path) -> None:
    drop_in = installed(tmp_path) / FILES["systemd/orbitd-hardening.conf"]
    drop_in.write_text(drop_in.read_text() + "NoSuchKey=yes\n")
    said = subprocess.run(
        ["systemd-analyze", "verify", *services(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "NoSuchKey" in said.stderr


@needs_systemd
@pytest.mark.parametrize("room", ["guard", "brain", "gate"])
def test_exposure(tmp_path: Path, room: str) -> None:
    unit = installed(tmp_path) / UNITS / f"orbitd-{room}.service"
    said = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", "--no-pager", unit],
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"Overall exposure level for \S+: ([\d.]+)", said.stdout)
    assert found, said.stderr
    assert float(found[1]) <= EXPOSURE_MAX


def test_every_template_word_is_filled_in(tmp_path: Path) -> None:
    left = {name: re.findall(r"@\w+@", text) for name, text in files(installed(tmp_path)).items()}
    assert not any(left.values()), left


def test_every_service_is_watched_and_has_its_own_user(tmp_path: Path) -> None:
    units = {path.stem: path.read_text() for path in services(installed(tmp_path))}
    assert sorted(units) == ["orbitd-brain", "orbitd-gate", "orbitd-guard"]
    for name, text in units.items():
        assert "Type=notify\n" in text
        assert re.search(r"^WatchdogSec=\d+$", text, re.MULTILINE)
        assert f"\nUser={name}\n" in text
    assert "CPUSchedulingPolicy=fifo\n" in units["orbitd-guard"]
    assert "\nEnvironment=ORBITD_BOOT_ID=%b\n" in units["orbitd-guard"], "it does not see /proc/sys"


def test_no_system_call_filter_begins_as_a_deny_list(tmp_path: Path) -> None:
    """The first filter decides what the rest means: an allow list must come first, in the unit
    itself."""
    for path in services(installed(tmp_path)):
        assert (
            re.findall(r"^SystemCallFilter=(.*)$", path.read_text(), re.MULTILINE)[0]
            == "@system-service"
        )
    assert "SystemCallFilter" not in (tmp_path / FILES["systemd/orbitd-hardening.conf"]).read_text()


def test_installing_twice_changes_nothing(tmp_path: Path) -> None:
    once = files(installed(tmp_path))
    assert files(installed(tmp_path)) == once


def test_an_edited_configuration_is_kept_and_decides_the_bit_rates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = installed(tmp_path) / RIG / "device.toml"
    edited = place.read_text().replace('interface = "orbitd_hub"', 'interface = "socketcan"')
    edited = edited.replace('channel = "orbitd0"', 'channel = "can7"').replace("5000000", "4000000")
    place.write_text(edited)
    installed(tmp_path)
    assert place.read_text() == edited
    assert "kept" in capsys.readouterr().out
    network = (tmp_path / FILES["network/80-orbitd-can.network"]).read_text()
    assert "Name=can7\n" in network
    assert "DataBitRate=4000000\n" in network


def test_the_one_file_of_an_older_installation_stays_in_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    old = tmp_path / FIRST
    old.parent.mkdir(parents=True)
    old.write_text(BENCH.replace("5_000_000", "4_000_000"))
    installed(tmp_path)
    assert "kept" in capsys.readouterr().out
    assert not (tmp_path / RIG).exists()
    assert (
        "DataBitRate=4000000\n" in (tmp_path / FILES["network/80-orbitd-can.network"]).read_text()
    )
    assert all(f"--rig /{FIRST} " in unit.read_text() for unit in services(tmp_path))
    places = (tmp_path / RIG, tmp_path / FIRST)
    monkeypatch.setattr(launch, "SERVICE_RIGS", places)
    assert launch.service_rig() == old
    places[0].mkdir()
    assert launch.service_rig() == places[0]


def test_the_named_rig_is_installed(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    shutil.copytree(config.SHIPPED / "seed", mine)
    (mine / "machine.toml").write_text((mine / "machine.toml").read_text() + "# mine\n")
    (mine / "plant.dbc").write_text('VERSION ""\n')  # of a foreign bus: it travels as well
    installed(tmp_path / "root", "--rig", str(mine))
    assert files(tmp_path / "root" / RIG) == files(mine)
    assert all(f"--rig /{RIG} " in unit.read_text() for unit in services(tmp_path / "root"))


def test_a_named_file_of_the_first_schema_is_installed_as_a_rig(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(BENCH.replace("5_000_000", "4_000_000"))
    installed(tmp_path / "root", "--config", str(mine))
    assert config.load(tmp_path / "root" / RIG)[0] == config.load(mine)[0]


def test_a_wrong_configuration_installs_nothing(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[nonsense]\n")
    with pytest.raises(config.ConfigError, match="nonsense"):
        installed(tmp_path / "root", "--config", str(wrong))
    assert not (tmp_path / "root").exists()


def test_remove_leaves_the_configuration_alone(tmp_path: Path) -> None:
    installed(tmp_path)
    assert install.main(["--prefix", str(tmp_path), "--remove"]) == 0
    assert {Path(name).parent for name in files(tmp_path)} == {Path(RIG)}
    assert not (tmp_path / install.DROP_INS).exists()


@pytest.mark.parametrize("folder", ["home", "root", "run/user", "tmp", "var/tmp"])
def test_an_interpreter_that_the_services_cannot_see_is_refused(
    tmp_path: Path, folder: str
) -> None:
    python = str(Path("/", folder, "me", "bin", "python"))
    with pytest.raises(InstallError, match="/opt/orbitd"):
        install.main(["--prefix", str(tmp_path), "--python", python])
    assert not files(tmp_path)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InstallError, match=f"cannot write {tmp_path}/file.*--prefix"):
        installed(tmp_path / "file")


def test_the_service_is_found_by_the_sockets_that_this_user_may_write(tmp_path: Path) -> None:
    assert not launch.service_runs(tmp_path)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "gate.sock"))
        assert launch.service_runs(tmp_path)


def test_a_peer_is_a_user_of_this_machine() -> None:
    parser = argparse.ArgumentParser()
    launch.add_options(parser)
    launch.add_peers(parser, "brain", "gate")
    options = parser.parse_args(["--brain-user", "root", "--runtime-dir", os.devnull])
    assert (options.brain_user, options.gate_user) == (0, None)
    with pytest.raises(argparse.ArgumentTypeError, match="no user 'nosuchuser'"):
        launch.user_id("nosuchuser")


def test_launch_tells_the_peers(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    launch.add_options(parser)
    launch.add_peers(parser, "brain")
    started = launch.from_options(
        parser.parse_args(["--brain-user", "root", "--runtime-dir", str(tmp_path)])
    )
    assert started.peers == {"brain": 0}
    assert started.source.path == config.SHIPPED / "bench"
