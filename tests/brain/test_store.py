"""The store uses a model only when its bytes are vouched for and it fits; every refusal has its
name."""

from __future__ import annotations

import base64
import hashlib
import json
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from onnx import TensorProto, helper

from firmware_py.brain import made_for, store, trust
from firmware_py.brain.errors import (
    ModelAnswerError,
    ModelError,
    ModelMissingError,
    ModelTrustError,
    ModelUnfitError,
)
from firmware_py.brain.intervals import FactorsCard
from firmware_py.brain.session import Session
from firmware_py.config import SHIPPED, Config, load

from .machine import CONFIG
from .onnx_models import actor, classifier, short_film

PREDICTOR = store.SHIPPED / "predictor.json"

KEY = Ed25519PrivateKey.generate()
OTHER = Ed25519PrivateKey.generate()


def public(key: Ed25519PrivateKey | ec.EllipticCurvePrivateKey) -> str:
    der = key.public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return base64.b64encode(der).decode()


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package's folder with three models and their manifest."""
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    for kind, data in (
        ("classifier", classifier()),
        ("actor", actor(8e-5)),
        ("surrogate", short_film()),
    ):
        put(tmp_path, kind, data)
    return tmp_path


def put(folder: Path, kind: str, data: bytes) -> None:
    vouched(folder / f"{kind}.onnx", data)


def vouched(file: Path, data: bytes) -> None:
    file.write_bytes(data)
    folder = file.parent
    files = {
        path.name: {
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "bytes": path.stat().st_size,
        }
        for path in [*folder.glob("*.onnx"), *folder.glob("predictor.json")]
    }
    (folder / "manifest.json").write_text(json.dumps({"schema": 1, "files": files}))


def with_models(**changed: object) -> Config:
    return CONFIG.replaced(models=msgspec.structs.replace(CONFIG.models, **changed))


def refusal(kind: str, config: Config = CONFIG) -> tuple[type[ModelError], str]:
    with pytest.raises(ModelError) as caught:
        store.load_model(kind, config)
    return type(caught.value), str(caught.value)


def test_a_rate_without_the_features_of_the_diagnosis_has_no_classifier(shipped: Path) -> None:
    sampling = msgspec.structs.replace(CONFIG.sampling, rate_hz=2500)
    text = refusal("classifier", CONFIG.replaced(sampling=sampling))[1]
    assert "features are defined at multiples of 5000 Hz, the configuration samples at 2500" in text


def test_three_good_models(shipped: Path) -> None:
    models = store.load_models(CONFIG)
    assert models.refusals == {}
    assert models.surrogate is not None
    digest = hashlib.sha256((shipped / "surrogate.onnx").read_bytes()).hexdigest()
    assert models.surrogate.sha256 == digest
    assert models.surrogate.label == f"surrogate 0 provisional {digest[:12]}"
    assert not models.surrogate.qualified


def test_missing(shipped: Path) -> None:
    (shipped / "actor.onnx").unlink()
    kind, text = refusal("actor")
    assert kind is ModelMissingError
    assert "actor.onnx: cannot be read (No such file" in text
    models = store.load_models(CONFIG)
    assert models.actor is None
    assert list(models.refusals) == ["actor"]


def test_truncated_and_tampered(shipped: Path) -> None:
    path = shipped / "surrogate.onnx"
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    assert refusal("surrogate")[0] is ModelTrustError
    assert f"the manifest says {len(whole)}" in refusal("surrogate")[1]
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    kind, text = refusal("surrogate")
    assert kind is ModelTrustError
    assert "changed after packaging" in text


def test_manifest_missing_entry_or_broken(shipped: Path) -> None:
    (shipped / "manifest.json").write_text("{}")
    assert refusal("actor")[0] is ModelTrustError
    (shipped / "manifest.json").write_text("no json")
    assert refusal("actor")[0] is ModelTrustError
    (shipped / "manifest.json").unlink()
    assert refusal("actor")[0] is ModelTrustError


@pytest.mark.parametrize("data", [b"", b"not onnx", b"\x08" * 200])
def test_not_a_model(shipped: Path, data: bytes) -> None:
    put(shipped, "actor", data)
    kind, text = refusal("actor")
    assert kind is ModelUnfitError
    assert "export it again" in text


def test_too_large(shipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust, "MAX_BYTES", 1000)
    assert refusal("surrogate")[0] is ModelUnfitError


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"kind": "actor"}, "kind 'actor', expected 'classifier'"),
        (
            {"rigs": '["seed"]'},
            "made for 'seed': bearing.radial_clearance_um 50 .. 95, here 40 .. 160 (at most 1 "
            "beyond), lubricant.viscosity_at_40C_Pa_s 0.00067, here 0.01 (within 10 %)",
        ),
        ({"rigs": '["elsewhere"]'}, "its card says of no machine that it was made for it"),
        ({"rate_hz": "[10000]"}, "rate_hz [10000], the configuration samples at 5000"),
        ({"window": '{"turns": 16.0}'}, "window {'turns': 16.0}"),
        ({"channels": '["disp_y", "disp_x"]'}, "channels [0] = 'disp_y', expected 'disp_x'"),
        ({"inputs": '["a"]'}, "inputs [0] = 'a'"),
        ({"inputs": "[]"}, "inputs has 0 names"),
        ({"physics_version": "7"}, "physics_version '7'"),
        ({"settings": "{}"}, "settings lack novelty_threshold"),
        ({"status": "wonderful"}, "metadata: Invalid enum value 'wonderful'"),
        ({"data_hash": ""}, "metadata: Object missing required field `data_hash`"),
        ({"rigs": "bench"}, "metadata: "),
        (
            {"rigs": '["seed"]', "rate_hz": "[1]"},
            "rate_hz [1], the configuration samples at 5000; made for 'seed'",
        ),
    ],
)
def test_ill_fitting(shipped: Path, changed: dict[str, str], words: str) -> None:
    put(shipped, "classifier", classifier(**changed))
    kind, text = refusal("classifier")
    assert kind is ModelUnfitError
    assert words in text
    assert text.startswith("classifier.onnx: ")


def test_a_surrogate_of_another_bearing(shipped: Path) -> None:
    put(shipped, "surrogate", short_film(domain='{"length_over_diameter": [1.0, 1.0]}'))
    text = refusal("surrogate")[1]
    assert "domain length_over_diameter 1 .. 1, here 0.5 .. 0.5" in text


def changed(table: str, **figures: object) -> Config:
    """The bench with other figures in one table of its machine."""
    return CONFIG.replaced(
        **{table: msgspec.structs.replace(getattr(CONFIG.machine, table), **figures)}
    )


def test_the_machines_values_count_not_its_name(tmp_path: Path) -> None:
    """The files that ship, on a rig folder that was copied under another name, and on a bench whose
    shaft is not the bench's."""
    mill = tmp_path / "mill"
    shutil.copytree(SHIPPED / "bench", mill)
    for file in ("machine.toml", "device.toml"):
        text = (mill / file).read_text()
        (mill / file).write_text(text.replace('= "bench"', '= "mill"'))
    config = load(mill)[0]
    assert config.device.rig == config.machine.name == "mill"
    models = store.load_models(config)
    assert models.refusals == {}
    assert None not in (models.classifier, models.actor, models.surrogate)
    assert store.load_models(changed("bearing", journal_radius_m=0.03)).refusals == {
        kind: f"{kind}.onnx: {reason}: use a model made for this configuration"
        for kind, reason in (
            ("classifier", RADIUS),
            ("actor", RADIUS),
            ("surrogate", "domain length_over_diameter 0.5 .. 0.5, here 0.333333 .. 0.333333"),
        )
    } | {
        "predictor": f"predictor.json: {RADIUS}: the forecasts' intervals are the Gaussian's; fit "
        "it for this machine with `orbitd train predictor`"
    }


def test_the_factors_of_the_intervals_are_matched_by_values(shipped: Path) -> None:
    """Their card carries the bench; one without a card counts as made for it; other physics has
    none."""
    path = store.SHIPPED / "predictor.json"
    card = msgspec.json.decode(PREDICTOR.read_bytes(), type=FactorsCard)
    assert (card.kind, card.status, card.rigs) == ("predictor", "qualified", ("bench",))
    assert made_for.misfit("predictor", card.made_for, CONFIG.machine) == ""
    other = changed("bearing", journal_radius_m=0.03)
    for machines in (card.machines, None):
        text = {"factors": {}, "physics_version": "2", "machines": machines}
        vouched(path, msgspec.json.encode(text))
        assert store.load_factors(CONFIG).factors == {}
        with pytest.raises(ModelUnfitError, match=r"predictor\.json: made for 'bench'"):
            store.load_factors(other)
    vouched(path, b'{"physics_version": "9", "kind": "actor"}')
    with pytest.raises(ModelUnfitError, match=r"kind 'actor'.*physics_version '9'"):
        store.load_factors(CONFIG)


RADIUS = "made for 'bench': bearing.journal_radius_m 0.02, here 0.03 (within 2 %)"


def moved(row: made_for.Row, by: float) -> made_for.Figure:
    """What a card would say of the bench, ``by`` tolerances of ``row`` away."""
    figure = made_for.figures_of(CONFIG.machine)[row.key]
    if isinstance(figure, tuple):
        return (figure[0] + by * row.tolerance, figure[1])
    assert isinstance(figure, float)
    return figure / (1.0 + by * row.tolerance)


@pytest.mark.parametrize("row", made_for.ROWS, ids=lambda row: row.key)
def test_each_figure_has_its_tolerance(row: made_for.Row) -> None:
    own = made_for.figures_of(CONFIG.machine)
    for kind in ("classifier", "actor", "predictor", "surrogate"):
        near, far = ({"it": own | {row.key: moved(row, by)}} for by in (0.98, 1.02))
        assert made_for.misfit(kind, near, CONFIG.machine) == ""
        text = made_for.misfit(kind, far, CONFIG.machine)
        assert text.startswith(f"made for 'it': {row.key} ") if kind in row.kinds else text == ""
        silent = {"it": {key: value for key, value in own.items() if key != row.key}}
        lacks = f"made for 'it': its card lacks {row.key}" if kind in row.kinds else ""
        assert made_for.misfit(kind, silent, CONFIG.machine) == lacks


def test_the_most_alike_of_several_machines_is_told() -> None:
    machines = made_for.machines_of(["seed", "bench"])
    assert made_for.misfit("actor", machines, CONFIG.machine) == ""
    text = made_for.misfit("actor", machines, changed("bearing", length_m=0.03).machine)
    assert text == "made for 'bench': bearing.length_m 0.02, here 0.03 (within 2 %)"


def test_a_channel_that_shows_something_else(shipped: Path) -> None:
    first, *others = CONFIG.machine.channel
    turned = CONFIG.replaced(channel=[msgspec.structs.replace(first, angle_deg=0.0), *others])
    assert (
        "channel.disp_x displacement, m, 45 deg, here displacement, m, 0 deg (exact)"
        in refusal("classifier", turned)[1]
    )
    assert store.load_model("actor", turned).card.kind == "actor"


def test_a_card_with_figures_needs_no_shipped_rig(shipped: Path) -> None:
    figures = made_for.figures_of(changed("rotor", mass_kg=9.0).machine)
    put(shipped, "actor", actor(8e-5, rigs="[]", machines=json.dumps({"mill": figures})))
    assert (
        "made for 'mill': rotor.mass_at_bearing_kg 2.49, here 1.74 (within 10 %)"
        in refusal("actor")[1]
    )
    assert store.load_model("actor", changed("rotor", mass_kg=9.3)).card.kind == "actor"


def test_a_range_beyond_the_domain_is_refused(shipped: Path) -> None:
    text = refusal("actor", changed("operating", speed_max_rpm=12500.0))[1]
    assert "domain speed_rad_s 100 .. 1300, here 157.08 .. 1309" in text


def test_the_wrong_graph_behind_the_right_metadata(shipped: Path) -> None:
    wrong = actor(8e-5, kind="surrogate", inputs=json.dumps(store.FILM_STATE), domain="{}")
    put(shipped, "surrogate", wrong)
    text = refusal("surrogate")[1]
    assert "graph takes 11 columns, expected 9" in text
    assert "graph gives ('clearance',)" in text


def test_signed_models_of_the_user(tmp_path: Path) -> None:
    data = actor(8e-5)
    (tmp_path / "actor.onnx").write_bytes(data)
    config = with_models(directory=str(tmp_path), public_keys=[public(OTHER), public(KEY)])
    assert refusal("actor", config)[0] is ModelTrustError
    (tmp_path / "actor.onnx.sig").write_bytes(KEY.sign(data))
    assert store.load_model("actor", config).card.kind == "actor"
    (tmp_path / "actor.onnx.sig").write_bytes(KEY.sign(data + b" "))
    kind, text = refusal("actor", config)
    assert kind is ModelTrustError
    assert "signed by none of the 2 models.public_keys" in text
    needed = with_models(directory=str(tmp_path), require_signature=True)
    assert refusal("actor", needed)[0] is ModelTrustError
    named = store.load_model("actor", with_models(directory=str(tmp_path)))
    assert named.vouched_by == "signed by none of the 0 models.public_keys"
    lenient = msgspec.structs.replace(config.models, require_signature=False)
    assert "none of the 2" in store.load_model("actor", config.replaced(models=lenient)).described


def test_an_unsigned_set_is_named_and_refused_where_a_signature_is_required(shipped: Path) -> None:
    found = store.load_models(with_models(directory=str(shipped)))
    assert found.refusals == {}
    assert found.actor is not None
    assert found.actor.vouched_by == "unsigned"
    kind, text = refusal("actor", with_models(directory=str(shipped), require_signature=True))
    assert kind is ModelTrustError
    assert "actor.onnx: unsigned, and a signature is required" in text


def test_the_signature_of_a_manifest_covers_every_file_of_the_set(shipped: Path) -> None:
    manifest = (shipped / "manifest.json").read_bytes()
    (shipped / "manifest.json.sig").write_bytes(KEY.sign(manifest))
    config = with_models(directory=str(shipped), public_keys=[public(OTHER), public(KEY)])
    found = store.load_models(config)
    assert found.refusals == {}
    assert found.surrogate is not None
    assert found.surrogate.vouched_by.startswith("key ")
    (shipped / "actor.onnx").write_bytes(actor(7e-5))
    assert "changed after packaging" in store.load_models(config).refusals["actor"]
    put(shipped, "actor", actor(7e-5))  # with a manifest that nobody has signed
    assert all("signed by none" in text for text in store.load_models(config).refusals.values())


def test_the_last_layer_that_has_a_file_goes_first(shipped: Path, tmp_path: Path) -> None:
    for number, clearance_m in enumerate((7e-5, 6e-5)):
        (tmp_path / str(number)).mkdir()
        put(tmp_path / str(number), "actor", actor(clearance_m))
    (tmp_path / "2").mkdir()
    put(tmp_path / "2", "classifier", classifier(score=0.5))
    layers = [tmp_path / str(number) for number in range(3)]
    found = store.load_models(CONFIG, layers)
    assert found.actor is not None
    assert found.classifier is not None
    said = found.actor.session.run(np.zeros((1, 11)))["clearance"]
    assert said == pytest.approx(6e-5)
    assert found.classifier.vouched_by == "unsigned"
    assert found.surrogate is not None
    assert found.surrogate.vouched_by == "the package"


@pytest.mark.parametrize(
    "key",
    ["???", base64.b64encode(b"abc").decode(), public(ec.generate_private_key(ec.SECP256R1()))],
)
def test_bad_public_keys_are_named(tmp_path: Path, key: str) -> None:
    (tmp_path / "actor.onnx").write_bytes(actor(8e-5))
    (tmp_path / "actor.onnx.sig").write_bytes(b"0" * 64)
    kind, text = refusal("actor", with_models(directory=str(tmp_path), public_keys=[key]))
    assert kind is ModelTrustError
    assert text.startswith("models.public_keys[0]: not ")


def test_weights_outside_the_file_are_refused(
    shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = helper.make_tensor(
        "w", TensorProto.FLOAT, [11, 1], np.zeros(11, np.float32).tobytes(), raw=True
    )
    weights.ClearField("raw_data")
    weights.data_location = TensorProto.EXTERNAL
    entry = weights.external_data.add()
    entry.key, entry.value = "location", "w.bin"
    (tmp_path / "w.bin").write_bytes(bytes(44))
    monkeypatch.chdir(tmp_path)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["x", "w"], ["clearance"])],
        "g",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["b", 11])],
        [helper.make_tensor_value_info("clearance", TensorProto.FLOAT, ["b", 1])],
        [weights],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    put(shipped, "actor", made.SerializeToString())
    assert refusal("actor")[0] is ModelUnfitError


def test_answers_that_are_not_finite_are_errors() -> None:
    session = Session("actor.onnx", actor(float("nan")))
    with pytest.raises(ModelAnswerError, match=r"actor\.onnx: output 'clearance' is not finite"):
        session.run(np.zeros((1, 11)))


def test_outside_the_domain(shipped: Path) -> None:
    model = store.load_model("actor", CONFIG)
    assert model.outside({"speed_rad_s": 500.0, "nothing": 1e9}) == []
    assert model.outside({"speed_rad_s": 50.0}) == [
        "speed_rad_s 50 outside the actor's domain 100 .. 1300"
    ]


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_onnxruntime_reports_to_nobody() -> None:
    """A session's whole life under a trace of the kernel's network calls; the witness must see its
    own call."""
    code = (
        "import socket, sys; from tests.brain.onnx_models import actor; "
        "from firmware_py.brain.session import Session; import numpy as np; "
        "Session('a', actor(8e-5)).run(np.zeros((1, 11))); "
        "socket.socket(socket.AF_INET).close()"
    )
    trace = subprocess.run(
        ["strace", "-f", "-e", "trace=network", sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    ).stderr
    calls = [
        line
        for line in trace.splitlines()
        if "AF_INET" in line or "connect(" in line or "sendto(" in line
    ]
    assert len(calls) == 1, calls
    assert socket.AF_INET.name in calls[0]
