"""``orbitd models`` on files: what it says and changes, and what the brain then starts with."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from firmware_py import cli, config, launch
from firmware_py.brain.library import ShelfLibrary
from firmware_py.brain.store import Models
from tests.brain.onnx_models import actor, classifier

BENCH = config.load(config.SHIPPED / "bench")[0]


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setattr(launch, "SERVICE_RUNTIME", tmp_path / "no_service")
    return tmp_path / "state"


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "policy"
    path.mkdir()
    (path / "actor.onnx").write_bytes(actor(7e-5))
    return path


def in_use() -> Models:
    """What the brain would start with."""
    folder = launch.shelf_folder(BENCH, launch.state_dir(BENCH, os.environ))
    return ShelfLibrary(BENCH, folder).in_use().models


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    assert cli.main(["models", *arguments, "--rig", "bench", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_whole_way_and_back(
    capsys: pytest.CaptureFixture[str], source: Path, state: Path
) -> None:
    first = said(capsys, "list")
    assert first["sets"] == []
    assert [text.rpartition(", ")[2] for text in first["in_use"]] == ["the package"] * 3
    assert not state.exists()  # looking makes nothing
    added = said(capsys, "add", str(source))["set"]
    assert said(capsys, "list")["sets"][0]["files"] == "actor.onnx"
    assert said(capsys, "shadow", "policy")["pointer"]["shadow"] == added
    both = said(capsys, "compare")
    assert (both["beside"], both["role"], both["agreement"]) == ([added], "shadow", None)
    pointer = said(capsys, "promote", "policy")["pointer"]
    assert (pointer["active"], pointer["former"]) == ([added], [])
    models = in_use()
    assert models.refusals == {}
    assert models.actor is not None
    assert models.actor.vouched_by == "unsigned"
    listed = said(capsys, "list")
    assert sum("unsigned" in text for text in listed["in_use"]) == 1
    assert said(capsys, "rollback")["pointer"]["active"] == []
    again = in_use().actor
    assert again is not None
    assert again.vouched_by == "the package"


def test_for_people(capsys: pytest.CaptureFixture[str], source: Path) -> None:
    for arguments in (("add", str(source), "--name", "new"), ("shadow", "new"), ("list",)):
        assert cli.main(["models", *arguments, "--rig", "bench"]) == 0
    text = capsys.readouterr()
    assert "on shelf" in text.out
    assert "new: actor.onnx" in text.out
    assert "it holds from the next start" in text.out
    assert cli.main(["models", "promote", "no", "--rig", "bench"]) == 1
    assert "no set 'no' on the shelf" in capsys.readouterr().err
    assert cli.main(["models", "shadow", "none", "--rig", "bench"]) == 0
    assert cli.main(["models", "promote", "new", "--rig", "bench"]) == 1
    assert "is not in shadow (nothing is)" in capsys.readouterr().err
    assert cli.main(["models", "rollback", "--rig", "bench"]) == 1
    assert "nothing was promoted" in capsys.readouterr().err


def test_a_bad_set_is_named_and_nothing_is_added(
    capsys: pytest.CaptureFixture[str], source: Path
) -> None:
    (source / "actor.onnx").write_bytes(actor(float("nan")))
    (source / "classifier.onnx").write_bytes(classifier(physics_version="9"))
    assert cli.main(["models", "add", str(source), "--rig", "bench"]) == 1
    text = capsys.readouterr().err
    assert "is not finite" in text
    assert "physics_version '9'" in text
    assert said(capsys, "list")["sets"] == []


def test_a_set_that_has_gone_withholds_the_advice(
    capsys: pytest.CaptureFixture[str], source: Path, state: Path
) -> None:
    added = said(capsys, "add", str(source))["set"]
    said(capsys, "shadow", "policy")
    said(capsys, "promote")
    folder = Path(said(capsys, "list")["sets"][0]["folder"])
    assert folder.name == added
    folder.rename(state / "away")
    models = in_use()
    assert models.classifier is not None  # the device's own diagnose on
    assert "is not in" in models.refusals["set"]
    listed = said(capsys, "list")
    assert "add it again" in listed["trouble"][0]


def test_a_rig_folder_brings_its_own_models(tmp_path: Path, source: Path) -> None:
    assert cli.main(["rig", "new", str(tmp_path / "rig"), "--from", "bench"]) == 0
    loaded = config.load(tmp_path / "rig")[0]
    assert loaded.models.directory == ""
    source.rename(tmp_path / "rig" / "models")
    assert config.load(tmp_path / "rig")[0].models.directory == ""  # no manifest: no set
    assert cli.main(["models", "list", "--rig", str(tmp_path / "rig")]) == 0
    (tmp_path / "rig" / "models" / "manifest.json").write_text('{"schema": 1, "files": {}}')
    found = config.load(tmp_path / "rig")[0].models.directory
    assert found == str((tmp_path / "rig" / "models").resolve())
