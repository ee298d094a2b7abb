"""What a rig folder leaves out is off by name, and makes the machine monitor only."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import msgspec
import pytest

from firmware_py import config
from firmware_py.brain.store import load_models
from firmware_py.commands import check
from firmware_py.config.bearings import views
from firmware_py.machine import parts

LEAST = """
name = "least"

[operating]
speed_min_rpm = 600.0
speed_max_rpm = 6000.0
speed_ramp_max_rpm_s = 1000.0
""" + "".join(
    f"""
[[channel]]
name = "{name}"
unit = "m"
scale = 1e-8
ok_low = -245e-6
ok_high = 245e-6
angle_deg = {angle}
"""
    for name, angle in (("disp_x", 45), ("disp_y", 135))
)
DEVICE = """
[device]
site = "lab"
rig = "least"

[limits]
displacement_alert_um = 60.0
displacement_danger_um = 90.0

[bus]
schema = 2

[sampling]
rate_hz = 2000
frames_per_block = 2
"""
TABLES = ("actuator", "feed", "lubricant", "rotor")


@pytest.fixture
def least(tmp_path: Path) -> Path:
    folder = tmp_path / "least"
    folder.mkdir()
    (folder / "machine.toml").write_text(LEAST)
    (folder / "device.toml").write_text(DEVICE)
    return folder


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return Path(shutil.copytree(config.SHIPPED / "bench", tmp_path / "my_rig"))


def without(folder: Path, table: str) -> None:
    """Take ``[table]`` out of ``machine.toml``."""
    path = folder / "machine.toml"
    text, cut = re.subn(rf"(?ms)^\[{table}\].*?(?=^\[)", "", path.read_text())
    assert cut == 1
    path.write_text(text)


def test_two_probes_and_a_mark_at_2_kHz_are_enough(least: Path) -> None:
    loaded, _ = config.load(least)
    machine = loaded.machine
    assert set(machine.absent) == {part.name for part in parts.PARTS} | {parts.READINGS}
    assert len(parts.monitor_only(machine)) == len(TABLES)
    assert not parts.has_film_law(machine)
    assert loaded.limits.clearance_share == 1.0
    assert config.decode(msgspec.json.encode(loaded), Path("x.mcap")) == loaded


def test_a_whole_machine_lacks_nothing() -> None:
    machine = config.load(config.SHIPPED / "bench")[0].machine
    assert machine.absent == ()
    assert parts.monitor_only(machine) == ()
    assert parts.absences(machine) == []
    assert parts.has_film_law(machine)


@pytest.mark.parametrize("table", TABLES)
def test_each_table_may_be_left_out_and_is_named(
    bench: Path, table: str, capsys: pytest.CaptureFixture[str]
) -> None:
    without(bench, table)
    assert check.main([str(bench)]) == 0
    said = capsys.readouterr().out
    assert f"monitor only: no [{table}]" in said
    assert f"absent [{table}]: off is" in said
    assert "safe radial clearance" not in said
    assert f"default {table}." not in said
    assert "off actor: monitor only" in said


def test_a_fixed_clearance_is_that_of_the_drawing() -> None:
    machine = config.load(config.SHIPPED / "kit")[0].machine
    b = machine.bearing
    assert parts.has(machine, parts.CLEARANCE)
    assert b.radial_clearance_min_um == b.radial_clearance_max_um == 190.0
    assert machine.actuator.safe_radial_clearance_um == 190.0
    assert [other.name for other in machine.other_bearing] == ["nde"]


def test_a_misspelt_table_is_a_fault_and_no_absence(bench: Path) -> None:
    path = bench / "machine.toml"
    path.write_text(path.read_text().replace("[actuator]", "[actuatr]"))
    with pytest.raises(config.ConfigError, match=r"actuatr: unknown key; write actuator"):
        config.load(bench)


def test_with_an_actuator_single_keys_stay_needed(bench: Path) -> None:
    path = bench / "machine.toml"
    path.write_text(
        re.sub(r"(?m)^(load_m\w+_N|radial_clearance_m\w+_um) =.*\n", "", path.read_text())
    )
    with pytest.raises(config.ConfigError) as refusal:
        config.load(bench)
    missing = {fault.key for fault in refusal.value.faults if "missing" in fault.cause}
    assert missing == {
        "operating.load_min_N", "operating.load_max_N",
        "bearing.radial_clearance_min_um", "bearing.radial_clearance_max_um",
    }  # fmt: skip


def test_a_stand_in_is_held_against_nothing(bench: Path) -> None:
    """What compares a stand-in is left out: the clearance of the drawing alone counts."""
    without(bench, "lubricant")
    device = bench / "device.toml"
    device.write_text(re.sub(r"(?m)^oil_outlet.*\n", "", device.read_text()))
    loaded, _ = config.load(bench)
    assert parts.LUBRICANT in loaded.machine.absent


def test_what_is_monitor_only_starts_as_that(least: Path) -> None:
    device = least / "device.toml"
    device.write_text(DEVICE.replace('rig = "least"', 'rig = "least"\nmode_at_start = "auto"'))
    with pytest.raises(config.ConfigError, match=r'monitor only: no \[actuator\].*write "monitor"'):
        config.load(least)


def test_absent_is_found_and_never_written(least: Path) -> None:
    (least / "machine.toml").write_text('absent = ["feed"]\n' + LEAST)
    with pytest.raises(config.ConfigError, match=r"absent.*found by what the file leaves out"):
        config.load(least)


def test_the_shipped_classifier_is_refused_by_values(least: Path) -> None:
    models = load_models(config.load(least)[0])
    assert set(models.off) == {"actor", "surrogate"}
    reason = models.refusals["classifier"]
    assert "bearing.journal_radius_m 0.02, here absent" in reason
    assert "channel.microphone sound_pressure, Pa, 0 deg, here absent" in reason


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'bearing = "nde"\nunit',
            'bearing = "dne"\nunit',
            "no bearing of that name, there are: de, nde",
        ),
        ('name = "nde"', 'name = "de"', "named twice; give each bearing"),
        ('name = "nde"', "", "missing: channels say by it where they sit"),
        ('name = "disp_x"\nbearing = "de"', 'name = "disp_x"\nbearing = "nde"', "put them first"),
        (
            "angle_deg = 135.0\nrange_low = -250e-6\nrange_high = 250e-6\nwords",
            "angle_deg = 50.0\nrange_low = -250e-6\nrange_high = 250e-6\nwords",
            "degrees from that of",
        ),
        ('name = "nde"', 'load_min_N = 3.0\nname = "nde"', "missing beside the other end"),
        ('name = "nde"', 'load_min_N = 3.0\nload_max_N = 1.0\nname = "nde"', "above load_max_N"),
    ],
)
def test_faults_of_several_bearings_are_named(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    rig = Path(shutil.copytree(config.SHIPPED / "kit", tmp_path / "kit"))
    path = rig / "machine.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(config.ConfigError, match=re.escape(words)):
        config.load(rig)


def kit_with(tmp_path: Path, *changes: tuple[str, str, str]) -> Path:
    """A copy of the kit with ``changes``: file, old, new."""
    rig = Path(shutil.copytree(config.SHIPPED / "kit", tmp_path / "kit"))
    for file, old, new in changes:
        text = (rig / file).read_text()
        assert old in text
        (rig / file).write_text(text.replace(old, new, 1))
    return rig


def test_a_further_bearing_has_loads_and_limits_of_its_own(tmp_path: Path) -> None:
    loads = 'load_min_N = 3.0\nload_max_N = 7.0\nname = "nde"'
    tighter = "displacement_alert_um = 30.0\ndisplacement_danger_um = 50.0"
    rig = kit_with(
        tmp_path,
        ("machine.toml", 'name = "nde"', loads),
        (
            "device.toml",
            'bearing = "nde"\ndisplacement_alert_um = 75.0\ndisplacement_danger_um = 120.0',
            f'bearing = "nde"\n{tighter}',
        ),
    )
    first, second = views(config.load(rig)[0])
    assert first.config.limits.displacement_danger_um == 120.0
    assert second.config.limits.displacement_danger_um == 50.0
    assert second.config.machine.operating.load_max_N == 7.0
    assert parts.LOAD in first.config.machine.absent
    assert parts.LOAD not in second.config.machine.absent
    _, alike = views(config.load(rig)[0].replaced(limits_at=[]))
    assert alike.config.limits.displacement_danger_um == 120.0


def test_a_further_bearing_of_which_nothing_is_known_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = "nde_" + 28 * "x"
    rig = kit_with(tmp_path)
    path, device = rig / "machine.toml", rig / "device.toml"
    text = path.read_text().replace('"nde"', f'"{name}"')
    path.write_text(
        re.sub(r"(?ms)(^\[\[other_bearing\]\]\nname = [^\n]*\n).*?(?=^\[)", r"\1\n", text)
    )
    device.write_text(device.read_text().replace('"nde"', f'"{name}"'))
    assert check.main([str(rig)]) == 0
    said = capsys.readouterr().out
    assert f"absent clearance of bearing {name}" in said
    assert f"absent bearing of bearing {name}" in said


@pytest.mark.parametrize(("change", "words"), [
    (("machine.toml", 'name = "nde"  # non-drive end', "name = 3"), "not text"),
    (("device.toml", 'bearing = "nde"\ndisplacement_alert_um = 75.0',
      'bearing = "nde"\ndisplacement_alert_um = 150.0'),
     "limits_at[0].displacement_alert_um = 150.0: not below displacement_danger_um"),
    (("device.toml", '[[limits_at]]\nbearing = "nde"', '[[limits_at]]\nbearing = "x"'),
     "no further bearing of that name"),
    (("machine.toml", 'name = "disp_x"', "name = 5"), "not text"),
    (("device.toml", "[limits]", "[[limits]]"), "not a table"),
])  # fmt: skip
def test_what_is_wrong_beside_what_is_absent_is_named(
    tmp_path: Path, change: tuple[str, str, str], words: str
) -> None:
    with pytest.raises(config.ConfigError) as refusal:
        config.load(kit_with(tmp_path, change))
    assert words in str(refusal.value)


def test_a_list_of_bearings_that_is_none_is_a_fault() -> None:
    assert parts.completed({"other_bearing": 3})["other_bearing"] == 3
    assert parts.completed({"bearing": 3})["bearing"] == 3
    assert parts.stand_in_keys(None) == frozenset()
