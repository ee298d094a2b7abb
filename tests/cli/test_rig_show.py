"""``orbitd rig show``: figures of the laws that ship, for people and programs, with or without the
simulator."""

from __future__ import annotations

import importlib
import json
import time
from types import ModuleType
from typing import Any

import pytest

from firmware_py import config
from firmware_py.commands import rig, rig_tables
from firmware_py.guard.envelope.shield import Shield

WITHOUT_SIM = {
    "sampling",
    "rotor",
    "groups",
    "film",
    "coefficients",
    "whirl",
    "stable",
    "admissible",
    "budget",
}


@pytest.fixture
def no_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a device without the extra `sim`."""
    load = importlib.import_module

    def absent(name: str, package: str | None = None) -> ModuleType:
        if name.startswith("sim_hil"):
            raise ModuleNotFoundError("No module named 'numba'", name="numba")
        return load(name, package)

    monkeypatch.setattr(rig_tables.importlib, "import_module", absent)


def shown(capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    assert rig.main(["show", *options, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.parametrize("name", ["bench"])
@pytest.mark.usefixtures("no_simulator")
def test_without_the_simulator_all_of_the_devices_own_laws_are_there(
    capsys: pytest.CaptureFixture[str], name: str
) -> None:
    start = time.process_time()
    found = shown(capsys, name)
    assert time.process_time() - start < 3.0
    assert set(found["tables"]) == WITHOUT_SIM
    assert found["left_out"] == [
        "damping and critical speeds are left out: no numba; pip install 'orbitd[sim]'"
    ]
    for table in found["tables"].values():
        assert table["title"]
        assert table["meaning"]
        assert table["rows"]
        assert all(len(row) == len(table["columns"]) for row in table["rows"])
    assert [row[5:] for row in found["tables"]["coefficients"]["rows"]] == [[None] * 4] * 4


@pytest.mark.usefixtures("no_simulator")
def test_figures_of_bench(capsys: pytest.CaptureFixture[str]) -> None:
    tables = shown(capsys, "bench")["tables"]
    bench = config.load(config.SHIPPED / "bench")[0]
    groups = {row[0]: row[1:4] for row in tables["groups"]["rows"]}
    assert groups["L/D"] == [0.5, 0.5, 1.0]
    assert groups["Ta"][2] == 41.0
    low_m, high_m = Shield(bench).fixed_range() or (0.0, 0.0)
    assert tables["admissible"]["rows"][0][1:3] == [low_m * 1e6, high_m * 1e6]
    onsets = [row[1] for row in tables["whirl"]["rows"]]
    assert onsets == sorted(onsets, reverse=True)  # a wider bearing whirls earlier
    assert tables["sampling"]["rows"][1][3] == 4687.5
    thinnest = min(row[1] for row in tables["film"]["rows"])
    assert thinnest == pytest.approx(10.5, abs=0.1)


def test_with_the_simulator_there_are_damping_and_critical_speeds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("numba")
    assert rig.main(["show", "bench"]) == 0
    text = capsys.readouterr().out
    assert "Critical speeds" in text
    assert "left out" not in text
