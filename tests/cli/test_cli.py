"""The command line: help, wrong input in one line with a next step, and exit codes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py import __version__, cli
from firmware_py.config import SHIPPED, load
from firmware_py.launch import as_instance


def orbitd(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "firmware_py", *arguments], capture_output=True, text=True, timeout=60,
                          check=False)


def test_help_lists_every_registered_command() -> None:
    done = orbitd("--help")
    assert done.returncode == 0
    listed = {line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ")}
    assert listed == {name for name, _ in cli.SUMMARIES}


def test_a_reader_that_has_seen_enough_ends_it_quietly() -> None:
    done = subprocess.run(
        f"{sys.executable} -m firmware_py --help | true", shell=True, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.stderr == ""


def test_another_instance_has_a_bus_of_its_own_and_the_configured_one_keeps_its_bus() -> None:
    loaded, _ = load(SHIPPED / "bench.toml")
    assert as_instance(loaded, loaded.device.instance).bus.channel == loaded.bus.channel
    assert as_instance(loaded, "two").bus.channel != loaded.bus.channel


def test_no_command_shows_help_and_fails() -> None:
    done = orbitd()
    assert done.returncode == 2
    assert "usage: orbitd COMMAND" in done.stdout


def test_version() -> None:
    assert orbitd("--version").stdout.strip() == f"orbitd {__version__}"


def test_unknown_command_is_one_line_with_a_next_step() -> None:
    done = orbitd("fly")
    assert (done.returncode, done.stderr) == (2, "orbitd: no command 'fly'; `orbitd --help` lists them\n")


@pytest.mark.parametrize("command", ["guard", "brain", "gate", "check", "status", "arm", "hil", "bus", "run"])
def test_a_wrong_configuration_is_one_line_and_exit_code_2(command: str, tmp_path: Path) -> None:
    text = (SHIPPED / "bench.toml").read_text().replace("min_film_um", "min_flim_um")
    wrong = tmp_path / "rotor.toml"
    wrong.write_text(text)
    arguments = [str(wrong)] if command == "check" else ["--config", str(wrong), "--runtime-dir", str(tmp_path)]
    done = orbitd(command, *arguments)
    assert done.returncode == 2
    assert done.stderr.startswith("orbitd: config error: rotor.toml:")
    assert done.stderr.count("\n") == 1
    assert "limits.min_flim_um: unknown key" in done.stderr


@pytest.mark.parametrize(("command", "extra"), [("status", ()), ("arm", ()), ("set", ("clearance", "60"))])
def test_a_device_that_is_not_there_is_exit_code_3(command: str, extra: tuple[str, ...], tmp_path: Path) -> None:
    done = orbitd(command, *extra, "--runtime-dir", str(tmp_path))
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1


def test_check_accepts_the_shipped_configuration_and_its_models() -> None:
    done = orbitd("check", str(SHIPPED / "bench.toml"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "admissible over the whole declared range" in done.stdout
    assert [line.split()[1] for line in done.stdout.splitlines() if line.startswith("  model")] == [
        "classifier", "actor", "surrogate",
    ]  # fmt: skip


def test_check_names_the_models_that_do_not_fit_a_rig() -> None:
    done = orbitd("check", str(SHIPPED / "seed.toml"))
    assert done.returncode == 1
    assert "admissible over the whole declared range" in done.stdout
    assert "REFUSED classifier" in done.stdout
    assert "bench" in done.stdout


def test_demo_refuses_what_it_cannot_play() -> None:
    short = orbitd("demo", "--seconds", "5")
    assert (short.returncode, "shorter than 20 s" in short.stderr) == (2, True)
    port = orbitd("demo", "--clock", "sim", "--link", "serial")
    assert (port.returncode, "needs --clock real" in port.stderr) == (2, True)
