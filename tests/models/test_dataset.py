"""Datasets: what is refused, and that splits keep groups apart."""

import numpy as np
import pytest

from firmware_py.acquire.features import FEATURE_NAMES
from models.diagnosis.dataset import (
    CLASSES,
    HEADS_OF_CLASS,
    Dataset,
    DatasetError,
    check_disjoint,
    join,
    pooled,
    split_groups,
)


def dataset(kinds=(0, 0, 1, 1, 4, 4), windows=3):
    n = len(kinds) * windows
    rng = np.random.default_rng(0)
    of_window = np.repeat(np.arange(len(kinds)), windows)
    return Dataset(
        rng.normal(size=(n, len(FEATURE_NAMES))),
        np.array(kinds)[of_window],
        np.full(n, 25.0),
        of_window // 2,
        of_window,
        np.zeros(n, int),
        np.zeros(n, int),
        np.zeros(n, bool),
    )


def changed(data, **columns):
    return Dataset(
        **{name: columns.get(name, getattr(data, name)) for name in data.__dataclass_fields__}
    )


def test_whole_data_passes():
    dataset().check()


def test_empty_data_is_refused():
    with pytest.raises(DatasetError, match="empty"):
        dataset().subset(np.zeros(18, bool)).check()


def test_nan_is_refused_with_its_feature_and_recording():
    data = dataset()
    data.features[7, 2] = np.nan
    with pytest.raises(DatasetError, match=rf"{FEATURE_NAMES[2]} in recording 2"):
        data.check()


def test_unknown_label_is_refused():
    with pytest.raises(DatasetError, match="class label outside"):
        dataset(kinds=(0, 0, 6, 6)).check()


def test_class_with_one_recording_is_refused():
    with pytest.raises(DatasetError, match=r"unbalance has 1 recording"):
        dataset(kinds=(0, 0, 4)).check()


def test_labels_of_another_length_are_refused():
    data = dataset()
    with pytest.raises(DatasetError, match="differ in length"):
        changed(data, severity=data.severity[:-1]).check()


def test_group_on_both_sides_is_refused():
    data = dataset()
    with pytest.raises(DatasetError, match="both sides"):
        check_disjoint(data, data.subset(data.group == 1))


def test_split_keeps_every_group_whole_and_every_window():
    data = join([dataset(), changed(dataset(), group=dataset().group + 10)])
    first, second = split_groups(data, 0.4, np.random.default_rng(1))
    assert not set(first.group) & set(second.group)
    assert len(first) + len(second) == len(data)
    assert len(np.unique(second.group)) == 2


def test_classes_are_those_of_the_reference():
    reference = {
        "normal": [],
        "pedestal_bolt_loose": ["A"],
        "pedestal_two_bolts_loose": ["A", "B"],
        "motor_bolt_loose": ["motor"],
        "unbalance": ["unbalance"],
        "pedestal_and_motor_bolt_loose": ["A", "motor"],
    }
    assert tuple(reference) == CLASSES
    short = ["A", "B", "motor", "unbalance"]
    for row, heads in zip(HEADS_OF_CLASS, reference.values(), strict=True):
        assert [name for name, on in zip(short, row, strict=True) if on] == heads


def test_decisions_are_means_over_windows_of_one_recording():
    data = dataset(kinds=(0, 1), windows=13)
    rows = pooled(data, 10)
    assert list(rows.recording) == [0, 1]
    np.testing.assert_allclose(rows.features[1], data.features[13:23].mean(axis=0))
    assert len(pooled(data, 10, 1)) == 8


def test_short_recordings_decide_when_they_hold_half_the_windows():
    assert len(pooled(dataset(kinds=(0, 1), windows=5), 10)) == 2
    assert len(pooled(dataset(kinds=(0, 1), windows=4), 10)) == 0
