"""A real shelf with sets of small models, for the tests of what uses one."""

from __future__ import annotations

from pathlib import Path

import msgspec

from firmware_py.brain import candidate
from firmware_py.brain.core import BrainCore
from firmware_py.brain.library import ShelfLibrary
from firmware_py.config import Config
from firmware_py.model_sets.shelf import SetNote, Shelf

from .machine import CONFIG
from .onnx_models import actor, classifier, short_film


def rig_with_models(folder: Path, **changed: object) -> Config:
    """``bench`` whose own models are three small ones in ``folder``."""
    folder.mkdir(parents=True)
    own = {"classifier": classifier(), "actor": actor(80e-6), "surrogate": short_film()}
    for kind, data in own.items():
        (folder / f"{kind}.onnx").write_bytes(data)
    models = msgspec.structs.replace(CONFIG.models, directory=str(folder), **changed)
    return CONFIG.replaced(models=models)


def put(shelf: Shelf, folder: Path, name: str, **files: bytes) -> str:
    """Put a set of ``files`` on ``shelf`` unexamined; its id."""
    source = folder / f"source-{name}"
    source.mkdir()
    for kind, data in files.items():
        (source / f"{kind}.onnx").write_bytes(data)
    note = SetNote(name, str(source), 1)
    return shelf.put(candidate.read_source(source), note, lambda _: None).id


def brain(config: Config, shelf: Shelf) -> BrainCore:
    """A brain as its process makes it."""
    library = ShelfLibrary(config, shelf.folder)
    models, start = library.in_use()
    return BrainCore(config, models, "cpu", start, library)
