"""Machines with fixed pads: watched, never controlled, and simulated in the film that they have."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from firmware_py import launch
from firmware_py.config import SHIPPED, Config, load
from firmware_py.config.checks_machine import MACHINE_CHECKS
from firmware_py.guard.core import GuardCore
from firmware_py.machine import FixedPads
from firmware_py.machine.parts import has_film_law, monitor_only
from firmware_py.records import GuardState
from firmware_py.wire.link import codec_for
from sim_hil.film import pad_table
from sim_hil.film.bore import PadBore
from sim_hil.rigs import load_rig
from tests.fuzz import machines

LEMON = """
[pads]
count = 2
arc_deg = 160.0
preload = 0.5
offset_share = 1.0
"""


def with_pads(pads: FixedPads) -> Config:
    config = load(SHIPPED / "bench")[0]
    return config.replaced(machine=msgspec.structs.replace(config.machine, pads=pads))


def test_pads_make_a_machine_monitor_only_by_name() -> None:
    config = with_pads(FixedPads(2, 160.0, 0.5))
    assert not has_film_law(config.machine)
    assert monitor_only(config.machine) == (
        "[pads]: the guard's laws of the film are proven for a round bore only",
    )
    assert GuardCore(config, codec_for(config), 1) is not None


@pytest.mark.parametrize(("count", "arc_deg", "wrong"), [(2, 180.0, 0), (3, 120.5, 1), (4, 90, 0)])
def test_pads_fit_into_a_turn(count: int, arc_deg: float, wrong: int) -> None:
    config = with_pads(FixedPads(count, arc_deg, 0.4))
    found = [key for check in MACHINE_CHECKS for key, *_ in check(config)]
    assert found.count("machine.pads.arc_deg") == wrong


def folder(place: Path, pads: str) -> Path:
    """The bench with pads."""
    for name in ("machine.toml", "device.toml", "simulation.toml"):
        (place / name).write_text((SHIPPED / "bench" / name).read_text())
    path = place / "machine.toml"
    path.write_text(path.read_text() + pads)
    return place


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_lemon_runs_in_the_closed_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five seconds of rig, guard and brain: watched, no command and no alarm."""
    monkeypatch.setattr(pad_table, "CELLS", (10, 24, 16, 5))
    monkeypatch.setattr(pad_table, "GRID", (64, 8))
    monkeypatch.setattr(pad_table, "_cache", lambda: tmp_path / "films")
    path = folder(tmp_path, LEMON.replace("offset_share = 1.0", ""))
    loop = machines.Loop(launch.verified(path)[0], load_rig(path), 3)
    assert loop.judged() == []
    assert loop.only
    states = [record for record in loop.told if isinstance(record, GuardState)]
    assert not [alarm.name for state in states for alarm in state.alarms]
    last = loop.plant.truth[-1]
    assert last.min_film_um > 20.0
    assert last.peak_to_peak_um < 5.0


def test_a_folder_with_pads_is_simulated_between_them(tmp_path: Path) -> None:
    rig = load_rig(folder(tmp_path, LEMON))
    assert rig.bearing.pads == FixedPads(2, 160.0, 0.5, offset_share=1.0)
    bore = PadBore.of(rig.bearing.pads)
    assert bore is not None
    assert (bore.count, bore.offset, bore.preload) == (2, 1.0, 0.5)
