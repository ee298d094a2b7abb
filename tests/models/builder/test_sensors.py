"""Which features go with a sensor, and which classes are called alike, is measured."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.windows import Window
from firmware_py.config import read_machine
from models.builder.sensors import OWN_FEATURES, columns_of, told_apart
from models.diagnosis import recordings
from models.diagnosis.dataset import CLASSES
from models.diagnosis.recordings import RecordingPlan, record_build
from models.diagnosis.scores import Decisions, confused
from models.diagnosis.windowed import usable_windows


@pytest.fixture(scope="module")
def windows() -> list[Window]:
    plan = RecordingPlan("bench", 4, 5000, 1.6, recordings.watch_cases)
    return usable_windows(record_build(plan, 2)[0], "bench")[:2]


def lost(sensor: str, windows: list[Window]) -> set[str]:
    moved = columns_of(sensor, windows, read_machine("bench"))
    return {name for name, gone in zip(FEATURE_NAMES, moved, strict=True) if gone}


def test_a_sensor_takes_its_own_features_with_it(windows: list[Window]) -> None:
    acc = lost("acc_motor", windows)
    assert any("acc_motor" in name for name in acc)
    assert "log_shaft_fwd_1x_m" not in acc
    probes = lost("both displacement probes", windows)
    assert "log_shaft_fwd_1x_m" in probes
    assert "film_power_excess" in lost("shaft power reading", windows)
    assert not any("acc_" in name for name in lost("microphone", windows))


def test_some_head_rests_on_most_sensors(windows: list[Window]) -> None:
    used = OWN_FEATURES.any(axis=1)
    for sensor in ("acc_motor", "acc_bearing_vertical", "both displacement probes"):
        assert (columns_of(sensor, windows, read_machine("bench")) & used).any()


def decisions(named: dict[int, list[int]]) -> Decisions:
    """By true class the classes that were named, with certainty."""
    kind = np.repeat(list(named), [len(each) for each in named.values()])
    probability = np.full((len(kind), len(CLASSES)), 0.01)
    probability[np.arange(len(kind)), kind] = 0.02
    said = [each for row in named.values() for each in row]
    probability[np.arange(len(kind)), said] = 0.95
    severity = np.where(kind == CLASSES.index("unbalance"), 16.0, 0.0)
    n = len(kind)
    return Decisions(probability, kind, severity, np.arange(n), np.zeros((n, 3), np.intp))


def test_pairs_that_are_confused_are_named_the_worst_first() -> None:
    found = confused(decisions({0: [0] * 10, 1: [1] * 8 + [2] * 2, 2: [2] * 5 + [1] * 5}))
    assert [each["classes"] for each in found] == [[CLASSES[1], CLASSES[2]]]
    assert found[0]["balanced_accuracy"] == pytest.approx(0.65)


def test_classes_that_are_told_apart_are_no_pair() -> None:
    found = told_apart(decisions({k: [k] * 4 for k in range(len(CLASSES))}))
    assert found == {"balanced_accuracy": 1.0, "cannot_be_told_apart": []}
