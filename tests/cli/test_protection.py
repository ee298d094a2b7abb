"""``orbitd protection matrix``: causes and effects, from the configuration."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from firmware_py.commands.protection import CAUTION, NO_PERMIT, main
from firmware_py.config import SHIPPED

GROUP = '[[group]]\nname = "shaft"\nmeasures = ["disp_x", "disp_y"]\nvote = "2oo2"\n'


def test_the_matrix_has_a_row_for_each_set_point(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["matrix", "bench", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["rows"]) == 16
    assert found["groups"] == []
    danger = next(row for row in found["rows"] if row["alarm"] == "disp_x_danger")
    assert danger == {
        "measure": "disp_x", "source": "disp_x", "quantity": "displacement, peak-to-peak",
        "alarm": "disp_x_danger", "level": "danger",
        "set_point": "above 70 um, at most 0.5 of the radial clearance", "delay": "3 s",
        "hysteresis": "5 %", "latching": True, "judged": "always", "vote": "1oo1",
        "effect": "trip", "key": "limits.displacement_danger_um",
    }  # fmt: skip


def test_votes_and_what_a_trip_does_not_do_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "mine"
    shutil.copytree(SHIPPED / "bench", rig)
    path = rig / "device.toml"
    text = path.read_text().replace("trip_on_danger = true", "trip_on_danger = false")
    path.write_text(text + GROUP)
    assert main(["matrix", str(rig)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "group shaft: 2oo2 of disp_x, disp_y; while none is OK: authority; trips as" in out
    assert NO_PERMIT in out
    assert CAUTION in out
    assert "disp_y_danger" in out
