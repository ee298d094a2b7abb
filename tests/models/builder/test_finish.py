"""A set is moved in whole: what stands in the folder is the old one or the new one."""

from __future__ import annotations

import json
import os
import signal
import subprocess
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


def test_a_kill_at_any_step_leaves_one_whole_set(tmp_path: Path) -> None:
    """Killed at each call that changes the file system, one after the other."""
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from models.builder import finish\n"
        "left = [int(sys.argv[2])]\n"
        "def hook(event, arguments):\n"
        "    if event in ('os.rename', 'os.mkdir', 'os.rmdir', 'os.remove', 'open'):\n"
        "        if event == 'open' and '.models.part' not in str(arguments[0]): return\n"
        "        left[0] -= 1\n"
        "        if left[0] == 0: os.kill(os.getpid(), signal.SIGKILL)\n"
        "sys.addaudithook(hook)\n"
        "finish.move_in(Path(sys.argv[1]), {'classifier.onnx': b'new', 'report.html': b'new'})\n"
    )
    killed = 0
    for step in range(1, 40):
        rig = tmp_path / str(step)
        rig.mkdir()
        move_in(rig, OLD)
        ended = subprocess.run([sys.executable, "-c", code, str(rig), str(step)], check=False)
        found = names(rig / "models")
        assert found in (
            ["actor.onnx", "manifest.json", "report.html"],
            ["classifier.onnx", "manifest.json", "report.html"],
        )
        said = (rig / "models" / "report.html").read_bytes()
        assert said == (b"old" if "actor.onnx" in found else b"new")
        if ended.returncode == 0:
            break
        assert ended.returncode == -signal.SIGKILL
        killed += 1
        move_in(rig, NEW)
        assert names(rig) == ["models"]
    assert ended.returncode == 0
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
