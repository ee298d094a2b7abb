"""``orbitd rig new``: a folder that is good, whole, commented, and as well known as a lab can."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import msgspec
import pytest

from firmware_py import cli, launch
from firmware_py.commands import check, rig
from firmware_py.config.simulation import load_simulation
from firmware_py.machine import schema
from firmware_py.machine.folder import find, shipped_names
from firmware_py.machine.probes import TYPICAL, error_of
from firmware_py.machine.texts import texts_of

FILES = {"machine.toml", "device.toml", "simulation.toml"}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))


def new(folder: Path, *options: str) -> Path:
    assert rig.main(["new", str(folder), *options]) == 0
    return folder


@pytest.mark.parametrize("source", shipped_names())
def test_a_new_rig_is_that_of_its_source_but_for_what_nobody_knows_so_well(
    tmp_path: Path, source: str
) -> None:
    folder = new(tmp_path / "my_rig", "--from", source)
    names = {path.name for path in find(source).iterdir() if path.suffix == ".toml"}
    assert {path.name for path in folder.iterdir()} == names
    assert check.main([str(folder)]) in (0, 1)  # 1: a model of another machine is not used
    made, given = launch.verified(folder)[0], launch.verified(find(source))[0]
    assert (made.machine.name, made.device.rig) == ("my_rig", "my_rig")
    assert made.device.mode_at_start == "monitor"
    assert made.machine.absent == given.machine.absent
    bearing = made.machine.bearing
    assert bearing.radial_clearance_error_um == 5.0  # a dial, and 10 K across the housing
    assert bearing.load_error_share == 0.21
    assert made.machine.lubricant.viscosity_error_share == 0.1
    assert made.machine.rotor.shaft_power_error_W == 5.0
    probe = made.machine.channel[0]
    assert error_of(probe, "gain_error_share") == TYPICAL.gain_error_share
    assert error_of(probe, "runout_m") == TYPICAL.runout_m
    for name, table in made.machine.tables():
        before = dict(given.machine.tables())[name]
        differs = {
            key
            for key, value in msgspec.structs.asdict(table).items()
            if value != getattr(before, key)
        }
        assert all("_error_" in key for key in differs), (name, differs)
    simulated, theirs = load_simulation(folder), load_simulation(find(source))
    assert simulated.foundation == theirs.foundation
    assert simulated.forces == theirs.forces
    assert (simulated.drive.start_load_N, simulated.spread.runout_max_um) == (None, None)
    assert simulated.duty == []


def test_a_copy_of_a_folder_keeps_every_figure_and_says_what_each_means(tmp_path: Path) -> None:
    first = new(tmp_path / "one")
    text = (first / "machine.toml").read_text()
    changed = text.replace("radial_clearance_error_um = 5.0", "radial_clearance_error_um = 0.7")
    assert changed != text
    (first / "machine.toml").write_text(changed.replace("# measured", "# measured"))
    second = new(tmp_path / "two", "--from", str(first))
    read = [launch.verified(folder)[0] for folder in (first, second)]
    assert read[1] == read[0].replaced(
        machine=msgspec.structs.replace(read[0].machine, name="two"),
        device=msgspec.structs.replace(read[0].device, rig="two"),
    )
    said = " ".join((second / "machine.toml").read_text().replace("\n#", "").split())
    assert texts_of(schema.JournalBearing)["length_m"] + " (m, 0.001 .. 1)" in said


def test_every_key_of_the_schema_stands_there_to_be_edited(tmp_path: Path) -> None:
    folder = new(tmp_path / "whole")
    lines = {
        line.removeprefix("# ").partition(" = ")[0]
        for name in FILES
        for line in (folder / name).read_text().splitlines()
    }
    for cls in (schema.JournalBearing, schema.RotorDrawing, schema.ContactCircuit):
        assert {key for key in cls.__struct_fields__ if key not in ("assumed", "measured")} <= lines
    for name in FILES:
        text = (folder / name).read_text()
        remarks = [line for line in text.splitlines() if line.startswith("#")]
        assert max(map(len, remarks)) <= 100
        tomllib.loads(text)


def test_what_is_there_stays_and_nothing_is_left_half(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = new(tmp_path / "mine")
    before = {path.name: path.read_text() for path in folder.iterdir()}
    assert cli.main(["rig", "new", str(folder)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert {path.name: path.read_text() for path in folder.iterdir()} == before
    assert cli.main(["rig", "new", str(tmp_path / "My Rig")]) == 2
    assert "--name" in capsys.readouterr().err
    assert cli.main(["rig", "new", str(tmp_path / "My Rig"), "--name", "my_rig"]) == 0
    assert cli.main(["rig", "new", str(tmp_path / "no" / "where")]) == 2
    assert cli.main(["rig", "new", str(tmp_path / "x"), "--from", str(tmp_path / "absent")]) == 2

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert cli.main(["rig", "new", str(tmp_path / "full")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"mine", "My Rig"}


def test_a_simulator_that_would_run_another_machine_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = new(tmp_path / "my_rig")
    capsys.readouterr()
    assert check.main([str(folder)]) == 0
    assert "simulation.toml" not in capsys.readouterr().out
    (folder / "simulation.toml").write_text(
        "[drive]\nstart_load_N = 500.0\n[spread]\nrunout_max_um = 20.0\n"
        "[[duty]]\nspeed_rpm = 40000.0\nload_N = 50.0\nseconds = 0.0\n"
    )
    assert check.main([str(folder)]) == 0
    out = capsys.readouterr().out
    assert "drive.start_load_N = 500 N is outside what the machine is declared for" in out
    assert "duty.speed_rpm = 40000 rpm is outside" in out
    assert "20 um gives probes 12 um of the first order, declared are 6" in out
    assert check.main(["bench"]) == 0
    assert "simulation.toml" not in capsys.readouterr().out
