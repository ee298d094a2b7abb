"""The tutorial, as a reader follows it: each command is run, each change is made, and what it is
said to say is said."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_py import cli
from firmware_py.config.written import toml_value

PAGE = Path(__file__).resolve().parents[2] / "docs/your_machine.md"


def steps() -> Iterator[tuple[str, str]]:
    """Commands, changes of files and expected output, in the order of the page."""
    fenced = re.compile(r"^```(toml|text)\n(.*?)^```$|^    (orbitd [^\n]+)$", re.M | re.S)
    for found in fenced.finditer(PAGE.read_text()):
        yield ("run", found[3]) if found[3] else (found[1], found[2])


def change(text: str) -> None:
    """Set the keys of a block in the file that its first line names; remarks stay."""
    path = Path(text.partition("\n")[0].removeprefix("# "))
    file = path.read_text()
    for table, keys in tomllib.loads(text).items():
        file = re.sub(rf"^# \[{table}\]$", f"[{table}]", file, flags=re.M)
        for key, value in keys.items():
            head = rf"(^\[{table}\]$(?:(?!^\[).)*?)"
            row = f"{key} = {toml_value(value)}"
            there = re.search(rf"{head}^(?:# )?{key} = [^\n]*$", file, re.M | re.S)
            found = there or re.search(rf"(^\[{table}\]\n)", file, re.M)
            assert found, (path, table, key)
            file = file[: found.end(1)] + row + ("" if there else "\n") + file[found.end() :]
    path.write_text(file)


def test_the_tutorial_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    kinds, said, code = [], "", 0
    for kind, text in steps():
        kinds.append(kind)
        if kind == "run":
            code = cli.main(text.split()[1:])
            out = capsys.readouterr()
            said = out.out + out.err
            assert "Traceback" not in said
            if "rig" in text.split():
                assert code == 0, said
        elif kind == "toml":
            change(text)
        else:
            missing = [line for line in text.splitlines() if line not in said]
            assert not missing, f"{missing}\nnot in\n{said}"
            assert (code == 2) == ("if these are" in text)
    assert kinds.count("run") >= 12
    assert kinds.count("text") >= 9
