"""``orbitd dataset``: from somebody's folder of text files to one that can be trained on."""

import json
import tomllib

import numpy as np
import pytest

from models.diagnosis.dataset_command import main


@pytest.fixture
def folder(tmp_path):
    """Files of a logger with a German head, all in one folder."""
    rng = np.random.default_rng(0)
    for name in ("Normal 1", "Normal 2", "Unwucht 1", "Unwucht 2"):
        head = ["Prüfstand 3", "Zeit [ms];KANAL A [g];KANAL B [g];Drehzahl [1/min]"]
        rows = [
            f"{k / 2:.1f};{a:.4f};{b:.4f};1500,0".replace(".", ",")
            for k, (a, b) in enumerate(rng.normal(size=(300, 2)))
        ]
        (tmp_path / f"{name}.csv").write_text("\r\n".join([*head, *rows]), encoding="cp1252")
    return tmp_path


def test_a_folder_without_a_table_gets_drafts_that_can_be_used(folder, capsys):
    assert main([str(folder)]) == 2
    assert "`orbitd dataset" in capsys.readouterr().err
    assert main([str(folder), "--write"]) == 0
    said = capsys.readouterr().out
    assert "recordings.csv: written" in said
    assert "channels.toml: written" in said
    plan = tomllib.loads((folder / "channels.toml").read_text(encoding="utf-8"))
    assert plan["time"] == {"column": "Zeit", "unit": "ms"}
    assert plan["speed"] == {"column": "Drehzahl", "unit": "1/min"}
    assert [row["column"] for row in plan["channel"]] == ["KANAL A", "KANAL B"]
    assert main([str(folder), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    rows = said["recordings"]
    assert said["problems"] == []
    assert "give --window-s 0.15" in rows[0]["notes"]
    assert [row["label"] for row in rows] == ["normal", "normal", "Unwucht", "Unwucht"]
    assert rows[0]["channels"] == "KANAL A (m/s2), KANAL B (m/s2)"
    assert rows[0]["rate_hz"] == 2000.0
    assert rows[0]["turns"] == pytest.approx(3.7)


def test_what_is_there_is_left_as_it_is(folder, capsys):
    (folder / "channels.toml").write_text("[file]\nresample_hz = 1000\n")
    assert main([str(folder), "--write"]) == 0
    assert "channels.toml: is there already, left as it is" in capsys.readouterr().out
    assert main([str(folder)]) == 0
    assert "1000.0" in capsys.readouterr().out


def test_what_can_be_read_is_shown_beside_what_cannot(folder, capsys):
    main([str(folder), "--write"])
    path = folder / "Unwucht 2.csv"
    text = path.read_text(encoding="cp1252").splitlines()
    text[10] = text[10].replace(";", ";Überlauf", 1)
    path.write_text("\n".join(text), encoding="cp1252")
    assert main([str(folder)]) == 2
    said = capsys.readouterr()
    assert "Unwucht 1.csv" in said.out
    assert "Unwucht 2.csv" not in said.out
    assert "recordings.csv:5: Unwucht 2.csv: line 11, KANAL A: 'Überlauf" in said.err


def test_a_first_file_that_cannot_be_read_is_named_in_the_draft(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("nothing here\n" * 9)
    assert main([str(tmp_path), "--write"]) == 0
    draft = (tmp_path / "channels.toml").read_text()
    assert "could not be read as it is:" in draft
    assert "line 5: no row of numbers" in draft
    assert "file" in tomllib.loads(draft)


def test_every_fault_of_a_file_is_named_with_those_between_files(folder, capsys):
    main([str(folder), "--write"])
    (folder / "channels.toml").unlink()
    path = folder / "Unwucht 2.csv"
    lines = path.read_text(encoding="cp1252").splitlines()
    lines[1] = lines[1].replace("KANAL A [g]", "KANAL A [furlong]")
    for k in range(2, len(lines)):
        cells = lines[k].split(";")
        lines[k] = ";".join([cells[0], "" if k == 20 else cells[1], "1,0", cells[3]])
    path.write_text("\n".join(lines), encoding="cp1252")
    (folder / "Normal 2.csv").write_bytes((folder / "Normal 1.csv").read_bytes())
    capsys.readouterr()
    assert main([str(folder), "--json"]) == 2
    said = json.loads(capsys.readouterr().out)
    text = "\n".join(said["problems"])
    assert [row["recording"] for row in said["recordings"]] == [
        "Normal 1.csv", "Normal 2.csv", "Unwucht 1.csv",
    ]  # fmt: skip
    assert "recordings.csv:5: Unwucht 2.csv: line 21, KANAL A: missing" in text
    assert "KANAL A: unit 'furlong' is not known" in text
    assert "KANAL B: never moves" in text
    assert "Normal 2.csv: the same samples as Normal 1.csv" in text


def test_the_name_of_a_file_stands_once_where_its_place_is_told(tmp_path, capsys):
    for label in ("good", "bad"):
        (tmp_path / label).mkdir()
        for k in range(2):
            (tmp_path / label / f"{k}.csv").write_text("a,b\n" + "1,2\n" * 400)
    assert main([str(tmp_path)]) == 2
    line = next(
        x for x in capsys.readouterr().err.splitlines() if "bad/0.csv" in x.replace("\\", "/")
    )
    assert line.count("0.csv") == 1
