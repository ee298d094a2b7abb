"""A rig folder is read as one configuration: faults of both files at once, each with its place."""

from __future__ import annotations

import argparse
import re
import shutil
from pathlib import Path

import msgspec
import pytest

from firmware_py import config
from firmware_py.machine import folder

ADDED = (
    "assumed",
    "measured",
    "density_kg_m3",
    "heat_capacity_J_kgK",
    "pressure_nominal_bar",
    "groove_angle_deg",
    "groove_width_deg",
    "groove_length_share",
    "pump_efficiency",
    "jacket_flow_m3_s",
    "full_film_bar",
    "pump_shut_off_bar",
    "pump_flow_max_m3_s",
    "hold_up_s",
    "pump_error_share",
    "pressure_dead_time_s",
    "pressure_time_constant_s",
    "pressure_slew_bar_s",
    "pressure_error_share",
    "effective_mass_at_bearing_kg",
    "mass_kg",
    "diametral_inertia_kg_m2",
    "polar_inertia_kg_m2",
    "coupling_to_cg_m",
    "bearing_to_cg_m",
    "coupling_stiffness_N_m",
    "coupling_damping_N_s_m",
    "backlash_um",
    "position_noise_um",
    "range_low",
    "range_high",
    "noise_rms",
    "bandwidth_hz",
    "gain_error_share",
    "zero_error",
    "runout_m",
    "zeroed_gain_error_share",
    "zeroed_zero_error",
    "zeroed_runout_m",
)
"""Figures that the first schema did not know."""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A copy of the shipped bench."""
    return Path(shutil.copytree(config.SHIPPED / "bench", tmp_path / "my_rig"))


def change(rig: Path, name: str, old: str, new: str) -> int:
    """Replace ``old`` in a file of ``rig``; its line."""
    text = (rig / name).read_text()
    assert old in text
    (rig / name).write_text(text.replace(old, new, 1))
    return text[: text.index(old)].count("\n") + 1


def faults(rig: Path) -> list[config.Fault]:
    with pytest.raises(config.ConfigError) as caught:
        config.load(rig)
    return caught.value.faults


def test_faults_of_both_files_are_told_at_once_each_with_its_file_and_line(rig: Path) -> None:
    lines = {
        "lubricant.film_max_C": change(
            rig, "machine.toml", "film_max_C = 60.0", "film_max_C = nan"
        ),
        "channel[1].angle_deg": change(
            rig, "machine.toml", "angle_deg = 135.0", "angle_deg = 45.0"
        ),
        "limits.min_film_um": change(
            rig, "device.toml", "min_film_um = 10.0", "min_film_um = 31.0"
        ),
        "drive.blind_max_s": change(rig, "device.toml", "blind_max_s = 3.0", "blind_max_s = 0"),
    }
    found = faults(rig)
    assert {fault.key: fault.line for fault in found} == lines
    assert {fault.key: fault.file for fault in found} == {
        "lubricant.film_max_C": "my_rig/machine.toml",
        "channel[1].angle_deg": "my_rig/machine.toml",
        "limits.min_film_um": "my_rig/device.toml",
        "drive.blind_max_s": "my_rig/device.toml",
    }
    text = "\n".join(map(str, found))
    assert "(bearing.radial_clearance_min_um + offset - error)" in text
    assert "machine." not in text.replace("machine.toml", "")


def test_what_is_missing_or_unknown_is_named_in_its_file(rig: Path) -> None:
    change(rig, "machine.toml", "[feed]", "[fed]")
    change(rig, "device.toml", "[limits]", "[limts]")
    told = {(fault.file, fault.key): fault.next_step for fault in faults(rig)}
    assert told == {
        ("my_rig/machine.toml", "fed"): "write feed",
        ("my_rig/device.toml", "limts"): "write limits",
    }


def test_a_table_in_the_other_file_is_unknown_there(rig: Path) -> None:
    (rig / "device.toml").write_text(
        (rig / "device.toml").read_text() + "[bearing]\n[machine.feed]\n"
    )
    (fault,) = faults(rig)
    assert (fault.key, fault.file) == ("machine", "my_rig/device.toml")
    change(rig, "device.toml", "[machine.feed]\n", "")
    (fault,) = faults(rig)
    assert (fault.key, fault.file) == ("bearing", "my_rig/device.toml")
    assert "known are device, limits, limits_at, measure, group, multiply, bus" in fault.next_step


def test_files_that_cannot_be_read_are_named_both(rig: Path) -> None:
    (rig / "machine.toml").unlink()
    (rig / "device.toml").write_text("[device\n")
    first, second = faults(rig)
    assert (first.file, second.file, second.line) == (
        "my_rig/machine.toml", "my_rig/device.toml", 1,
    )  # fmt: skip
    assert "No such file" in first.cause
    assert "not valid TOML" in second.cause


def test_who_the_device_is_needs_its_own_file_alone(rig: Path) -> None:
    good = config.load(rig)[0].device
    (rig / "machine.toml").unlink()
    assert config.read_device(rig) == good
    change(rig, "device.toml", 'rig = "bench"', 'rig = "../bench"')
    with pytest.raises(config.ConfigError, match=r"my_rig/device\.toml:\d+: device\.rig"):
        config.read_device(rig)


def test_a_shipped_name_is_the_shipped_rig_and_anything_else_a_path(
    rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert folder.shipped_names() == ["bench", "kit", "seed"]
    monkeypatch.chdir(rig.parent)
    rig.rename("bench")
    assert folder.find("bench") == config.SHIPPED / "bench"
    assert folder.find("./bench") == Path("bench")
    assert config.load(folder.find("./bench"))[0] == config.load(folder.find("bench"))[0]
    parser = argparse.ArgumentParser()
    folder.add_option(parser, "")
    for option in ("--rig", "--config"):
        assert parser.parse_args([option, "seed"]).rig == config.SHIPPED / "seed"


def test_the_shipped_rigs_say_what_their_old_files_said() -> None:
    old = Path(__file__).parents[1] / "config" / "first_schema"
    for name in folder.simulated_names():
        now, before = config.load(config.SHIPPED / name)[0], config.load(old / f"{name}.toml")[0]
        assert now.machine.rotor.mass_at_bearing_kg == before.machine.rotor.mass_at_bearing_kg
        assert now.replaced(machine=before.machine) == before
        tables = dict(now.machine.tables())
        for key, known in before.machine.tables():
            table = tables[key]
            for figure in ADDED:
                if hasattr(table, figure):
                    table = msgspec.structs.replace(table, **{figure: getattr(known, figure)})
            assert table == known, key


def test_every_line_of_a_shipped_rig_that_is_commented_out_is_a_default(tmp_path: Path) -> None:
    """What a person uncomments changes nothing but what it says."""
    for name in folder.shipped_names():
        rig = Path(shutil.copytree(config.SHIPPED / name, tmp_path / name))
        before = config.load(rig)[0]
        for file in rig.glob("*.toml"):
            text = re.sub(r"(?m)^# (\[\w+\]|\w+ = (?!\?|\[\"tls|\"/etc))", r"\1", file.read_text())
            file.write_text(text)
        assert config.load(rig)[0] == before
