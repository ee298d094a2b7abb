"""Commands without their extra, wrong options, absent files, closed streams: one line, never a
traceback."""

from __future__ import annotations

import importlib.metadata
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest

from firmware_py import cli

ROOT = Path(__file__).resolve().parents[2]
SIM = ("numba", "scipy", "gymnasium")
TRAIN = ("torch", "matplotlib", "onnx", "sklearn", "skl2onnx", "tensorboard")
HEAVY = (*SIM, *TRAIN, "onnxruntime", "zenoh")
POINTS = sorted(point.name for point in importlib.metadata.entry_points(group=cli.GROUP))

WITHOUT = """
import contextlib, io, json, sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {absent!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
from firmware_py.cli import main
ended = []
for arguments in {commands!r}:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(arguments)
    loaded = [name for name in {heavy!r} if name in sys.modules]
    ended.append([code, out.getvalue(), err.getvalue(), loaded])
print(json.dumps(ended))
"""


class Ended(NamedTuple):
    """How one command ended: its code, what it wrote, and which heavy packages it had loaded."""

    code: int
    out: str
    err: str
    loaded: list[str]


def without(absent: tuple[str, ...], *commands: tuple[str, ...]) -> list[Ended]:
    """The commands, one after the other, in a Python that lacks the packages ``absent``."""
    program = WITHOUT.format(absent=absent, commands=[list(each) for each in commands], heavy=HEAVY)
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=110,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [Ended(*each) for each in json.loads(done.stdout)]


NEEDING = {
    ("demo", "--clock", "sim"): "sim",
    ("hil",): "sim",
    ("bench", "sim"): "sim",
    ("verify", "--quick"): "sim",
    ("bound",): "sim",
    ("plot", "map", "-o", "x.png"): "",
    ("train", "surrogate", "--smoke"): "train",
    ("evaluate", "classifier"): "train",
    ("reproduce", "--quick"): "train",
}
"""Commands that need an extra."""


def test_a_command_without_its_extra_names_it_in_one_line() -> None:
    for (arguments, extra), ended in zip(
        NEEDING.items(), without((*SIM, *TRAIN), *NEEDING), strict=True
    ):
        assert ended.code == 2, (arguments, ended)
        assert ended.err.count("\n") == 1, (arguments, ended)
        assert f"orbitd[{extra}" in ended.err, (arguments, ended)


def test_help_needs_no_extra() -> None:
    for name, ended in zip(
        POINTS, without((*SIM, *TRAIN), *((name, "--help") for name in POINTS)), strict=True
    ):
        assert ended.code == 0, (name, ended)
        assert f"usage: orbitd {name}" in ended.out


def test_help_of_what_simulates_imports_nothing_heavy() -> None:
    ended = without((), *((name, "--help") for name in ("inject", "demo", "hil")))
    assert [each.code for each in ended] == [0, 0, 0]
    assert ended[-1].loaded == []


def test_inject_needs_no_compiler() -> None:
    ended = without(
        (*SIM, *TRAIN), ("inject", "unbalance", "40", "--runtime-dir", "/tmp/no-rig-here")
    )[0]
    assert ended.code == 3
    assert ended.err.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("demo", "--seconds", "nan"),
        ("demo", "--seconds", "inf"),
        ("demo", "--seconds", "1e12"),
        ("demo", "--seed", "-1"),
        ("demo", "--record", "/proc/x/y.mcap"),
        ("demo", "--record", "/"),
        ("hil", "--seed", "-1"),
        ("hil", "--seed", "1.5"),
        ("inject", "unbalance"),
        ("inject", "unbalance", "nan"),
        ("inject", "clear", "4"),
        ("inject", "operating"),
        ("inject", "unbalance", "4", "--severity", "5"),
        ("set", "clearance", "nan"),
        ("set", "clearance", "inf"),
        ("announce", "--in", "nan", "--for", "1", "--speed", "1", "--load", "1"),
        ("bus", "--seconds", "soon"),
        ("gate", "--ground-station", "99999"),
        ("evaluate", "classifier", "--size", "0"),
        ("train", "actor", "--seed", "-3"),
        ("plot", "map", "-o", "/proc/x/y.png"),
        ("plot", "map", "-o", "x.txt"),
        ("check", "/none.toml"),
        ("check", "/"),
        ("replay", "/none.mcap"),
        ("replay", "/"),
        ("replay", "/dev/null"),
        ("bound", "--duty", "/none.json"),
        ("train", "surrogate", "--config", "/none.toml"),
        ("status", "--config", "/none.toml"),
        ("reproduce", "--seed", "x"),
        ("inject", "status", "--config", "/"),
        ("mode", "sideways"),
        ("bench", "sin"),
    ],
)
def test_wrong_input_is_exit_code_2_and_no_traceback(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(list(arguments)) == 2
    lines = capsys.readouterr().err.splitlines()  # usage before the error, or a line for each fault
    assert lines[0].startswith("orbitd") or lines[-1].startswith("orbitd")


@pytest.mark.parametrize("name", ["status", "inject", "guard", "bus", "gate"])
def test_a_runtime_folder_that_cannot_be_made_is_one_line(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    what = ["status"] if name == "inject" else []
    assert cli.main([name, *what, "--runtime-dir", "/proc/x/y"]) in (1, 2, 3)
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    assert "/proc/x" in said


@pytest.mark.parametrize(
    "redirect", [">&-", "2>&-", ">&- 2>&-", "<&- >&-", "| true", "> /dev/full"]
)
@pytest.mark.parametrize("arguments", ["--help", "demo --help"])
def test_output_that_goes_nowhere_is_no_traceback(
    arguments: str, redirect: str, tmp_path: Path
) -> None:
    errors = tmp_path / "errors"
    command = f"{{ {sys.executable} -m firmware_py {arguments} {redirect}; }} 2>{errors}"
    subprocess.run(command, shell=True, cwd=ROOT, timeout=100, check=False)
    text = errors.read_text()
    assert "Traceback" not in text
    assert "Exception ignored" not in text
    if "/dev/full" in redirect and arguments != "demo --help":  # argparse passes over it by itself
        assert "No space left" in text


def test_a_terminal_that_knows_only_ascii_is_no_traceback() -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "LC_ALL": "C"}
    done = subprocess.run(
        [sys.executable, "-m", "firmware_py", "check", "bench"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "loaded"),
    [
        (("demo", "--clock", "sim", "--json"), "onnxruntime"),
        (("bus", "--instance", "a"), "msgspec"),
    ],
)
def test_ctrl_c_is_exit_code_130_and_no_traceback(
    arguments: tuple[str, ...], loaded: str, tmp_path: Path
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "firmware_py", *arguments],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # what a shell ignores
    )
    deadline = time.monotonic() + 60.0
    while loaded not in Path(f"/proc/{process.pid}/maps").read_text():
        assert time.monotonic() < deadline, f"{loaded} was never loaded"
        time.sleep(0.02)
    time.sleep(1.0)  # from the last library that it loads to its work
    process.send_signal(signal.SIGINT)
    errors = process.communicate(timeout=60)[1]
    assert "Traceback" not in errors
    assert process.returncode in (130, 0), errors
