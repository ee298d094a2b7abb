"""Recipes of ``docs/how_to_add.md``, executed as they stand there in a copy of the project."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "how_to_add.md"
COPIED = ("firmware_py", "sim_hil", "models", "tests", "docs")
FENCED = re.compile(r"^( *)```(\w+)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)

THINNER = """
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS

rig = load_rig("bench")
for faults in ({}, {"thin_oil": 1.0}):
    machine = SimulatedMachine(rig, Build.nominal(rig), 1)
    for name, severity in faults.items():
        machine.inject(name, severity)
    truth = run(machine, Duty.hold(6000.0, 60.0), 0.5, clearance=60e-6).truth
    print(truth[-1000:, TRUTH_COLUMNS.index("min_film_m")].mean())
"""


def blocks(heading: str, language: str) -> list[str]:
    """The fenced blocks of ``language`` below ``heading``."""
    text = PAGE.read_text(encoding="utf-8")
    part = re.search(rf"^## {re.escape(heading)}.*?(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert part, heading
    return [textwrap.dedent(body) for _, kind, body in FENCED.findall(part[0]) if kind == language]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project as it stands, to be changed."""
    folder = tmp_path_factory.mktemp("copy")
    for name in COPIED:
        unwanted = shutil.ignore_patterns("__pycache__", "*.mcap.xz")
        shutil.copytree(ROOT / name, folder / name, ignore=unwanted)
    shutil.copy2(ROOT / "pyproject.toml", folder)
    return folder


def changed(path: Path, after: str, text: str) -> None:
    """Put ``text``, indented as it is there, below the one line that holds ``after``."""
    lines = path.read_text(encoding="utf-8").split("\n")
    (at,) = [i for i, line in enumerate(lines) if after in line]
    indent = re.match(r" *", lines[at])[0]  # type: ignore[index]
    lines[at + 1 : at + 1] = textwrap.indent(text.rstrip("\n"), indent).split("\n")
    path.write_text("\n".join(lines), encoding="utf-8")


def python(copy: Path, *arguments: str) -> str:
    """What the copy's own Python prints; it must end well."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    ended = subprocess.run(
        [sys.executable, *arguments],
        cwd=copy,
        env=environment,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_a_slow_reading_of_a_new_kind(copy: Path) -> None:
    (row,) = blocks("A slow reading", "python")
    (tables,) = blocks("A slow reading", "toml")
    changed(copy / "firmware_py/signals.py", 'SlowKind("level"', row)
    rig = copy / "my_rig"
    shutil.copytree(copy / "firmware_py/rigs/bench", rig)
    with (rig / "machine.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n{tables}")
    changed(rig / "device.toml", "[bus]", "schema = 2")

    assert "good" in python(copy, "-m", "firmware_py", "check", str(rig))
    dbc = python(copy, "-m", "firmware_py", "rig", "dbc", str(rig))
    assert "Strain of the pump's case" in dbc
    assert "pump_case_strain_quality" in dbc
    python(copy, "-m", "pytest", "-q", "tests/test_signals.py", "-k", "kind or row or signal")


def test_the_physics_of_a_fault(copy: Path) -> None:
    function, row = blocks("A fault class", "python")
    faults = copy / "sim_hil/faults/machine.py"
    text = faults.read_text(encoding="utf-8")
    assert text.count("\n_PERCENT = ") == 1
    text = text.replace("\n_PERCENT = ", f"\n{function}\n\n_PERCENT = ")
    faults.write_text(text, encoding="utf-8")
    changed(faults, '"pressure_loss": MachineFault', row)

    healthy, thinned = map(float, python(copy, "-c", THINNER).split())
    assert thinned < 0.9 * healthy
    python(
        copy, "-m", "pytest", "-q", "tests/sim_hil/plant/test_machine_faults.py", "-k", "thin_oil"
    )
