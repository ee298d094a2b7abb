"""The manifest that trusts the shipped models: SHA-256 and size of each."""

from __future__ import annotations

import hashlib
import json
import subprocess
from pathlib import Path

from sim_hil.whole_file import whole_file


def write_manifest(folder: Path) -> None:
    """Renew ``manifest.json`` from every file in ``folder`` that the device loads."""
    files = {
        path.name: {
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "bytes": path.stat().st_size,
        }
        for path in sorted([*folder.glob("*.onnx"), *folder.glob("predictor.json")])
    }
    text = json.dumps({"schema": 1, "files": files}, indent=2, sort_keys=True) + "\n"
    write_whole(folder / "manifest.json", text.encode())


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
