"""A recording in which a set of models comes into use and goes again is replayed to the bit; where
the set is not there any more, the report says so and the rest is compared."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from firmware_py import launch
from firmware_py.brain.core import BrainCore
from firmware_py.brain.library import ShelfLibrary
from firmware_py.brain.loop import cpu_features
from firmware_py.guard.core import GuardCore
from firmware_py.model_sets.shelf import Shelf
from firmware_py.recording import Recordable
from firmware_py.records import Advice, CommandReply, Event, ModelsInUse
from firmware_py.replay.command import replay, words
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.rigs import load_rig
from tests.brain.onnx_models import actor
from tests.brain.shelves import put

from .test_replay import BENCH, SESSION, START_NS, record

Told = list[tuple[Recordable, int]]


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    return launch.shelf_folder(BENCH, tmp_path / "state")


def fly(shelf: Path, asked: dict[int, tuple[str, str]], seconds: float) -> Told:
    """Everything that crossed a process's border; ``asked`` of the models by millisecond."""
    told: Told = []
    codec, rig = codec_for(BENCH), load_rig("bench")

    def make_brain() -> BrainCore:
        library = ShelfLibrary(BENCH, shelf)
        models, start = library.in_use()
        return BrainCore(BENCH, models, cpu_features(), start, library)

    loop = ClosedLoop(
        Rig(rig, codec, node_limits(rig, BENCH), 7),
        GuardCore(BENCH, codec, SESSION),
        make_brain,
        [lambda item, now_ns: told.append((item, now_ns))],
        START_NS,
    )
    for millisecond in range(round(1000 * seconds)):
        if millisecond in asked:
            action, target = asked[millisecond]
            loop.command("models", action=action, target=target)
        loop.step()
    return told


def test_a_promotion_and_its_end_come_back_bit_by_bit(state: Path, tmp_path: Path) -> None:
    one = put(Shelf(state), tmp_path, "one", actor=actor(60e-6))
    asked = {600: ("shadow", one), 1000: ("promote", one), 1500: ("rollback", "")}
    told = fly(state, asked, 2.0)
    assert all(r.accepted for r, _ in told if isinstance(r, CommandReply))
    names = [r.models for r, _ in told if isinstance(r, Advice)]
    assert sorted(set(names)) == ["", one]
    assert names[-1] == ""
    events = [r.name for r, _ in told if isinstance(r, Event) and r.name.startswith("models")]
    assert sorted(events) == ["models_beside", "models_beside", "models_changed", "models_changed"]
    path = record(told, tmp_path / "recorded")
    report = replay(path)
    assert report.ok, words(report)
    brain = report.brain
    assert brain is not None
    assert (brain.steps_set_aside, brain.outputs_missing, brain.models_missing) == (0, 0, "")
    recorded = sum(isinstance(r, ModelsInUse) for r, _ in told)
    assert brain.compared["ha/models"] == recorded >= 5


def test_a_set_that_is_not_there_any_more_is_named(state: Path, tmp_path: Path) -> None:
    one = put(Shelf(state), tmp_path, "one", actor=actor(60e-6))
    told = fly(state, {200: ("shadow", one), 300: ("promote", one)}, 0.6)
    path = record(told, tmp_path / "recorded")
    shutil.rmtree(state / "sets")
    report = replay(path)
    assert report.ok  # what could be replayed was the same
    assert report.brain is not None
    assert report.brain.steps_set_aside > 0
    assert f"set '{one}' is not in" in report.brain.models_missing
    assert any("not all replayed" in line for line in words(report))
