"""The command line: help, wrong input in one line with a next step, and exit codes."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py import __version__, cli
from firmware_py.config import SHIPPED, load
from firmware_py.launch import as_instance
from tests.first_schema import BENCH


def orbitd(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command in this process: starting another one would take longer than any of them."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.main(list(arguments))
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def started(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The same command as a process."""
    return subprocess.run(
        [sys.executable, "-m", "firmware_py", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize("arguments", [("--help",), (), ("fly",)])
def test_a_process_ends_with_what_the_command_returns_and_says(arguments: tuple[str, ...]) -> None:
    process, here = started(*arguments), orbitd(*arguments)
    assert (process.returncode, process.stdout, process.stderr) == (
        here.returncode,
        here.stdout,
        here.stderr,
    )


def test_help_lists_every_registered_command() -> None:
    done = orbitd("--help")
    assert done.returncode == 0
    listed = {line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ")}
    assert listed == {name for name, _ in cli.SUMMARIES}


def test_a_reader_that_has_seen_enough_ends_it_quietly() -> None:
    done = subprocess.run(
        f"{sys.executable} -m firmware_py --help | true",
        shell=True,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stderr == ""


def test_another_instance_has_a_bus_of_its_own_and_the_configured_one_keeps_its_bus() -> None:
    loaded, _ = load(SHIPPED / "bench")
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
    assert (done.returncode, done.stderr) == (
        2,
        "orbitd: no command 'fly'; `orbitd --help` lists them\n",
    )


@pytest.mark.parametrize("command", ["guard", "brain", "gate", "check", "hil", "bus", "run"])
def test_a_wrong_configuration_is_one_line_and_exit_code_2(command: str, tmp_path: Path) -> None:
    text = BENCH.replace("min_film_um", "min_flim_um")
    wrong = tmp_path / "rotor.toml"
    wrong.write_text(text)
    arguments = (
        [str(wrong)]
        if command == "check"
        else ["--rig", str(wrong), "--runtime-dir", str(tmp_path)]
    )
    done = orbitd(command, *arguments)
    assert done.returncode == 2
    assert done.stderr.startswith("orbitd: config error: rotor.toml:")
    assert done.stderr.count("\n") == 1
    assert "limits.min_flim_um = 10.0: unknown key; write min_film_um" in done.stderr


@pytest.mark.parametrize("command", ["status", "arm", "disarm"])
def test_who_speaks_to_a_running_device_needs_its_name_alone(command: str, tmp_path: Path) -> None:
    wrong = tmp_path / "rotor.toml"
    wrong.write_text(BENCH.replace("min_film_um", "min_flim_um"))
    done = orbitd(command, "--rig", str(wrong), "--runtime-dir", str(tmp_path))
    assert done.returncode == 3
    wrong.write_text('[device]\nsite = "lab"\nrig = "../bench"\n')
    done = orbitd(command, "--rig", str(wrong), "--runtime-dir", str(tmp_path))
    assert done.returncode == 2
    assert "rotor.toml:3: device.rig = ../bench: not a name of 1 to 32" in done.stderr


def test_every_fault_is_told_by_every_process_alike(tmp_path: Path) -> None:
    text = BENCH.replace("film_max_C = 60.0", "film_max_C = nan")
    text = text.replace("load_max_N = 300.0", "load_max_N = 20.0").replace(
        "angle_deg = 135.0", "angle_deg = 45.0"
    )
    wrong = tmp_path / "rotor.toml"
    wrong.write_text(text)
    options = ["--rig", str(wrong), "--runtime-dir", str(tmp_path)]
    told = {command: orbitd(command, *options).stderr for command in ("guard", "brain", "gate")}
    told["check"] = orbitd("check", str(wrong)).stderr
    assert len(set(told.values())) == 1
    keys = [line.split(": ")[-2].split(" = ")[0] for line in told["check"].splitlines()]
    assert keys == ["oil.film_max_C", "operating.load_max_N", "channel[1].angle_deg"]
    done = orbitd("check", str(wrong), "--json")
    faults = json.loads(done.stdout)["faults"]
    assert (done.returncode, [fault["key"] for fault in faults]) == (2, keys)
    assert faults[0] == {
        "file": "rotor.toml",
        "line": 38,
        "key": "oil.film_max_C",
        "value": "nan",
        "cause": "not finite, allowed are -40 .. 200",
        "next_step": "give a number",
        "least": -40.0,
        "greatest": 200.0,
    }


@pytest.mark.parametrize("name", ["../evil", "", "a/b", "A", "-x", "a" * 33, "a\n"])
def test_an_instance_name_is_a_name(name: str) -> None:
    done = orbitd("status", f"--instance={name}")
    assert done.returncode == 2
    assert "is not a name" in done.stderr


@pytest.mark.parametrize(
    ("command", "extra"), [("status", ()), ("arm", ()), ("set", ("clearance", "60"))]
)
def test_a_device_that_is_not_there_is_exit_code_3(
    command: str, extra: tuple[str, ...], tmp_path: Path
) -> None:
    done = orbitd(command, *extra, "--runtime-dir", str(tmp_path))
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1


def test_check_accepts_the_shipped_configuration_and_its_models() -> None:
    done = orbitd("check", "bench")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "admissible over the whole declared range" in done.stdout
    assert [line.split()[1] for line in done.stdout.splitlines() if line.startswith("  model")] == [
        "classifier", "actor", "surrogate",
    ]  # fmt: skip


def test_check_names_the_models_that_do_not_fit_a_rig() -> None:
    done = orbitd("check", "seed")
    assert done.returncode == 0
    assert "monitor only: feed_port: 4 orifices" in done.stdout
    assert "REFUSED classifier" in done.stdout
    assert "bench" in done.stdout


def test_demo_refuses_what_it_cannot_play() -> None:
    short = orbitd("demo", "--seconds", "5")
    assert (short.returncode, "shorter than 20 s" in short.stderr) == (2, True)
    port = orbitd("demo", "--clock", "sim", "--link", "serial")
    assert (port.returncode, "needs --clock real" in port.stderr) == (2, True)
