"""What comes onto the shelf has been read, fits, answers finite and in time; all else is named."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from firmware_py import config
from firmware_py.brain import candidate, store
from firmware_py.brain.errors import ModelMissingError, ModelUnfitError
from firmware_py.brain.store import OBSERVATION
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import MANIFEST

from .machine import CONFIG
from .onnx_models import actor, card, classifier, own, short_film


def folder(path: Path, **files: bytes) -> Path:
    """A set in ``path``, as ``add`` would write it."""
    source = path / "source"
    source.mkdir(exist_ok=True)
    for name, data in files.items():
        (source / f"{name}.onnx").write_bytes(data)
    part = path / "part"
    part.mkdir(exist_ok=True)
    for name, data in candidate.read_source(source).items():
        (part / name).write_bytes(data)
    return part


def refused(part: Path, changed: config.Config = CONFIG) -> str:
    with pytest.raises(ModelUnfitError) as caught:
        candidate.examine(part, changed, [])
    return str(caught.value)


def slow(answers: int) -> bytes:
    """A policy whose answer takes ``answers`` products of 600 by 600 numbers."""
    big = numpy_helper.from_array(np.full((600, 600), 1e-3), "big")
    nodes = [helper.make_node("MatMul", ["big", "big"], ["p0"])]
    row = helper.make_node("Cast", ["observation"], ["x"], to=TensorProto.DOUBLE)
    first = numpy_helper.from_array(np.eye(11, 600), "first")
    nodes += [row, helper.make_node("MatMul", ["x", "first"], ["r0"])]
    for k in range(answers):
        nodes.append(helper.make_node("MatMul", [f"p{k}", "big"], [f"p{k + 1}"]))
        nodes.append(helper.make_node("MatMul", [f"r{k}", f"p{k + 1}"], [f"r{k + 1}"]))
        nodes.append(helper.make_node("Add", [f"p{k + 1}", f"r{k + 1}"], [f"q{k}"]))
    last = numpy_helper.from_array(np.full((600, 1), 1e-9), "last")
    nodes.append(helper.make_node("MatMul", [f"r{answers}", "last"], ["clearance"]))
    graph = helper.make_graph(
        nodes,
        "slow",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", 11])],
        [helper.make_tensor_value_info("clearance", TensorProto.DOUBLE, ["n", 1])],
        [big, first, last],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    lists = {"inputs": list(OBSERVATION), "outputs": ["clearance"], "domain": {}}
    helper.set_model_props(model, card("actor", **{k: json.dumps(v) for k, v in lists.items()}))
    return bytes(model.SerializeToString())


def test_a_whole_set_and_each_model_alone_pass(tmp_path: Path) -> None:
    every = {"classifier": classifier(), "actor": actor(7e-5), "surrogate": short_film()}
    found = candidate.examine(folder(tmp_path, **every), CONFIG, [])
    assert found.refusals == {}
    assert found.actor is not None
    assert found.actor.vouched_by == "unsigned"
    for number, (kind, data) in enumerate({**every, "own": own()}.items()):
        (tmp_path / str(number)).mkdir()
        alone = tmp_path / str(number) / "mine.onnx"
        alone.write_bytes(data)
        files = candidate.read_source(alone)
        assert sorted(files) == sorted([f"{kind}.onnx", MANIFEST])  # named by its card
        for name, content in files.items():
            (tmp_path / str(number) / name).write_bytes(content)
        candidate.examine(tmp_path / str(number), CONFIG, [])


def test_the_models_of_the_package_pass(tmp_path: Path) -> None:
    files = candidate.read_source(store.SHIPPED)
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    candidate.examine(tmp_path, CONFIG, [])


def test_another_machine_is_told_by_its_values(tmp_path: Path) -> None:
    bearing = msgspec.structs.replace(CONFIG.machine.bearing, journal_radius_m=0.04)
    other = CONFIG.replaced(machine=msgspec.structs.replace(CONFIG.machine, bearing=bearing))
    text = refused(folder(tmp_path, classifier=classifier(), actor=actor(7e-5)), other)
    assert text.count("bearing.journal_radius_m") == 2  # of both files, at once
    assert "here 0.04 (within 2 %)" in text


def test_what_is_not_finite_is_refused(tmp_path: Path) -> None:
    text = refused(folder(tmp_path, actor=actor(float("nan")), classifier=classifier(score=np.nan)))
    assert "actor.onnx: output 'clearance' is not finite" in text
    assert "classifier.onnx: output 'score' is not finite" in text


def test_a_slow_model_is_refused_with_its_time(tmp_path: Path) -> None:
    models = msgspec.structs.replace(CONFIG.models, deadline_ms=1.0)
    text = refused(folder(tmp_path, actor=slow(4)), CONFIG.replaced(models=models))
    assert "answers 1 rows in" in text
    assert "models.deadline_ms is 1" in text


def test_wrong_shape_and_what_is_no_model(tmp_path: Path) -> None:
    wrong = actor(8e-5, kind="surrogate", inputs=json.dumps(store.FILM_STATE), domain="{}")
    assert "graph takes 11 columns" in refused(folder(tmp_path, surrogate=wrong))
    (tmp_path / "x.onnx").write_bytes(b"no model")
    with pytest.raises(ModelUnfitError, match="not a model that onnxruntime runs"):
        candidate.read_source(tmp_path / "x.onnx")
    (tmp_path / "x.onnx").write_bytes(short_film(kind="surrogate_fed"))
    with pytest.raises(ModelUnfitError, match="kind 'surrogate_fed', this device uses"):
        candidate.read_source(tmp_path / "x.onnx")
    with pytest.raises(ModelMissingError):
        candidate.read_source(tmp_path / "none.onnx")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SetError, match=r"none of classifier\.onnx"):
        candidate.read_source(tmp_path / "empty")


def test_an_unsigned_set_is_refused_where_signatures_are_required(tmp_path: Path) -> None:
    models = msgspec.structs.replace(CONFIG.models, require_signature=True)
    text = refused(folder(tmp_path, actor=actor(7e-5)), CONFIG.replaced(models=models))
    assert "actor.onnx: unsigned, and a signature is required" in text


def test_a_file_that_is_not_in_its_manifest_or_not_as_there(tmp_path: Path) -> None:
    source = tmp_path / "set"
    source.mkdir()
    (source / "actor.onnx").write_bytes(actor(7e-5))
    files = candidate.read_source(source)
    (source / MANIFEST).write_bytes(files[MANIFEST])
    (source / "classifier.onnx").write_bytes(classifier())
    with pytest.raises(SetError, match="does not name classifier"):
        candidate.read_source(source)
    (source / "classifier.onnx").unlink()
    (source / "actor.onnx").write_bytes(actor(6e-5))
    with pytest.raises(ModelUnfitError, match="changed after packaging"):
        candidate.examine(source, CONFIG, [])


def test_a_machine_that_is_monitor_only_takes_none() -> None:
    kit = config.load(config.SHIPPED / "kit")[0]
    with pytest.raises(SetError, match="monitor only"):
        candidate.check_useful(kit)
    candidate.check_useful(CONFIG)
