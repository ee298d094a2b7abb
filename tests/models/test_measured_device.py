"""From a folder of recordings to the device: the word in shadow is the word of the evaluation."""

import base64
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from firmware_py import config
from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import load_models
from firmware_py.records import Block, ShadowDiagnosis
from models import train
from models.diagnosis.dataset_folder import MeasuredRecording
from models.diagnosis.measured_judge import judge

CONFIG, _ = config.load(config.SHIPPED / "bench")
ROWS = CONFIG.machine.channel
USED = ("disp_x", "acc_motor")
RATE, SECONDS = 5000, 11


def counts_of(loud: bool, speed: int, rng: np.random.Generator) -> np.ndarray:
    """Counts of all channels of a shaft that turns ``speed`` times a second."""
    turns = speed * np.arange(SECONDS * RATE) / RATE
    si = np.zeros((len(turns), len(ROWS)))
    si[:, 0] = 10e-6 * np.cos(2 * np.pi * turns)
    si[:, 4] = 1.0 * np.cos(2 * np.pi * turns) + (1.5 if loud else 0.3) * np.cos(6 * np.pi * turns)
    si += rng.normal(size=si.shape) * [1e-6 if row.unit == "m" else 0.3 for row in ROWS]
    return np.clip(np.round(si / [row.scale for row in ROWS]), -32768, 32767).astype("<i2")


def stored(folder, recordings):
    """As a logger with its own names and units would write them: um and g."""
    for label, speed, counts in recordings:
        (folder / label).mkdir(parents=True, exist_ok=True)
        si = counts * [row.scale for row in ROWS] + [row.offset for row in ROWS]
        np.savez(folder / label / f"{speed}.npz", weg=si[:, 0] * 1e6, a_motor=si[:, 4] / 9.80665,
                 fs=RATE, rpm=speed * 60)  # fmt: skip
    (folder / "channels.toml").write_text(
        "[[channel]]\ncolumn='weg'\nname='disp_x'\nunit='um'\n"
        "[[channel]]\ncolumn='a_motor'\nname='acc_motor'\nunit='g'\n"
    )
    return folder


def blocks(counts: np.ndarray, speed: int) -> list[Block]:
    """The same as the guard would send it, 50 instants a block."""
    found = []
    for seq in range(len(counts) // 50):
        start = 50 * seq
        first, last = np.ceil(start * speed / RATE), np.ceil((start + 50) * speed / RATE)
        marks = [round(k * 1e6 / speed) for k in np.arange(first, last)]
        found.append(
            Block(
                seq=seq, t_acq_ns=10**9 + start * 200_000, period_ns=200_000, tick_us=200 * start,
                sample_period_us=200, quality=0, channel_ok=0xFF, speed_rad_s=6.28 * speed,
                turn_count=int(last), mark_ticks_us=marks,
                samples=counts[start : start + 50].tobytes(),
            )
        )  # fmt: skip
    return found


def on_device(path, folder, counts, speed) -> list[ShadowDiagnosis]:
    key = Ed25519PrivateKey.generate()
    public = key.public_key().public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    shipped = folder / "own.onnx"
    shipped.write_bytes(path.read_bytes())
    (folder / "own.onnx.sig").write_bytes(key.sign(path.read_bytes()))
    models = msgspec.structs.replace(
        CONFIG.models, shadow=str(shipped), public_keys=[base64.b64encode(public).decode()]
    )
    found = load_models(CONFIG.replaced(models=models))
    assert found.shadow is not None, found.refusals
    core = BrainCore(CONFIG, found)
    said = [r for b in blocks(counts, speed) for r in core.step([b], b.t_acq_ns)]
    return [record for record in said if isinstance(record, ShadowDiagnosis)]


@pytest.mark.parametrize(
    "rung", ["logistic regression, orders", "random forest, 16 bands", "network, spectra"]
)
def test_the_device_says_what_the_evaluation_says(tmp_path, rung):
    rng = np.random.default_rng(0)
    taught = [
        (label, speed, counts_of(label == "loose", speed, rng))
        for speed in (20, 25, 30, 35)
        for label in ("normal", "loose")
    ]
    (tmp_path / "one.toml").write_text(f'rungs = ["{rung}"]')
    data = stored(tmp_path / "rig", taught)
    given = ["classifier", "--data", str(data), "--config", str(tmp_path / "one.toml")]
    assert train.main([*given, "--out", str(tmp_path)]) == 0
    path = tmp_path / "measured_model-seed0" / "measured_model.onnx"

    for label, speed in (("loose", 27), ("normal", 27)):
        counts = counts_of(label == "loose", speed, rng)
        said = on_device(path, tmp_path, counts, speed)
        assert len(said) == SECONDS
        si = counts * [row.scale for row in ROWS] + [row.offset for row in ROWS]
        recording = MeasuredRecording(
            label, si[:, [0, 4]], float(RATE), USED, label, label, "", ("m", "m/s2"),
            speed * np.arange(len(si)) / RATE,
        )  # fmt: skip
        told = judge(path, [replace(recording, samples=recording.samples[: 10 * RATE])], 0)
        assert told["per_decision"]["words"] == {label: {said[9].verdict: 1}}
        assert said[-1].verdict == label
