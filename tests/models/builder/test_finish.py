"""A set is moved in whole: what stands in the folder is the old one or the new one."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import pytest

from firmware_py.machine.folder import own_set
from models.builder.finish import PART, exchange, move_in

OLD = {"actor.onnx": b"old", "report.html": b"old"}
NEW = {"classifier.onnx": b"new", "predictor.json": b"{}", "report.html": b"new"}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_first_set_and_its_successor(tmp_path: Path) -> None:
    assert move_in(tmp_path, OLD) == tmp_path / "models"
    assert own_set(tmp_path) == tmp_path / "models"
    move_in(tmp_path, NEW)
    assert names(tmp_path) == ["models"]
    assert names(tmp_path / "models") == sorted([*NEW, "manifest.json"])
    manifest = json.loads((tmp_path / "models" / "manifest.json").read_text())
    assert sorted(manifest["files"]) == ["classifier.onnx", "predictor.json"]


def test_what_an_interrupted_build_left_is_cleared(tmp_path: Path) -> None:
    (tmp_path / PART).mkdir()
    (tmp_path / PART / "actor.onnx").write_bytes(b"half")
    move_in(tmp_path, NEW)
    assert names(tmp_path) == ["models"]
    assert "actor.onnx" not in names(tmp_path / "models")


STEPS = ("os.rename", "os.mkdir", "os.rmdir", "os.remove", "open")


def killed_at(step: int, rig: Path) -> bool:
    """Whether a process that moves a new set in was killed at its ``step``-th change of the file
    system."""
    child = os.fork()
    if child == 0:
        left = [step]

        def hook(event: str, arguments: tuple[object, ...]) -> None:
            if event in STEPS and (event != "open" or PART in str(arguments[0])):
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        move_in(rig, NEW)
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def test_a_kill_at_any_step_leaves_one_whole_set(tmp_path: Path) -> None:
    killed = 0
    for step in range(1, 40):
        rig = tmp_path / str(step)
        rig.mkdir()
        move_in(rig, OLD)
        ended = not killed_at(step, rig)
        found = names(rig / "models")
        assert found in (sorted([*OLD, "manifest.json"]), sorted([*NEW, "manifest.json"]))
        said = (rig / "models" / "report.html").read_bytes()
        assert said == (b"old" if "actor.onnx" in found else b"new")
        if ended:
            break
        killed += 1
        move_in(rig, NEW)
        assert names(rig) == ["models"]
    assert ended
    assert killed >= 5


def test_an_exchange_swaps_two_folders(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).write_text(name)
    exchange(tmp_path / "a", tmp_path / "b")
    assert (names(tmp_path / "a"), names(tmp_path / "b")) == (["b"], ["a"])


def test_a_folder_that_cannot_be_written_keeps_its_set(tmp_path: Path) -> None:
    move_in(tmp_path, OLD)
    (tmp_path / PART).write_text("a file stands in the way")
    with pytest.raises(OSError, match=PART):
        move_in(tmp_path, NEW)
    assert (tmp_path / "models" / "report.html").read_bytes() == b"old"
    assert os.path.isfile(tmp_path / PART)
