"""Measured recordings: groups are left out whole, the choice is made inside, normal alone finds
faults."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firmware_py.acquire.channel_features import VIEWS
from models.diagnosis import measured, measured_normal
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import MeasuredRecording, read_folder
from models.diagnosis.measured_features import windows_of
from models.diagnosis.public_recordings import write

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def recordings(shift=40.0, groups=4, n=800, labels=("a", "b")):
    """Two labels that differ in the frequency of a ringing; every group has its own level."""
    rng = np.random.default_rng(0)
    found = []
    for group in range(groups):
        for label in labels:
            time = np.arange(n) / 200.0
            tone = np.sin(
                2
                * np.pi
                * ((40.0 if label == labels[0] else shift) * time[:, None] + rng.random(2))
            )
            samples = (1 + group) * (tone + 0.3 * rng.normal(size=(n, 2)))
            found.append(
                MeasuredRecording(
                    f"{group}{label}", samples, 200.0, ("x", "y"), label, f"{group} m/s"
                )
            )
    return found


@pytest.fixture(scope="module")
def report():
    few = {name: measured.RUNGS[name] for name in measured.RUNGS if "forest" not in name}
    return measured.evaluate(windows_of(recordings(55.0)), rungs=few)


def test_a_shifted_ringing_is_told(report):
    assert report["chosen on inner groups"]["balanced_accuracy"] > 0.8
    assert report["majority_share"] == 0.5
    assert np.sum(report["chosen on inner groups"]["confusion"]) == report["windows"] == 32
    assert (
        sum(report["chosen on inner groups"]["chosen"].values()) == report["groups_left_out"] == 4
    )


def test_labels_that_say_nothing_are_not_told():
    data = windows_of(recordings(40.0))
    assert (
        measured.balanced(data.label, measured._left_out(data, np.arange(32), 0, *measured.FOREST))
        < 0.8
    )


def test_the_choice_sees_only_the_groups_of_its_part():
    data = windows_of(recordings(55.0))
    seen = []

    def spy(x, label, classes, seed):
        seen.append(len(x))
        return measured.fit_regression(x, label, classes, seed)

    part = np.flatnonzero(data.group != 0)
    assert measured.choose(data, part, 0, {"spy": ("2 bands", spy)}) == "spy"
    assert seen == [16] * 3, "three groups of eight windows, one of them held out each time"


def test_the_simplest_of_equals_is_chosen():
    data = windows_of(recordings(75.0))
    rungs = {n: measured.RUNGS[n] for n in ("logistic regression, 2 bands", measured.FOREST_NAME)}
    assert measured.choose(data, np.arange(len(data)), 0, rungs).startswith("logistic regression")


def test_no_group_is_on_both_sides():
    data = windows_of(recordings())
    for train, test in measured.folds(data, np.arange(len(data))):
        assert not set(data.group[train]) & set(data.group[test])
        assert not set(data.recording[train]) & set(data.recording[test])
    torn = replace(data, group=np.arange(len(data)) % 4)
    with pytest.raises(DatasetError, match=r"recording 0 stands in 4 groups, on both sides"):
        measured.evaluate(torn)


def test_classes_that_one_group_alone_holds_are_not_scored():
    data = windows_of([r for r in recordings(55.0) if r.label == "a" or r.group == "0 m/s"])
    assert np.sum(measured._scored(data)) == np.sum(data.label == 0)
    alone = windows_of(
        [r for r in recordings(55.0, groups=2) if (r.label == "a") == (r.group == "0 m/s")]
    )
    with pytest.raises(DatasetError, match="choose another group"):
        measured.evaluate(alone)


def test_paired_interval_of_equal_answers_is_zero():
    data = windows_of(recordings())
    rows = np.arange(len(data.label))
    assert measured.paired_interval(data, rows, data.label, data.label) == (0.0, 0.0)
    low, high = measured.paired_interval(data, rows, data.label, 1 - data.label)
    assert low > 0.5
    assert high <= 1.5


def test_normal_alone_finds_what_differs_and_only_that():
    told = measured_normal.detect(windows_of(recordings(55.0, 6, labels=("normal", "loose"))))
    assert told["16 bands"]["auroc"] > 0.9
    assert told["16 bands"]["auroc_of"] == {"loose": told["16 bands"]["auroc"]}
    same = measured_normal.detect(windows_of(recordings(40.0, 6, labels=("normal", "loose"))))
    assert 0.3 < same["2 bands"]["auroc"] < 0.7


def test_without_normal_recordings_the_reason_stands_instead():
    assert measured_normal.detect(windows_of(recordings())) == {"left_out": "no label 'normal'"}
    few = measured_normal.detect(windows_of(recordings(groups=3, labels=("normal", "loose"))))
    assert few == {"left_out": "no machine has 3 groups with the label 'normal'"}


def test_files_as_groups_need_one_more_that_is_normal():
    found = recordings(55.0, 3, labels=("normal", "loose"))
    alone = [replace(r, group=r.name) for r in found]
    told = measured_normal.detect(windows_of(alone, views=("2 bands",)))
    assert "3 groups with the label 'normal' beside the one that is left out" in told["left_out"]
    more = recordings(55.0, 4, labels=("normal", "loose"))
    told = measured_normal.detect(
        windows_of([replace(r, group=r.name) for r in more], views=("2 bands",))
    )
    assert 0.0 <= told["2 bands"]["auroc"] <= 1.0


def test_recordings_shorter_than_a_window_are_named():
    with pytest.raises(DatasetError, match=r"2 problems:\n  0b: 300 samples .* --window-s 1.5"):
        windows_of([replace(r, samples=r.samples[:300]) if r.label == "b" else r
                    for r in recordings(groups=2)], 2.0)  # fmt: skip


def turning(order, groups=4, labels=("normal", "unbalance"), rate=1000.0):
    """Recordings at several speeds; the second label has a larger given order."""
    rng = np.random.default_rng(1)
    found = []
    for group in range(groups):
        for k, label in enumerate(labels):
            turns = (12.0 + 3.0 * group) * np.arange(4000) / rate
            wave = np.sin(2 * np.pi * turns) + (0.3 + 0.5 * k) * np.sin(2 * np.pi * order * turns)
            samples = np.column_stack([wave, 0.5 * wave]) + 0.2 * rng.normal(size=(4000, 2))
            found.append(
                MeasuredRecording(
                    f"{group}{label}", samples, rate, ("x", "y"), label, f"{group}", "m",
                    ("m/s2", "m/s2"), turns,
                )
            )  # fmt: skip
    return found


def test_orders_carry_over_to_speeds_never_heard():
    data = windows_of(turning(3.0))
    every = np.arange(len(data))
    orders, bands = (
        measured.balanced(
            data.label,
            measured._left_out(data, every, 0, *measured.RUNGS[f"logistic regression, {view}"]),
        )
        for view in ("orders", "64 bands")
    )
    assert orders == 1.0
    assert orders > bands


def test_orders_are_left_out_with_the_reason():
    slow = [replace(r, turns=r.turns / 4) for r in turning(3.0)]
    assert dict(windows_of(slow).left_out)["orders"] == (
        "0normal, window 1: 3.0 turns in 1 s, at least 8 are needed"
    )
    fast = [replace(r, turns=r.turns * 8) for r in turning(3.0)]
    assert "samples a turn, at least 20" in dict(windows_of(fast).left_out)["orders"]


def test_normal_recordings_alone_give_a_limit_that_others_keep():
    told = measured_normal.normal_only(
        windows_of(turning(3.0, 8, ("normal",)), views=("16 bands", "orders"))
    )
    assert told["normal_only"]["orders"]["false_alarms"] < 0.15
    with pytest.raises(DatasetError, match="2 groups, all 'normal': at least 3 are needed"):
        measured_normal.normal_only(windows_of(turning(3.0, 2, ("normal",))))


def test_area_under_the_curve_counts_ties_half():
    assert measured_normal.area(np.array([0.0, 1.0]), np.array([1.0, 2.0])) == 0.875


@pytest.mark.slow
def test_public_fan_recordings_by_speed(tmp_path):
    if not SHARED.is_dir():
        pytest.skip("no ../shared/data beside the repository")
    data = windows_of(read_folder(write(SHARED, "fan", tmp_path)))
    assert len(np.unique(data.recording)) == 36
    assert set(data.views) == set(VIEWS) - {"orders"}
    assert dict(data.left_out)["orders"].endswith("neither mark nor speed is known")
    every = np.arange(len(data))
    forest, network = (
        measured.balanced(data.label, measured._left_out(data, every, 0, *rung))
        for rung in (measured.FOREST, measured.RUNGS["network, 2 bands"])
    )
    assert forest > 0.75
    assert network > forest


def test_a_folder_of_ones_own_is_trained_and_judged_from_the_command_line(tmp_path, capsys):
    import csv
    import json

    import onnx

    from models import evaluate, train

    folder = tmp_path / "rig"
    folder.mkdir()
    with (folder / "recordings.csv").open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["file", "label", "group", "rate_hz", "channels"])
        for r in recordings(75.0, 3, labels=("normal", "loose")):
            np.savez(folder / f"{r.name}.npz", samples=r.samples)
            table.writerow([f"{r.name}.npz", r.label, r.group, r.rate_hz, "x y"])
    given = ["classifier", "--data", str(folder)]
    assert train.main([*given, "--smoke", "--out", str(tmp_path / "runs")]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["trained"] == "logistic regression, 2 bands"
    assert report["export_parity"] < 1e-6
    model = onnx.load(next((tmp_path / "runs").rglob("measured_model.onnx")))
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    settings = json.loads(metadata["settings"])
    assert (settings["labels"], settings["view"]) == (["loose", "normal"], "2 bands")
    assert len(settings["recordings"]) == 6
    (folder / "recordings.csv").write_text("file\n")
    assert evaluate.main([*given, "--json"]) == 2
    assert "lacks the columns label; its first line" in capsys.readouterr().err
