"""``orbitd protection matrix``: causes and effects, from the configuration."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from firmware_py.commands.protection import CAUTION, NO_PERMIT, main
from firmware_py.config import SHIPPED, load
from firmware_py.errors import OrbitdError
from firmware_py.guard.protection.vibration import Protection

MORE = """
[[measure]]
name = "roll"
quantity = "smax"
unit = "um"
alert = 8.0
to_rpm = 500.0
[[measure]]
name = "power"
quantity = "reading"
source = "shaft_power"
unit = "W"
sense = "window"
danger_low = 5.0
danger = 900.0
from_rpm = 1000.0
judged = "armed"
[[measure]]
name = "acc_motor"
may_bypass = true
[[multiply]]
name = "critical"
measures = ["disp_x"]
factor = 2.0
from_rpm = 2000.0
to_rpm = 3000.0
max_s = 30.0
reset_rpm = 1500.0
"""
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
        "set_point": "above 70 um, at most 0.5 of the radial clearance: 20 um at its least, 40 um",
        "delay": "3 s",
        "hysteresis": "5 %", "latching": True, "judged": "always", "vote": "1oo1",
        "effect": "trip", "bypass": False, "key": "limits.displacement_danger_um",
    }  # fmt: skip


def test_votes_and_what_a_trip_does_not_do_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "mine"
    shutil.copytree(SHIPPED / "bench", rig)
    path = rig / "device.toml"
    text = path.read_text().replace("trip_on_danger = true", "trip_on_danger = false")
    path.write_text(text + GROUP + MORE)
    assert main(["matrix", str(rig)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "group shaft: 2oo2 of disp_x, disp_y; while none is OK: authority; trips as" in out
    assert "multiply critical: set points of disp_x by 2 in 2000 .. 3000 rpm for at most 30" in out
    assert "may be bypassed: acc_motor" in out
    assert NO_PERMIT in out
    assert main(["matrix", str(rig), "--json"]) == 0
    rows = {row["alarm"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    capped = "above 8 um, at most 0.25 of the radial clearance: 8 um at its least, 40 um"
    assert rows["roll_alert"]["set_point"] == capped
    assert rows["roll_alert"]["judged"] == "always, 0 .. 500 rpm"
    assert rows["power_danger"]["set_point"] == "outside 5 .. 900 W"
    assert rows["power_danger"]["judged"] == "while armed, from 1000 rpm"
    assert rows["acc_motor_danger"]["bypass"]
    assert not rows["acc_motor_alert"]["bypass"]
    assert CAUTION in out
    assert "disp_y_danger" in out


def test_the_alert_scales_with_its_danger_as_the_guard_has_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["matrix", "bench", "--json"]) == 0
    rows = {row["alarm"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    stage = Protection(load(SHIPPED / "bench")[0], [])
    alert_um, _ = stage.set_points_um(40.0)
    assert f"{alert_um:.4g} um at its least, 40 um" in rows["disp_x_alert"]["set_point"]
    assert "at most 0.321 of the radial clearance" in rows["disp_x_alert"]["set_point"]


@pytest.mark.parametrize("end", [["--minutes", "10"], ["--end"]])
def test_a_request_of_a_device_that_is_away_says_so(
    tmp_path: Path, end: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for verb, more in (("bypass", ["--owner", "A. P.", "--reason", "probe"]), ("shelve", [])):
        with pytest.raises(OrbitdError) as refused:
            main([verb, "disp_x", *more, *end])
        assert refused.value.exit_code == 3
