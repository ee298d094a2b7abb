"""A file of the first schema stays good, and its faults are told in its own words."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest

from firmware_py import config
from firmware_py.commands import migrate
from firmware_py.config.written import FolderError
from firmware_py.machine.migrate import MOVED, first_key, upgrade
from tests.first_schema import BENCH, BENCH_FILE, SEED_FILE


def faults(text: str) -> dict[str, config.Fault]:
    """What is wrong with ``text``, by the key of the file."""
    try:
        config.parse(text, Path("rotor.toml"))
    except config.ConfigError as error:
        return {fault.key: fault for fault in error.faults}
    return {}


def first(good: config.Config) -> dict[str, Any]:
    """``good`` as a recording of the first schema carries it."""
    table = msgspec.to_builtins(good)
    machine = table.pop("machine")
    return table | {old: machine[new] for old, new in MOVED.items()}


@pytest.mark.parametrize("name", ["bench", "seed"])
def test_a_configuration_recorded_under_the_first_schema_is_read(name: str) -> None:
    good = config.load(config.SHIPPED / name)[0]
    old = msgspec.json.encode(first(good))
    assert b'"machine"' not in old
    assert config.decode(old, Path("old.mcap")) == good
    assert config.decode(msgspec.json.encode(good), Path("new.mcap")) == good


def test_the_machine_is_called_as_the_rig() -> None:
    assert upgrade({"device": {"rig": "press-3"}})["machine"]["name"] == "press-3"
    for device in ({}, {"rig": 3}, {"rig": "../x"}, 1, None):
        assert upgrade({"device": device})["machine"]["name"] == "unnamed"


@pytest.mark.parametrize(("old", "new", "key", "step"), [
    ("[bearing]", "[bearng]", "bearng", "write bearing"),
    ("[operating]", "[operatng]", "operatng", "write operating"),
    ("[limits]", "[limts]", "limts", "write limits"),
    ("[oil]", "[lubricant]", "lubricant", "known are device, bearing, oil, feed, rotor,"),
    ("film_max_C = 60.0", "film_maxC = 60.0", "oil.film_maxC", "write film_max_C"),
])  # fmt: skip
def test_a_wrong_name_is_told_with_the_right_one_of_that_file(
    old: str, new: str, key: str, step: str
) -> None:
    found = faults(BENCH.replace(old, new, 1))[key]
    assert found.line == BENCH[: BENCH.index(old)].count("\n") + 1
    assert step in found.next_step


def test_no_fault_of_an_old_file_speaks_of_what_it_does_not_know() -> None:
    changed = BENCH.replace("film_max_C = 60.0", "film_max_C = 41.0")
    changed = changed.replace("min_film_um = 10.0", "min_film_um = 31.0")
    changed = changed.replace("[feed]\npressure_min_bar = 0.5\npressure_max_bar = 3.0", "feed = 3")
    changed = changed.replace("rate_um_s = 50.0", "rate_um_s = 10.0")
    found = faults(changed.replace("speed_min_rpm = 1500.0\n", ""))
    assert {"oil.film_max_C", "limits.min_film_um", "actuator.rate_um_s"} <= set(found)
    assert "operating.speed_min_rpm" in found
    assert not [str(fault) for fault in found.values() if "machine." in str(fault)]
    assert not [str(fault) for fault in found.values() if "lubricant" in str(fault)]


def test_keys_are_called_as_in_the_file() -> None:
    assert first_key("machine.lubricant.film_max_C") == "oil.film_max_C"
    assert first_key("machine.channel[2].scale") == "channel[2].scale"
    assert first_key("machine.contact") == "contact"
    assert first_key("limits.min_film_um") == "limits.min_film_um"


# ---------------------------------------------------------------------- orbitd migrate


ODD = """# A press in the yard.

device = { site = "lab", rig = "press-3" }   # who
zenoh.listen = []

# of the drawing
[bearing]
journal_radius_m = 0.02 # measured "twice"
"""


def odd_file(folder: Path) -> Path:
    """A file with inline tables, dotted keys and remarks in every place."""
    text = BENCH.replace('[device]\nsite = "lab"\nrig = "bench"\nmode_at_start = "monitor"\n', "")
    head, rest = text.split("[bearing]\njournal_radius_m = 0.02\n")
    path = folder / "old.toml"
    path.write_text(ODD + rest + "\n# the end\n" + head.partition("changed copy.\n")[2])
    return path


def test_a_migrated_folder_is_the_same_configuration(tmp_path: Path) -> None:
    for old in (BENCH_FILE, SEED_FILE, odd_file(tmp_path)):
        folder = tmp_path / old.stem
        assert migrate.main([str(old), str(folder)]) == 0
        assert config.load(folder)[0] == config.load(old)[0]
        assert sorted(path.name for path in folder.iterdir()) == ["device.toml", "machine.toml"]


def test_every_remark_is_kept_and_every_default_shown(tmp_path: Path) -> None:
    for old in (BENCH_FILE, SEED_FILE, odd_file(tmp_path)):
        texts = migrate.migrated(old)
        kept = "\n".join(texts.values())
        for line in old.read_text().splitlines():
            remark = line[line.rfind("#") :] if "#" in line else ""
            assert remark.strip() in kept, remark
    for key in ("groove_area_max_mm2 = 0.0", "hysteresis_share = 0.05", "serial_baud = 3000000"):
        assert f"\n# {key}\n" in kept
    assert "# of the drawing\n[bearing]\n" in texts["machine.toml"]
    assert 'journal_radius_m = 0.02  # measured "twice"\n' in texts["machine.toml"]
    assert texts["machine.toml"].count("following_error_um") == 1


def test_what_is_there_is_never_written_over(tmp_path: Path) -> None:
    there = tmp_path / "there"
    for made in (there.mkdir, there.touch, lambda: there.symlink_to("nowhere")):
        made()
        with pytest.raises(FolderError, match="is there already"):
            migrate.main([str(BENCH_FILE), str(there)])
        there.rmdir() if there.is_dir() else there.unlink()
    with pytest.raises(FolderError, match="name a folder that this user may make"):
        migrate.main([str(BENCH_FILE), str(tmp_path / "no" / "folder")])
    with pytest.raises(FolderError, match="is a folder, not a file of the first schema"):
        migrate.main([str(config.SHIPPED / "bench"), str(there)])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_there_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(BENCH.replace("film_max_C = 60.0", "film_max_C = nan"))
    with pytest.raises(config.ConfigError, match=r"wrong\.toml:38: oil\.film_max_C"):
        migrate.main([str(wrong), str(tmp_path / "rig")])

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FolderError, match="No space left on device"):
        migrate.main([str(BENCH_FILE), str(tmp_path / "rig")])
    assert list(tmp_path.iterdir()) == [wrong]


def test_a_key_that_is_known_no_more_is_left_out_of_folders_and_recordings(tmp_path: Path) -> None:
    """It moved nothing; a rig folder and a recording that still have it stay good."""
    rig = Path(shutil.copytree(config.SHIPPED / "bench", tmp_path / "bench"))
    before = config.load(rig)[0]
    text = (rig / "machine.toml").read_text()
    (rig / "machine.toml").write_text(
        text.replace("[bearing]\n", "[bearing]\ncone_half_angle_deg = 7.0\n")
    )
    assert config.load(rig)[0] == before
    recorded = msgspec.json.decode(msgspec.json.encode(before))
    recorded["machine"]["bearing"]["cone_half_angle_deg"] = 7.0
    assert config.decode(msgspec.json.encode(recorded), Path("recording")) == before
