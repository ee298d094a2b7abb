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
    rows = json.loads(capsys.readouterr().out)
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
