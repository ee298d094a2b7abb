"""A classifier of one's own recordings in shadow: the same features as in training, and nothing
follows from it."""

from __future__ import annotations

import base64

import msgspec
import numpy as np
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from firmware_py.acquire.channel_features import VIEWS, angle_at
from firmware_py.brain.core import BrainCore
from firmware_py.brain.shadow import Shadow, decide
from firmware_py.brain.store import Model, Models, load_models
from firmware_py.records import Block, Diagnosis, Quality, ShadowDiagnosis

from .machine import CONFIG, RATE, Machine, model
from .onnx_models import OWN_CHANNELS, OWN_SIZE, own


def shadow(**changed: object) -> Shadow:
    return Shadow(model(own(**changed)), CONFIG)  # type: ignore[arg-type]


def blocks(seconds: float, **machine: float) -> list[Block]:
    found = Machine(**machine).run(seconds)  # type: ignore[arg-type]
    return [record for record in found if isinstance(record, Block)]


def said(stage: Shadow, given: list[Block]) -> list[ShadowDiagnosis]:
    return [record for block in given for record in stage.step(block, "normal")]


def si(given: list[Block]) -> np.ndarray:
    """Samples of the model's channels, (2, n), as a reader of the recording has them."""
    names = [row.name for row in CONFIG.machine.channel]
    counts = np.concatenate([np.frombuffer(b.samples, "<i2").reshape(-1, 8) for b in given])
    rows = [(counts[:, i], CONFIG.machine.channel[i]) for i in map(names.index, OWN_CHANNELS)]
    return np.array([column * row.scale + row.offset for column, row in rows])


def test_a_word_a_window_with_the_active_word_beside_it():
    quiet, loud = (said(shadow(), blocks(3.1, unbalance_kg_m=u)) for u in (2e-6, 2e-4))
    assert [r.verdict for r in quiet] == ["quiet"] * 3
    assert [r.verdict for r in loud] == ["loud"] * 3
    assert [r.windows for r in loud] == [1, 2, 3]
    assert loud[0].classes["loud"] == pytest.approx(loud[0].probability)
    assert (loud[0].score, loud[0].active) == (0.5, "normal")
    assert loud[1].t_acq_ns - loud[0].t_acq_ns == pytest.approx(1e9, abs=6e6)


@pytest.mark.parametrize("view", OWN_SIZE)
def test_the_device_makes_the_features_of_the_training(view, monkeypatch):
    stage, seen, given = shadow(made=view), [], blocks(2.1)
    monkeypatch.setattr(
        stage.model.session, "run",
        lambda rows: seen.append(rows[0]) or {"classes": np.ones((1, 2)), "score": np.ones((1, 1))},
    )  # fmt: skip
    said(stage, given)
    marks = np.array([t for b in given for t in b.mark_ticks_us], float) - given[0].tick_us
    places = np.arange(2 * RATE, dtype=float)
    for k, row in enumerate(seen):
        part = slice(k * RATE, (k + 1) * RATE)
        turns = angle_at(marks * RATE * 1e-6, places)[part]
        expected = VIEWS[view](np.ascontiguousarray(si(given)[:, part]), float(RATE), turns)
        assert (
            row == pytest.approx(expected, rel=1e-3, abs=2e-3)
            if view == "orders"
            else (np.array_equal(row, expected))
        )
    assert len(seen) == 2


def test_a_window_spans_no_gap():
    given = blocks(2.6)
    later = [msgspec.structs.replace(b, tick_us=b.tick_us + 600) for b in given[100:]]
    assert [r.windows for r in said(shadow(), given[:100] + later)] == [1]
    flagged = [msgspec.structs.replace(given[150], quality=int(Quality.GAP_BEFORE)), *given[151:]]
    assert [r.windows for r in said(shadow(), given[:150] + flagged)] == [1]


def test_a_bad_channel_of_the_model_is_named_and_others_do_not_matter():
    def without(bit: int) -> list[str]:
        given = [
            msgspec.structs.replace(b, channel_ok=0xFF & ~(1 << bit)) if b.seq == 50 else b
            for b in blocks(2.1, unbalance_kg_m=2e-4)
        ]
        return [r.verdict for r in said(shadow(), given)]

    names = [row.name for row in CONFIG.machine.channel]
    assert without(names.index("acc_motor")) == ["sensor_fault:acc_motor", "loud"]
    assert without(names.index("microphone")) == ["loud", "loud"]


def test_orders_without_marks_are_left_out_and_counted():
    stage = shadow(made="orders", column=0, at=0.0)
    given = [msgspec.structs.replace(b, mark_ticks_us=[]) for b in blocks(2.1)]
    assert [r.verdict for r in said(stage, given)] == ["none", "none"]
    assert stage.counters == {
        "shadow_diagnoses": 2, "shadow_answers_refused": 0, "shadow_windows_left_out": 2,
    }  # fmt: skip


def test_words_of_probabilities_and_scores():
    labels = ("a", "b")
    assert decide(labels, np.array([[0.9, 0.1]]), np.array([0.5])).verdict == "a"
    assert decide(labels, np.array([[0.6, 0.4]]), np.array([0.5])).verdict == "doubt"
    mixed = decide(labels, np.array([[0.9, 0.1], [0.6, 0.4]]), np.array([0.5, 3.0]))
    assert (mixed.verdict, mixed.probability, mixed.score) == ("unknown", 0.75, 1.75)


def core(data: bytes | None) -> BrainCore:
    found: Model | None = model(data) if data else None
    return BrainCore(CONFIG, Models(shadow=found))


def test_nothing_follows_from_it():
    records = Machine().run(2.5)
    kinds = (Diagnosis, ShadowDiagnosis)
    with_it, without = (
        [r for chunk in records for r in each.step([chunk], chunk.t_acq_ns) if isinstance(r, kinds)]
        for each in (core(own()), core(None))
    )
    assert [r for r in with_it if isinstance(r, Diagnosis)] == without
    assert len(with_it) > len(without)


def test_a_restored_brain_goes_on_in_the_middle_of_a_window():
    records = Machine().run(3.2)
    half = len(records) // 2
    first, second = core(own()), core(own())
    for record in records[:half]:
        first.step([record], record.t_acq_ns)
    second.restore(first.snapshot(0, 0), first.recent)
    told = []
    for each in (first, second):
        out = [r for record in records[half:] for r in each.step([record], record.t_acq_ns)]
        told.append([r for r in out if isinstance(r, ShadowDiagnosis)])
    assert told[0] == told[1]
    assert told[0]


KEY = Ed25519PrivateKey.generate()
PUBLIC = base64.b64encode(
    KEY.public_key().public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
).decode()


def configured(path, keys=(PUBLIC,)):
    models = msgspec.structs.replace(CONFIG.models, shadow=str(path), public_keys=list(keys))
    return CONFIG.replaced(models=models)


def loaded(folder, data, signed=None):
    path = folder / "own.onnx"
    path.write_bytes(data)
    (folder / "own.onnx.sig").write_bytes(KEY.sign(data if signed is None else signed))
    return load_models(configured(path))


def test_a_signed_model_that_fits_is_loaded_beside_the_shipped_ones(tmp_path):
    found = loaded(tmp_path, own())
    assert found.shadow is not None
    assert found.classifier is not None
    assert found.shadow.label.startswith("measured classifier 1 provisional ")
    BrainCore(configured(tmp_path / "own.onnx"), found)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"channels": ["disp_x", "acc_7"]}, "channel 'acc_7', this rig has disp_x, disp_y"),
        ({"units": ["m", ""]}, "channel 'acc_motor' in an unknown unit, here in m/s2"),
        ({"rate_hz": 16000.0}, "trained at 16000 Hz, this device samples at 5000: say resample_hz"),
        ({"window_s": 4.0}, "windows of 4 s, this device keeps 2 s: train again with --window-s 2"),
        ({"channels": ["disp_x"], "units": ["m"]}, "10 features, this version makes 5 of '2 ban"),
        ({"view": "wavelets"}, "features 'wavelets', this version has 2 bands"),
        ({"labels": 3}, "settings of the card: Expected `array`, got `int`"),
        ({"kind": "classifier"}, "kind 'classifier' that gives ('classes', 'score'), expected"),
    ],
)  # fmt: skip
def test_one_that_does_not_fit_is_absent_with_the_reason(tmp_path, changed, match):
    found = loaded(tmp_path, own(**changed))
    assert found.shadow is None
    assert match in found.refusals["shadow"]


def test_an_unsigned_or_absent_one_is_refused(tmp_path):
    found = loaded(tmp_path, own(), signed=b"other")
    assert "signed by none of the 1 models.public_keys" in found.refusals["shadow"]
    absent = load_models(configured(tmp_path / "none.onnx"))
    assert "none.onnx: cannot be read" in absent.refusals["shadow"]
    unsigned = load_models(configured(tmp_path / "own.onnx", ()))
    assert unsigned.shadow is not None
    assert unsigned.shadow.vouched_by == "signed by none of the 0 models.public_keys"
