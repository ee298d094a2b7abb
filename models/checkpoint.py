"""Checkpoints of an interrupted training: whole or not there, and never trusted when damaged."""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path
from typing import Any

from models.manifest import write_whole

_DIGEST_BYTES = hashlib.sha256().digest_size


class CheckpointError(ValueError):
    """A checkpoint cannot be used; the text names the file and the next step."""


def save(path: Path, content: object) -> None:
    """Replace ``path`` at once by ``content`` with its SHA-256 before it."""
    payload = pickle.dumps(content, protocol=5)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, hashlib.sha256(payload).digest() + payload)


def load(path: Path) -> Any:
    """What :func:`save` wrote; only files of this very run folder are read.

    Raises
    ------
    CheckpointError
        Truncated or changed, or written by another version of the code.
    """
    data = path.read_bytes()
    digest, payload = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
    if hashlib.sha256(payload).digest() != digest:
        raise CheckpointError(
            f"{path}: checkpoint of {len(data)} bytes is damaged (SHA-256 differs); nothing was "
            "overwritten: delete that file to repeat its step"
        )
    try:
        return pickle.loads(payload)
    except (AttributeError, ImportError, pickle.UnpicklingError) as error:
        raise CheckpointError(
            f"{path}: checkpoint of another version of the code ({error}); nothing was "
            f"overwritten: delete that folder of checkpoints"
        ) from error
