"""Public recordings of measured machines, written as dataset folders
(:file:`docs/recordings.md`).

``python -m models.diagnosis.public_recordings DATA OUT``: ``DATA`` holds ``fan_unbalance`` and
``motor_audio_vibration`` with their READMEs, which name origin and licence.  Writes ``OUT/fan``,
``OUT/audio`` and ``OUT/vibration``.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.folder_table import TABLE

AXES = "acc_x acc_y acc_z"
VIBRATION_HZ = 99.5
FAN = {1: "weights on adjacent blades", 2: "weights at 90 degrees", 3: "normal"}
"""Configurations; in the third the weights are opposite each other and cancel."""

Row = dict[str, str | float]
Item = tuple[NDArray[np.float32], Row]


def fan(data: Path) -> Iterator[Item]:
    """Fan with two weights at a commanded speed; 50 Hz, three axes, m/s2."""
    with np.load(data / "fan_unbalance" / "fan.npz") as stored:
        for acc, config, speed in zip(
            stored["acc_mg"], stored["config"], stored["speed_pct"], strict=True
        ):
            samples = (acc * (9.80665e-3)).astype(np.float32)
            row: Row = {
                "label": FAN[int(config)],
                "group": f"{speed} %",
                "rate_hz": 50.0,
                "channels": AXES,
            }
            yield samples, row


def audio(data: Path) -> Iterator[Item]:
    """Microphone near a motor; groups are speeds, ``build`` the assembly."""
    with np.load(data / "motor_audio_vibration" / "audio.npz") as stored:
        scale = stored["scale"]
        for i, samples in enumerate(stored["audio"]):
            yield (
                (samples * scale[i]).astype(np.float32)[:, None],
                {**_motor(stored, i), "rate_hz": 16000.0, "channels": "microphone"},
            )


def vibration(data: Path) -> Iterator[Item]:
    """Telephone fixed to a motor; three axes, m/s2, its nominal rate."""
    with np.load(data / "motor_audio_vibration" / "vibration.npz") as stored:
        acc, offsets = stored["acc"], stored["offsets"]
        for i in range(len(offsets) - 1):
            yield (
                acc[offsets[i] : offsets[i + 1]],
                {**_motor(stored, i), "rate_hz": VIBRATION_HZ, "channels": AXES},
            )


def _motor(stored: Any, i: int) -> Row:
    machine, build = str(stored["machine"][i]), str(stored["build"][i])
    return {
        "label": str(stored["label"][i]),
        "group": f"{stored['speed'][i]}",
        "build": f"{machine} {build}",
        "machine": machine,
    }


SETS = {"fan": fan, "audio": audio, "vibration": vibration}


def write(data: Path, name: str, out: Path) -> Path:
    """Write the set ``name`` under ``out``; returns its folder."""
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for number, (samples, row) in enumerate(SETS[name](data)):
        np.savez(folder / f"{number:04d}.npz", samples=samples)
        rows.append({"file": f"{number:04d}.npz", **row})
    with (folder / TABLE).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return folder


if __name__ == "__main__":
    for each in SETS:
        print(write(Path(sys.argv[1]), each, Path(sys.argv[2])))
