"""The oracle: every golden recording decides the same again, bit for bit, and nothing of it is left
out."""

from __future__ import annotations

import hashlib
import lzma
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.recording import Recording
from firmware_py.records import Cycle, Decision
from firmware_py.replay.command import _config
from firmware_py.replay.decisions import DecisionReplay
from tests.golden import make
from tests.golden.make import BYTES_MAX, FOLDER, Golden, manifest
from tests.golden.scenarios import SCENARIOS, Scenario

HELP = """
{name} ({what}) decides otherwise than it did when it was recorded:
  {difference}
If the change of behaviour is meant: say in the commit what changed and why, look at what
`git diff` shows of tests/golden/manifest.json after `make golden`, and commit both.  If it is not
meant, the guard has a regression:
`orbitd replay` of the unpacked recording (`xz -dk {path}`) names the first cycle that differs.
"""


def check(golden: Golden, packed: Path, folder: Path) -> None:
    """Replay ``packed`` and compare everything with the manifest."""
    plain = folder / f"{golden.name}.mcap"
    plain.write_bytes(lzma.decompress(packed.read_bytes()))
    recording = Recording(plain)
    replay = DecisionReplay(_config(recording))
    for _ in replay.run(recording):
        pass
    report, help_ = replay.report, {"name": golden.name, "what": golden.what, "path": packed}
    assert not recording.interrupted
    assert recording.damage.notes == []
    assert not report.first_difference, HELP.format(difference=report.first_difference, **help_)
    counted = (
        report.cycles,
        report.snapshots_compared + report.segments,
        report.segments,
        report.different,
        report.snapshots_different,
        report.cycles_missing,
        report.cycles_outside_segments,
    )
    assert counted == (golden.cycles, golden.snapshots, 1, 0, 0, 0, 0), (
        "a part of the recording was not compared"
    )


GOLDEN = manifest()
if GOLDEN:  # made by `make golden`

    @pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
    def test_a_golden_recording_decides_the_same_again(golden: Golden, tmp_path: Path) -> None:
        check(golden, FOLDER / f"{golden.name}.mcap.xz", tmp_path)

    def test_the_recordings_are_those_of_the_manifest_and_small_enough() -> None:
        assert [golden.name for golden in GOLDEN] == [scenario.name for scenario in SCENARIOS]
        sizes = {
            path.name.partition(".")[0]: path.stat().st_size for path in FOLDER.glob("*.mcap.xz")
        }
        assert sizes == {golden.name: golden.bytes for golden in GOLDEN}
        assert sum(sizes.values()) <= BYTES_MAX

    @pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
    def test_the_events_show_what_the_scenario_is_for(scenario: object) -> None:
        golden = next(g for g in GOLDEN if g.name == scenario.name)  # type: ignore[attr-defined]
        found = {name for _, name, _, _ in golden.events}  # type: ignore[attr-defined]
        assert set(scenario.must) <= found


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Golden, Path]:
    """The shortest form of the first scenario, made by the program that makes them all."""
    folder = tmp_path_factory.mktemp("golden")
    path = folder / "small.mcap.xz"
    return make.make(replace(SCENARIOS[0], name="small", seconds=2.2), path), path


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_a_scenario_is_played_with_a_configuration_that_can_be_read_back(
    scenario: Scenario,
) -> None:
    config = scenario.setting().config
    assert msgspec.json.decode(msgspec.json.encode(config), type=Config) == config


def test_a_recording_that_was_just_made_replays(small: tuple[Golden, Path], tmp_path: Path) -> None:
    golden, path = small
    assert golden.cycles == 2200
    assert golden.snapshots == 3
    assert "run_permit_granted" in [name for _, name, _, _ in golden.events]
    check(golden, path, tmp_path)


def test_a_guard_that_decides_otherwise_is_found_and_the_way_on_is_told(
    small: tuple[Golden, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = GuardCore.step

    def changed(self: GuardCore, cycle: Cycle) -> Decision:
        decision = step(self, cycle)
        if cycle.seq < 1500 or not decision.frames_out:
            return decision
        first = decision.frames_out[0]
        flipped = msgspec.structs.replace(first, data=first.data[:-1] + bytes([first.data[-1] ^ 1]))
        return msgspec.structs.replace(decision, frames_out=[flipped, *decision.frames_out[1:]])

    monkeypatch.setattr(GuardCore, "step", changed)
    with pytest.raises(AssertionError, match="make golden"):
        check(small[0], small[1], tmp_path)


def test_a_recording_with_a_part_missing_is_not_accepted(
    small: tuple[Golden, Path], tmp_path: Path
) -> None:
    golden, path = small
    plain = lzma.decompress(path.read_bytes())
    cut = tmp_path / "cut.mcap.xz"
    cut.write_bytes(lzma.compress(plain[: len(plain) // 2]))
    with pytest.raises(AssertionError):
        check(golden, cut, tmp_path)


def test_two_makings_give_the_same_bytes(small: tuple[Golden, Path], tmp_path: Path) -> None:
    again = make.make(replace(SCENARIOS[0], name="small", seconds=2.2), tmp_path / "again.mcap.xz")
    assert again == small[0]
    first, second = (
        hashlib.sha256(p.read_bytes()).hexdigest() for p in (small[1], tmp_path / "again.mcap.xz")
    )
    assert first == second
