"""Measured recordings: groups are left out whole, a known difference is found, the public sets score as stated."""

from pathlib import Path

import numpy as np
import pytest

from models.diagnosis import measured
from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import Measured, read_folder
from models.diagnosis.public_recordings import write

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def recordings(shift=40.0, groups=4, n=800):
    """Two labels that differ in the frequency of a ringing; every group has its own level."""
    rng = np.random.default_rng(0)
    found = []
    for group in range(groups):
        for label in ("a", "b"):
            time = np.arange(n) / 200.0
            tone = np.sin(2 * np.pi * ((40.0 if label == "a" else shift) * time[:, None] + rng.random(2)))
            samples = (1 + group) * (tone + 0.3 * rng.normal(size=(n, 2)))
            found.append(Measured(f"{group}{label}", samples, 200.0, ("x", "y"), label, f"g{group}"))
    return found


def test_a_shifted_ringing_is_told_and_nothing_is_not():
    told = measured.evaluate(measured.windows_of(recordings(55.0)))
    assert told["logistic regression, spectra"]["balanced_accuracy"] > 0.8
    assert told["majority_share"] == 0.5
    none = measured.evaluate(measured.windows_of(recordings(40.0)))
    assert none["logistic regression, spectra"]["balanced_accuracy"] < 0.8


def test_no_group_is_on_both_sides():
    data = measured.windows_of(recordings())
    for train, test in measured._folds(data):
        assert not set(data.group[train]) & set(data.group[test])
        assert not set(data.recording[train]) & set(data.recording[test])


def test_classes_that_one_group_alone_holds_are_not_scored():
    data = measured.windows_of([r for r in recordings(55.0) if r.label == "a" or r.group == "g0"])
    assert measured.evaluate(data)["windows"] == np.sum(data.label == 0)
    alone = measured.windows_of([r for r in recordings(55.0, groups=2) if (r.label == "a") == (r.group == "g0")])
    with pytest.raises(DatasetError, match="choose another group"):
        measured.evaluate(alone)


def test_paired_interval_of_equal_answers_is_zero():
    data = measured.windows_of(recordings())
    rows = np.arange(len(data.label))
    assert measured.paired_interval(data, rows, data.label, data.label) == (0.0, 0.0)
    low, high = measured.paired_interval(data, rows, data.label, 1 - data.label)
    assert low > 0.5
    assert high <= 1.5


@pytest.mark.slow
def test_public_fan_recordings_by_speed(tmp_path):
    if not SHARED.is_dir():
        pytest.skip("no ../shared/data beside the repository")
    found = read_folder(write(SHARED, "fan", tmp_path))
    report = measured.evaluate(measured.windows_of(found))
    assert report["recordings"] == 36
    forest, regression = (report[name]["balanced_accuracy"]
                          for name in ("random forest, band energies", "logistic regression, spectra"))
    assert forest > 0.75
    assert 0.5 < regression < forest  # measured: the simple features win on this rig
