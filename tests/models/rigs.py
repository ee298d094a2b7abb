"""Rig folders for tests: the bench with other figures."""

from __future__ import annotations

from pathlib import Path

from firmware_py.commands.rig_new import texts_for
from firmware_py.config.written import write_rig

MILL = {"machine.toml": {"load_max_N = 300.0": "load_max_N = 200.0"}}
"""A machine that is no bench."""


def bench_copy(folder: Path, changes: dict[str, dict[str, str]] | None = None) -> Path:
    """A rig folder as `orbitd rig new` writes it, named as the folder; ``changes`` by file."""
    texts = texts_for("bench", folder.name)
    for name, words in (changes or {}).items():
        for old, new in words.items():
            assert old in texts[name], old
            texts[name] = texts[name].replace(old, new, 1)
    write_rig(texts, folder)
    return folder
