"""Figures of the machine: where each comes from, and those that belong together."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from firmware_py import config
from firmware_py.commands import check
from firmware_py.config.checks_machine import MACHINE_CHECKS
from firmware_py.machine import Machine
from tests.first_schema import BENCH

TEXT = (config.SHIPPED / "bench" / "machine.toml").read_text(encoding="utf-8")


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A copy of the shipped bench."""
    return Path(shutil.copytree(config.SHIPPED / "bench", tmp_path / "my_rig"))


def told(rig: Path, *changes: tuple[str, str]) -> dict[str, str]:
    """What is wrong with the machine after ``changes``, by key."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (rig / "machine.toml").write_text(text)
    try:
        config.load(rig)
    except config.ConfigError as error:
        return {fault.key: f"{fault.cause}; {fault.next_step}" for fault in error.faults}
    return {}


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        (
            'assumed = ["windage_W_s3"]',
            'assumed = ["windage"]',
            "rotor.assumed",
            "no figure of this table; name some",
        ),
        (
            'assumed = ["windage_W_s3"]',
            'assumed = ["assumed"]',
            "rotor.assumed",
            "no figure of this table",
        ),
        (
            'assumed = ["windage_W_s3"]',
            'assumed = ["windage_W_s3"]\nmeasured = ["windage_W_s3"]',
            "rotor.measured",
            "assumed as well",
        ),
        (
            'name = "disp_y"',
            'name = "disp_y"\nmeasured = ["gain"]',
            "channel[1].measured",
            "no figure",
        ),
        (
            "[contact]",
            '[contact]\nassumed = ["volt"]',
            "contact.assumed",
            "name some of circuit_V, circuit_ohm",
        ),
        ("groove_width_deg = 20.0", "", "feed.groove_width_deg", "missing beside groove_angle_deg"),
        (
            "pressure_nominal_bar = 1.0",
            "pressure_nominal_bar = 4.0",
            "feed.pressure_nominal_bar",
            "outside 0.5 .. 3, feed.pressure_min_bar .. pressure_max_bar",
        ),
        (
            "zeroed_zero_error = 0.5e-6",
            "zeroed_zero_error = 3e-6",
            "channel[0].zeroed_zero_error",
            "above zero_error (2e-06), which the zero procedure lessens; lower it",
        ),
        (
            "range_low = -200.0",
            "runout_m = 1e-6\nrange_low = -200.0",
            "channel[2].runout_m",
            "a figure of displacement probes, this shows acceleration; remove it",
        ),
        (
            "range_low = -200.0",
            "range_low = 300.0",
            "channel[2].range_low",
            "not below range_high (200)",
        ),
        ("range_low = -200.0", "", "channel[2].range_low", "missing beside the other end"),
        (
            "pump_shut_off_bar = 6.0",
            "",
            "feed.pump_shut_off_bar",
            "missing beside pump_flow_max_m3_s; set it",
        ),
        (
            "pump_flow_max_m3_s = 2.5e-4",
            "pump_flow_max_m3_s = 2e-4",
            "feed.pressure_max_bar",
            "the pump gives 2.66 bar at the film's greatest flow of 8.14e-05 m3/s",
        ),
        (
            "hold_up_s = 8.0",
            "full_film_bar = 0.5",
            "feed.full_film_bar",
            "not below feed.pressure_min_bar (0.5)",
        ),
        (
            "hold_up_s = 8.0",
            "hold_up_s = 6.0",
            "feed.hold_up_s",
            "the film stays full for 2.4 s from the alert at 0.4 bar on",
        ),
        (
            "mass_kg = 6.0",
            "",
            "rotor.effective_mass_at_bearing_kg",
            "missing, and so is mass_kg; set it where",
        ),
        (
            "mass_kg = 6.0",
            "mass_kg = 6.0\neffective_mass_at_bearing_kg = 17.4",
            "rotor.effective_mass_at_bearing_kg",
            "10 times that of the drawing (1.74)",
        ),
    ],
)
def test_a_wrong_figure_is_told(rig: Path, old: str, new: str, key: str, words: str) -> None:
    found = told(rig, (old, new))
    assert list(found) == [key]
    assert words in found[key]


def test_a_fault_of_one_table_hides_none_of_another(rig: Path) -> None:
    found = told(
        rig,
        ("mass_kg = 6.0", 'mass_kg = "6"'),
        ('assumed = ["windage_W_s3"]', "assumed = 3"),
        ("groove_width_deg = 20.0", ""),
        ('assumed = ["thermal_capacity_J_K"]', 'assumed = ["x"]'),
    )
    assert set(found) == {
        "rotor.mass_kg", "rotor.assumed", "feed.groove_width_deg", "lubricant.assumed",
    }  # fmt: skip


def test_the_effective_mass_is_weighed_or_drawn(rig: Path) -> None:
    rotor = config.load(rig)[0].machine.rotor
    assert rotor.effective_mass_at_bearing_kg is None
    assert rotor.mass_at_bearing_kg == 1.74  # to the last bit: what the first schema gave
    assert told(rig, ("mass_kg = 6.0", "mass_kg = 6.0\neffective_mass_at_bearing_kg = 1.8")) == {}
    assert config.load(rig)[0].machine.rotor.mass_at_bearing_kg == 1.8
    old = config.parse(BENCH)[0].machine.rotor
    assert (old.drawn_mass_at_bearing_kg, old.mass_at_bearing_kg) == (None, 1.74)
    with pytest.raises(
        config.ConfigError, match="effective_mass_at_bearing_kg: missing, and so is"
    ):
        config.parse(BENCH.replace("effective_mass_at_bearing_kg = 1.74", ""))


def test_every_figure_that_is_not_drawn_is_told_by_check(
    rig: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(rig.parent))
    assert told(rig, ("angle_deg = 45.0", 'angle_deg = 45.0\nmeasured = ["angle_deg"]')) == {}
    assert check.main([str(rig)]) == 0
    out = capsys.readouterr().out
    assert "  assumed in rotor: windage_W_s3\n" in out
    assert "  measured in channel[0]: angle_deg\n" in out
    assert "default rotor.assumed" not in out


def test_each_table_has_a_check_of_where_its_figures_come_from() -> None:
    tables = [name for name in Machine.__struct_fields__ if name != "name"]
    assert len(MACHINE_CHECKS) == len(tables) + 9
