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
    values = np.random.default_rng(1).normal(size=(100, 2))
    np.savetxt(tmp_path / "1.csv", values, delimiter=",", header="x,y", comments="")
    assert np.array_equal(read_folder(tmp_path)[1].samples, values)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"label": ""}, r"recordings.csv:3: label is empty"),
        ({"rate_hz": "fast"}, r"recordings.csv:3: rate_hz = fast: not a sampling rate"),
        ({"rate_hz": "50"}, r"1.npz: rate_hz = 50.0, most recordings have 100.0"),
        (
            {"channels": "x"},
            r"1.npz: 2 columns of signals \(column 1, column 2\), the table names 1",
        ),
        ({"channels": "x z"}, r"1.npz: channels"),
        ({"file": "9.npz"}, r"recordings.csv:3: .*9.npz: no such file; correct its name"),
        ({"file": "1.wav"}, r"recordings.csv:3: .*1.wav: no such file"),
        (
            {"file": "recordings.xls"},
            r"recordings.csv:3: recordings.xls: no reader for '.xls'; save",
        ),
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
    refusal(tmp_path / "nowhere", "no such folder")
    refusal(tmp_path, "no recording in it")
    np.savez(tmp_path / "0.npz", samples=np.zeros((100, 2)))
    refusal(tmp_path, r"0.npz lies in no subfolder, so its class is not known; `orbitd dataset")
    refusal(folder(tmp_path, rows=[]), "names no recording")
    (tmp_path / "recordings.csv").write_text("file;rate_hz\n")
    refusal(tmp_path, "lacks the columns label; its first line names file, rate_hz")
    refusal(folder(tmp_path), "lacks the columns session", "session")


def test_everything_wrong_is_named_at_once(tmp_path):
    folder(tmp_path)
    noise = np.random.default_rng(0).normal(size=800).reshape(400, 2)
    np.savez(
        tmp_path / "2.npz", samples=np.where(np.arange(800).reshape(400, 2) == 7, np.nan, noise)
    )
    np.savez(tmp_path / "3.npz", samples=noise[:10])
    np.savez(tmp_path / "0.npz", samples=noise * [0.0, 1.0])
    with pytest.raises(DatasetError) as caught:
        read_folder(tmp_path)
    text = str(caught.value)
    assert text.startswith("3 problems:")
    assert "recordings.csv:2: 0.npz: column 1 (x): never moves" in text
    assert "recordings.csv:4: 2.npz: column 2 (y), sample 3: missing or no number" in text
    assert "recordings.csv:5: 3.npz has 10 samples, at least 64" in text


def test_subfolders_are_labels_and_every_file_its_own_group(tmp_path):
    rng = np.random.default_rng(0)
    for label in ("normal", "loose"):
        (tmp_path / label).mkdir()
        for i in range(2):
            text = [
                "t;ax;ay",
                *(
                    f"{k / 100:.2f};{a:.5f};{b:.5f}".replace(".", ",")
                    for k, (a, b) in enumerate(rng.normal(size=(200, 2)))
                ),
            ]
            (tmp_path / label / f"{i}.CSV").write_text("\n".join(text))
    found = read_folder(tmp_path)
    assert [(r.label, r.group) for r in found] == [
        (label, f"{label}/{i}.CSV") for label in ("loose", "normal") for i in range(2)
    ]
    assert found[0].rate_hz == 100.0
    assert found[0].channels == ("ax", "ay")


def test_a_table_as_a_spreadsheet_writes_it(tmp_path):
    folder(tmp_path)
    (tmp_path / "recordings.csv").write_text(
        "\ufeffFile;Label;Rate_Hz;Start_s;End_s\n"
        "0.npz;a;100,0;0,5;1,5\n0.npz;a;100;2;\n1.npz;b;100;;\n2.npz;b;100;;\n",
        encoding="utf-8",
    )
    found = read_folder(tmp_path)
    assert [len(r.samples) for r in found] == [100, 200, 400, 400]
    assert found[0].group == found[1].group == "0.npz"


def test_parts_of_one_file_stay_on_one_side(tmp_path):
    rows = [["0.npz", "a", f"g{i}", "100", str(2 * i), str(2 * i + 2)] for i in range(2)]
    folder(tmp_path)
    text = "\n".join(",".join(row) for row in rows)
    (tmp_path / "recordings.csv").write_text(f"file,label,group,rate_hz,start_s,end_s\n{text}\n")
    refusal(tmp_path, r"0.npz: parts of it stand in the groups g0 and g1, on both sides")


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
    normal = [[f"{i}.npz", "Normal", f"g{i}", "100", "x y", "b0"] for i in range(4)]
    assert {r.label for r in read_folder(folder(tmp_path, normal))} == {"normal"}
    refusal(folder(tmp_path), r"nothing can be left out", "rate_hz")
