"""The page docs/monitor.md: what it shows is what `orbitd check` takes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware_py import launch
from firmware_py.commands import check
from firmware_py.machine.parts import monitor_only
from tests.monitor.test_foreign import DBC

PAGE = Path(__file__).resolve().parents[2] / "docs/monitor.md"
BLOCKS = re.findall(r"(?ms)^```toml\n(.*?)^```", PAGE.read_text())
MACHINE, DEVICE, SECOND, LIMITS, FOREIGN = BLOCKS


def folder(path: Path, machine: str, device: str = DEVICE) -> Path:
    path.mkdir()
    (path / "machine.toml").write_text(machine)
    (path / "device.toml").write_text(device)
    return path


def test_the_least_machine_of_the_page_is_good(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check.main([str(folder(tmp_path / "my_monitor", MACHINE))]) == 0
    assert "monitor only: no [actuator]" in capsys.readouterr().out


def test_a_second_bearing_is_good_as_the_page_has_it(tmp_path: Path) -> None:
    probes = MACHINE[MACHINE.index("[[channel]]") :].replace("disp_", "nde_")
    probes = probes.replace('unit = "m"', 'unit = "m"\nkind = "displacement"\nbearing = "nde"')
    rig = folder(tmp_path / "two", f"{MACHINE}\n{probes}\n{SECOND}", f"{DEVICE}\n{LIMITS}")
    config, _ = launch.verified(rig)
    assert [other.name for other in config.machine.other_bearing] == ["nde"]
    assert config.limits_at[0].displacement_danger_um == 120.0


def test_the_map_of_the_page_is_good(tmp_path: Path) -> None:
    rig = folder(tmp_path / "plant", f"{MACHINE}\n{FOREIGN}")
    (rig / "plant.dbc").write_text(DBC)
    config, _ = launch.verified(rig)
    assert any("only listens" in reason for reason in monitor_only(config.machine))


def test_the_kit_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    assert check.main(["kit"]) == 0
    assert "0.0 um is admissible" not in capsys.readouterr().out
