"""From recordings to one file, and that file judged on recordings that it has not seen."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest

from models import evaluate, train
from models.diagnosis import measured, measured_graph
from models.diagnosis.dataset import DatasetError
from models.diagnosis.measured_features import windows_of
from models.diagnosis.measured_judge import judge
from models.diagnosis.measured_score import TaughtDistance, fit_score

from .test_measured import turning


def stored(folder, found):
    """A folder of ``found`` with subfolders as labels."""
    for r in found:
        (folder / r.label).mkdir(parents=True, exist_ok=True)
        t = np.arange(len(r.samples)) / r.rate_hz
        speed = np.gradient(r.turns) * r.rate_hz * 60.0
        np.savez(
            folder / r.label / f"{r.name}.npz", t=t, x=r.samples[:, 0], y=r.samples[:, 1], rpm=speed
        )
    (folder / "channels.toml").write_text(
        "[[channel]]\ncolumn='x'\nunit='m/s2'\n[[channel]]\ncolumn='y'\nunit='m/s2'\n"
        "[speed]\ncolumn='rpm'\nunit='rpm'\n"
    )
    return folder


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Folder of a training, its file and report."""
    folder = tmp_path_factory.mktemp("trained")
    (folder / "only.toml").write_text('rungs = ["logistic regression, orders"]')
    data = stored(folder / "rig", turning(3.0))
    given = [
        "classifier",
        "--data",
        str(data),
        "--out",
        str(folder),
        "--config",
        str(folder / "only.toml"),
    ]
    assert train.main(given) == 0
    run = folder / "measured_model-seed0"
    return run / "measured_model.onnx", json.loads((run / "measured_model.json").read_text())


def test_a_regression_on_orders_is_trained_and_exported(trained):
    path, report = trained
    assert report["trained"] == "logistic regression, orders"
    assert report["chosen on inner groups"]["balanced_accuracy"] == 1.0
    assert report["random forest, 16 bands"]["balanced_accuracy"] <= 1.0
    assert report["export_parity"] < 1e-4
    metadata = {p.key: p.value for p in onnx.load(path).metadata_props}
    assert json.loads(metadata["channels"]) == ["x", "y"]
    assert json.loads(metadata["units"]) == ["m/s2", "m/s2"]
    assert metadata["status"] == "provisional"


def test_a_file_is_judged_on_what_it_has_not_seen(trained, tmp_path, capsys):
    path, _ = trained
    others = stored(tmp_path / "other", turning(3.0, 7)[8:])
    assert evaluate.main(["classifier", "--data", str(others), "--file", str(path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["recordings"] == 6
    assert report["recordings_seen_in_training"] == 0
    assert report["per_window"]["decisions"] == 24
    assert report["per_decision"]["decisions"] == 6
    assert set(report["beside"]) == {"random forest, 16 bands"}
    words = report["per_window"]["words"]
    assert sum(sum(of.values()) for of in words.values()) == 24


def test_what_it_was_trained_on_is_left_out_and_alone_refused(trained):
    path, _ = trained
    report = judge(path, turning(3.0, 6), 0)
    assert (report["recordings"], report["recordings_seen_in_training"]) == (4, 8)
    with pytest.raises(DatasetError, match=r"was trained on all 8 recordings; give others, or"):
        judge(path, turning(3.0), 0)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"channels": ("x", "z")}, r"lacks the channels y of .*, it has x, z; name them alike"),
        ({"units": ("m/s2", "")}, r"was trained with \('m/s2', 'm/s2'\); say the units"),
        ({"rate_hz": 500.0}, r"500 Hz, .* was trained at 1000; say resample_hz = 1000"),
        ({"turns": None}, r"needs orders: 4normal, window 1: neither mark nor speed is known"),
    ],
)
def test_recordings_of_another_kind_are_refused(trained, change, match):
    with pytest.raises(DatasetError, match=match):
        judge(trained[0], [replace(r, **change) for r in turning(3.0, 5)], 0)


def test_channels_in_another_order_are_set_right(trained):
    path, _ = trained
    found = turning(3.0, 5)[8:]
    turned = [
        replace(r, samples=np.ascontiguousarray(r.samples[:, ::-1]), channels=("y", "x"))
        for r in found
    ]
    assert judge(path, turned, 0) == judge(path, found, 0)


def test_a_model_of_another_kind_is_refused(tmp_path, capsys):
    from models import ARTIFACTS

    data = stored(tmp_path, turning(3.0))
    given = ["classifier", "--data", str(data), "--file"]
    assert evaluate.main([*given, str(ARTIFACTS / "classifier.onnx")]) == 2
    assert "a classifier, not a measured classifier: its features" in capsys.readouterr().err
    assert evaluate.main([*given, str(tmp_path / "none.onnx")]) == 2
    assert "none.onnx: cannot be judged" in capsys.readouterr().err
    (tmp_path / "bad.onnx").write_bytes(b"no model")
    assert evaluate.main([*given, str(tmp_path / "bad.onnx")]) == 2
    assert "bad.onnx: not a model that onnxruntime runs" in capsys.readouterr().err


def test_a_forest_becomes_the_same_graph():
    data = windows_of(turning(3.0), views=("16 bands",))
    x = data.views["16 bands"]
    forest = measured.fit_forest(x, data.label, 2, 0)
    score = fit_score(x, data.label, data.group)
    model = measured_graph.graph_of(forest, score, x)
    assert [each.name for each in model.graph.output] == ["classes", "score"]
    assert [each.name for each in model.graph.input] == ["features"]
    onnx.checker.check_model(model, full_check=True)
    assert measured_graph.worst_difference(model, forest, score, x) < 1e-4


def test_normal_alone_is_one_class_and_a_score(tmp_path, capsys):
    data = stored(tmp_path / "rig", turning(3.0, 6, ("normal",)))
    assert train.main(["classifier", "--data", str(data), "--out", str(tmp_path)]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["trained"] == "distance from normal, 16 bands"
    assert report["export_parity"] < 1e-4
    path = tmp_path / "measured_model-seed0" / "measured_model.onnx"
    others = turning(3.0, 9, ("loose",))[6:]
    strange = [
        replace(r, samples=r.samples + 2.0 * np.sin(900.0 * r.turns)[:, None]) for r in others
    ]
    told = judge(path, strange, 0)
    assert told["per_window"]["unknown_found"]["loose"] == 1.0
    assert told["per_decision"]["words"] == {"loose": {"unknown": 3}}


def test_the_score_is_a_distance_in_scatters_of_the_classes():
    rng = np.random.default_rng(0)
    label = np.arange(4000) % 2
    x = rng.normal(size=(4000, 3)) * [1.0, 5.0, 0.1] + np.where(label, 100.0, 0.0)[:, None]
    score = TaughtDistance.fit(x, label)
    assert np.sqrt(np.mean(score(x) ** 2)) == pytest.approx(1.0, abs=0.05)
    far = score(np.array([[0.0, 50.0, 0.0], [100.0, 100.0, 101.0]]))
    assert far[0] == pytest.approx(10.0 / np.sqrt(3.0), rel=0.05)
    assert far[1] == pytest.approx(10.0 / np.sqrt(3.0), rel=0.05)
