"""A rig folder's own models are found, travel with it, and never stand for those that are named."""

from __future__ import annotations

import shutil
from pathlib import Path

from firmware_py.commands.rig_new import texts_for
from firmware_py.config import SHIPPED, load
from firmware_py.config.written import write_rig

TEXTS = {path.name: path.read_text() for path in (SHIPPED / "bench").glob("*.toml")}


def with_set(folder: Path) -> Path:
    write_rig(TEXTS, folder)
    (folder / "models").mkdir()
    (folder / "models" / "manifest.json").write_text("{}")
    return folder


def test_only_a_whole_set_is_found(tmp_path: Path) -> None:
    rig = with_set(tmp_path / "rig")
    assert load(rig)[0].models.directory == str(rig / "models")
    (rig / "models" / "manifest.json").unlink()
    assert load(rig)[0].models.directory == ""


def test_a_named_directory_comes_first(tmp_path: Path) -> None:
    rig = with_set(tmp_path / "rig")
    key = "MCowBQYDK2VwAyEA" + "A" * 43 + "="
    with (rig / "device.toml").open("a") as file:
        file.write(f'\n[models]\ndirectory = "/srv/models"\npublic_keys = ["{key}"]\n')
    models = load(rig)[0].models
    assert models.directory == "/srv/models"


def test_it_goes_where_the_folder_goes(tmp_path: Path) -> None:
    rig = with_set(tmp_path / "rig")
    shutil.move(rig, tmp_path / "moved")
    assert load(tmp_path / "moved")[0].models.directory == str(tmp_path / "moved" / "models")
    write_rig(TEXTS, tmp_path / "copy", tmp_path / "moved" / "models")
    assert load(tmp_path / "copy")[0].models.directory == str(tmp_path / "copy" / "models")


def test_a_rig_made_of_another_takes_no_models_with_it(tmp_path: Path) -> None:
    rig = with_set(tmp_path / "rig")
    write_rig(texts_for(str(rig), "mill"), tmp_path / "mill")
    assert load(tmp_path / "mill")[0].models.directory == ""
