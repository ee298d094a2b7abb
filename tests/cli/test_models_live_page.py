"""The page on models that come live: each command is run, in the order of the page."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from firmware_py import cli, config, launch
from firmware_py.brain.library import ShelfLibrary
from firmware_py.model_sets.manifest import fingerprint
from tests.brain.onnx_models import actor, classifier

PAGE = Path(__file__).resolve().parents[2] / "docs/models_live.md"


def test_the_page_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))
    (tmp_path / "candidate").mkdir()
    (tmp_path / "candidate" / "actor.onnx").write_bytes(actor(7e-5))
    (tmp_path / "candidate" / "classifier.onnx").write_bytes(classifier())
    said: dict[str, str] = {}
    commands = re.findall(r"^ {4,6}(orbitd [^\n]+)$", PAGE.read_text(), re.M)
    for number, text in enumerate(commands):
        assert cli.main(text.split()[1:]) == 0, (text, capsys.readouterr())
        out = capsys.readouterr()
        assert out.err == "", text
        said[f"{number} {text}"] = out.out
    assert len(commands) >= 16
    words = list(said.values())
    assert "in use      generation 0: own" in words[1]
    assert "nothing runs beside" not in words[4]
    assert "generation 1" in words[6]
    assert "unsigned" in words[6]
    key = tmp_path / "xdg_config_home/orbitd/keys/workshop.key"
    assert key.stat().st_mode & 0o777 == 0o600
    assert cli.main(["keys", "list", "--rig", "my_rig", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert {name: row["trusted"] for name, row in rows.items()} == {
        "workshop": False,
        "workshop2": True,
    }
    loaded = config.load(tmp_path / "my_rig")[0]
    assert loaded.models.public_keys == [rows["workshop2"]["public"]]
    library = ShelfLibrary(loaded, launch.shelf_folder(loaded, tmp_path / "state_directory"))
    shelf = sorted((library.folder / "sets").iterdir())
    models = library.load([shelf[0].name])
    assert models.actor is not None
    assert models.actor.vouched_by == f"key {fingerprint(rows['workshop2']['public'])}"


def test_what_is_not_signed_by_a_trusted_key_is_refused_and_a_shipped_rig_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name.lower()))

    def refused(*arguments: str) -> str:
        assert cli.main(list(arguments)) == 1
        return capsys.readouterr().err

    (tmp_path / "candidate").mkdir()
    (tmp_path / "candidate" / "actor.onnx").write_bytes(actor(7e-5))
    for text in ("rig new my_rig --from bench", "keys new a", "keys new b",
                 "keys trust a --rig my_rig", "keys sign candidate --key b"):  # fmt: skip
        assert cli.main(text.split()) == 0, text
    add = ["models", "add", "candidate", "--rig", "my_rig"]
    assert "signed by none of the 1 models.public_keys" in refused(*add)
    (tmp_path / "candidate" / "manifest.json.sig").unlink()
    assert "unsigned, and a signature is required" in refused(*add)
    assert "nothing was overwritten" in refused("keys", "new", "a")
    assert "no name for a key" in refused("keys", "new", "../a")
    assert "there are: a, b" in refused("keys", "sign", "candidate", "--key", "c")
    assert "not among the trusted keys" in refused("keys", "revoke", "b", "--rig", "my_rig")
    assert "not the base64 of a public key" in refused("keys", "trust", "xx", "--rig", "my_rig")
    assert "the package's own rig" in refused("keys", "trust", "a", "--rig", "bench")
    key = tmp_path / "xdg_config_home/orbitd/keys/a.key"
    key.chmod(0o640)
    assert "others may read it" in refused("keys", "sign", "candidate", "--key", "a")
    shutil.copy(tmp_path / "candidate" / "actor.onnx", key)
    key.chmod(0o600)
    assert "no private key" in refused("keys", "sign", "candidate", "--key", "a")
