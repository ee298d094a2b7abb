"""Dataset folders: what a user may bring, and every refusal with its place and next step."""

import csv

import numpy as np
import pytest

from models.diagnosis.dataset import DatasetError
from models.diagnosis.dataset_folder import read_folder

COLUMNS = ("file", "label", "group", "rate_hz", "channels", "build")


def folder(path, rows=None, **changed):
    """Four recordings of two labels and groups; ``changed`` replaces entries of the second row."""
    rng = np.random.default_rng(0)
    if rows is None:
        rows = [
            [f"{i}.npz", ("a", "b")[i % 2], f"g{i // 2}", "100", "x y", f"b{i % 2}"]
            for i in range(4)
        ]
    for name, value in changed.items():
        rows[1][COLUMNS.index(name)] = value
    with (path / "recordings.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([COLUMNS, *rows])
    for i in range(4):
        np.savez(path / f"{i}.npz", samples=rng.normal(size=(400, 2)))
    return path


def refusal(path, match, group="group"):
    with pytest.raises(DatasetError, match=match):
        read_folder(path, group)


def test_whole_folder_is_read(tmp_path):
    found = read_folder(folder(tmp_path))
    assert [r.label for r in found] == ["a", "b", "a", "b"]
    assert found[0].samples.shape == (400, 2)
    assert found[0].channels == ("x", "y")
    assert [r.group for r in read_folder(tmp_path, "build")] == ["b0", "b1", "b0", "b1"]


def test_text_files_are_read(tmp_path):
    folder(tmp_path, file="1.csv")
    np.savetxt(tmp_path / "1.csv", np.ones((100, 2)), delimiter=",", header="x,y", comments="")
    assert read_folder(tmp_path)[1].samples.shape == (100, 2)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"label": ""}, r"recordings.csv:3: label is empty"),
        ({"rate_hz": "fast"}, r"recordings.csv:3: rate_hz = fast: not a sampling rate"),
        ({"rate_hz": "50"}, r"1.npz: rate_hz = 50.0, most recordings have 100.0"),
        ({"channels": "x"}, r"shape \(400, 2\), the table names 1 channels"),
        ({"channels": "x z"}, r"1.npz: channels"),
        ({"file": "9.npz"}, r"recordings.csv:3: .*9.npz cannot be read"),
        ({"file": "1.wav"}, r"neither .npz nor .csv"),
        ({"file": "0.npz"}, r"0.npz: stands 2 times"),
        ({"label": "c"}, r"label c has 1 recording"),
        (
            {"label": "B "},
            r"1.npz: label 'B', another recording has 'b'|3.npz: label 'b', another recording "
            r"has 'B'",
        ),
        ({"group": "G0"}, r"1.npz: group 'G0', another recording has 'g0': spell them alike"),
    ],
)
def test_bad_entries_are_refused(tmp_path, changed, match):
    refusal(folder(tmp_path, **changed), match)


def test_empty_and_missing_tables_are_refused(tmp_path):
    refusal(tmp_path, "cannot be read")
    refusal(folder(tmp_path, rows=[]), "names no recording")
    (tmp_path / "recordings.csv").write_text("file,label\n")
    refusal(tmp_path, "lacks the columns group, rate_hz, channels")
    refusal(folder(tmp_path), "lacks the columns session", "session")


def test_nan_and_short_recordings_are_refused(tmp_path):
    folder(tmp_path)
    np.savez(tmp_path / "2.npz", samples=np.where(np.arange(800).reshape(400, 2) == 7, np.nan, 1.0))
    refusal(tmp_path, r"2.npz: 1 samples are not finite, the first in row 3, channel y")
    np.savez(tmp_path / "2.npz", samples=np.ones((10, 2)))
    refusal(tmp_path, "has 10 samples, at least 64")


def test_numbers_that_are_one_are_one_group(tmp_path):
    rows = [
        [f"{i}.npz", ("a", "b")[i % 2], ("20", "20.0", "30", "30")[i], "100", "x y", "b0"]
        for i in range(4)
    ]
    refusal(folder(tmp_path, rows), r"1.npz: group '20.0', another recording has '20'")


def test_a_copy_is_refused_with_the_name_of_its_original(tmp_path):
    folder(tmp_path)
    np.savez(tmp_path / "3.npz", samples=np.load(tmp_path / "0.npz")["samples"])
    refusal(tmp_path, r"3.npz: the same samples as 0.npz \(label a, group g0\); keep one")


def test_one_label_and_one_group_are_refused(tmp_path):
    rows = [[f"{i}.npz", "a", f"g{i}", "100", "x y", "b0"] for i in range(4)]
    refusal(folder(tmp_path, rows), "only one label")
    refusal(folder(tmp_path), r"nothing can be left out", "rate_hz")
