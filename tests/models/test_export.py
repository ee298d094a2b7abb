"""Metadata, manifest and settings."""

import hashlib
import json

import pytest

from firmware_py.brain.made_for import figures_of
from firmware_py.brain.store import read_card
from firmware_py.config import read_machine
from models import ARTIFACTS

FIELDS = {
    "kind",
    "version",
    "status",
    "channels",
    "units",
    "rate_hz",
    "window",
    "inputs",
    "outputs",
    "domain",
    "rigs",
    "physics_version",
    "data_hash",
    "commit",
    "metrics",
}


def test_manifest_names_every_shipped_model_with_its_hash():
    manifest = json.loads((ARTIFACTS / "manifest.json").read_text())
    assert set(manifest["files"]) == {path.name for path in ARTIFACTS.glob("*.onnx")} | {
        "predictor.json"
    }
    for name, entry in manifest["files"].items():
        assert entry["sha256"] == hashlib.sha256((ARTIFACTS / name).read_bytes()).hexdigest()
        assert entry["bytes"] == (ARTIFACTS / name).stat().st_size


@pytest.mark.parametrize("path", sorted(ARTIFACTS.glob("*.onnx")), ids=lambda p: p.stem)
def test_shipped_model_is_whole_and_says_what_it_is(path, tmp_path):
    import onnxruntime

    alone = tmp_path / path.name
    alone.write_bytes(path.read_bytes())
    session = onnxruntime.InferenceSession(alone, providers=["CPUExecutionProvider"])
    metadata = session.get_modelmeta().custom_metadata_map
    assert set(metadata) >= FIELDS
    assert metadata["status"] in {"provisional", "qualified"}
    assert json.loads(metadata["inputs"])
    assert len(json.loads(metadata["inputs"])) == session.get_inputs()[0].shape[1]
    assert json.loads(metadata["metrics"])["reproduce"].startswith("orbitd train ")
    assert str(ARTIFACTS.parents[1]).encode() not in path.read_bytes(), (
        "a path of the training machine"
    )


@pytest.mark.slow
def test_a_card_carries_the_figures_of_the_machines_that_it_was_made_for():
    from models import export

    about = export.Metadata("actor", "0", ("a",), ("y",), {}, ("bench", "seed"), "", {}, ())
    card = read_card("actor.onnx", about.properties())
    bench, seed = (read_machine(name) for name in ("bench", "seed"))
    assert card.made_for == {"bench": figures_of(bench), "seed": figures_of(seed)}
    assert card.machines is not None


@pytest.mark.slow
def test_metadata_of_another_width_is_refused(tmp_path):
    import torch

    from models import export

    metadata = export.Metadata("actor", "0", ("a", "b"), ("y",), {}, (), "", {}, ())
    with pytest.raises(export.ExportError, match="names 2 inputs, the graph takes 3"):
        export.export(
            torch.nn.Linear(3, 1),
            torch.zeros(1, 3),
            tmp_path / "m.onnx",
            input_name="x",
            output_names=("y",),
            metadata=metadata,
        )
    assert not list(tmp_path.iterdir())
