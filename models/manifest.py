"""The manifest of a set of models, and what it is written with."""

from __future__ import annotations

import subprocess
from pathlib import Path

from firmware_py.model_sets.manifest import MANIFEST, manifest_of
from sim_hil.whole_file import whole_file


def write_manifest(folder: Path) -> None:
    """Renew ``manifest.json`` from every file in ``folder`` that the device loads."""
    paths = sorted([*folder.glob("*.onnx"), *folder.glob("predictor.json")])
    write_whole(folder / MANIFEST, manifest_of((p.name, p.read_bytes()) for p in paths))


def commit() -> str:
    """Commit of the code that trains, ``unknown`` outside a checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def write_whole(path: Path, content: bytes) -> None:
    """Replace ``path`` at once: an interrupted write leaves the old file."""
    with whole_file(path) as stream:
        stream.write(content)
