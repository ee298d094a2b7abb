"""Trainers are given the machine: nothing of a shipped rig is known by heart."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from firmware_py.brain.made_for import misfit
from firmware_py.brain.store import read_card
from firmware_py.config import load
from models import export
from models.control.policies import ranges_of
from models.diagnosis import recordings
from models.diagnosis.data_cache import folder_of
from models.diagnosis.recordings import RecordingPlan, record_build
from models.diagnosis.windowed import usable_windows
from models.prediction import episodes
from sim_hil.rigs import load_rig

from .rigs import MILL, bench_copy


@pytest.fixture(scope="module")
def mill(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bench_copy(tmp_path_factory.mktemp("rigs") / "mill", MILL)


def plan_of(rig: Path | str) -> RecordingPlan:
    return RecordingPlan(str(rig), 1, 5000, 1.6, recordings.watch_cases)


def test_a_folder_is_recorded_with_its_own_device(mill: Path) -> None:
    (raw,) = record_build(plan_of(mill), 3)
    assert len(raw.counts) == 8000
    assert len(usable_windows(raw, str(mill))) >= 1


def test_recordings_of_a_changed_machine_are_others(mill: Path, tmp_path: Path) -> None:
    plain = bench_copy(tmp_path / "mill")
    there, other = folder_of(tmp_path, plan_of(mill)), folder_of(tmp_path, plan_of(plain))
    assert there != other
    assert there == folder_of(tmp_path, plan_of(mill))


def test_inputs_of_a_policy_span_the_machine(mill: Path) -> None:
    there, bench = ranges_of(load_rig(mill)), ranges_of(load_rig("bench"))
    assert there["load_estimate_N"][1] == pytest.approx(340.0)
    assert {name for name in bench if bench[name] != there[name]} == {"load_estimate_N"}


def test_a_model_file_carries_the_machines_name_and_figures_not_its_place(
    mill: Path, tmp_path: Path
) -> None:
    tensor = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["n", 1])
    out = helper.make_tensor_value_info("y", TensorProto.FLOAT, ["n", 1])
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "g", [tensor], [out])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", export.OPSET)])
    model.ir_version = 8
    metadata = export.Metadata(
        kind="actor",
        version="0",
        inputs=("x",),
        outputs=("y",),
        units=("m",),
        domain={},
        rigs=(str(mill),),
        data_hash="",
        metrics={"training": {"seconds": 3.2, "builds": 4}, "milliseconds_per_call": 0.1},
    )
    export.write(model, tmp_path / "m.onnx", metadata)
    said = {p.key: p.value for p in onnx.load(str(tmp_path / "m.onnx")).metadata_props}
    assert json.loads(said["rigs"]) == ["mill"]
    assert str(mill) not in "".join(said.values())
    assert json.loads(said["metrics"]) == {"training": {"builds": 4}}
    machines = read_card("m.onnx", said).made_for
    assert not misfit("actor", machines, load(mill)[0].machine)
    assert "operating.load_N 30 .. 200, here 30 .. 300" in misfit(
        "actor", machines, load_rig("bench").config.machine
    )


def test_a_regime_that_the_machine_does_not_know_gives_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = load_rig("bench")
    monkeypatch.setattr(episodes, "DAMPING", {"near_whirl": (5.0, 6.0)})
    monkeypatch.setattr(episodes, "TRIES", 30)
    drawn = episodes.draw(rig, 0, 2)
    assert episodes.REGIMES[2] == "near_whirl"
    assert drawn.regime == "steady"
    assert np.isfinite(drawn.duty.speed_rpm).all()


def test_a_machine_without_a_film_has_no_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(episodes, "TRIES", 5)
    with pytest.raises(episodes.NoEpisode, match="none of 5 drawn operating points keeps 500 um"):
        episodes.draw(replace(load_rig("bench"), min_film_m=500e-6), 0, 0)
