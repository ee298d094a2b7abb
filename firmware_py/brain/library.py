"""Where the brain takes sets of models from: its shelf, and what the pointer there says at the
start."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware_py.brain.errors import ModelAnswerError, ModelUnfitError
from firmware_py.brain.store import Models, load_models
from firmware_py.brain.succession import SuccessionState
from firmware_py.config import Config
from firmware_py.machine.parts import monitor_only
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import KINDS
from firmware_py.model_sets.shelf import Pointer, Shelf
from firmware_py.records import LOST


class InUse(NamedTuple):
    """What a brain starts with."""

    models: Models
    start: SuccessionState


class ShelfLibrary:
    """The sets on the shelf of one device.

    Parameters
    ----------
    config
        The device's configuration.
    folder
        Of the shelf.
    """

    def __init__(self, config: Config, folder: Path) -> None:
        self._config = config
        self.folder = folder
        self._shelf = Shelf(folder)

    def load(self, layers: Sequence[str]) -> Models:
        """The models of ``layers`` on top of the device's own, ready to answer.

        Raises
        ------
        ModelUnfitError, SetError
            A set is not there, or a file of one is refused; every reason.
        """
        folders = self._shelf.folders(list(layers))
        models = load_models(self._config, folders)
        wrong = [
            models.refusals[_refused_as(kind)]
            for kind, name in KINDS.items()
            if _refused_as(kind) in models.refusals
            and any((folder / name).is_file() for folder in folders)
        ]
        if wrong:
            raise ModelUnfitError("\n".join(wrong))
        prewarm(models)
        return models

    def in_use(self) -> InUse:
        """What the pointer names; where it cannot be followed the device's own models, and nothing
        is advised."""
        try:
            pointer = self._shelf.pointer()
            models = load_models(self._config, self._shelf.folders(list(pointer.active)))
        except SetError as error:
            models = load_models(self._config)
            models.refusals["set"] = str(error)
            prewarm(models)
            return InUse(models, SuccessionState(role=LOST, rolled_back=str(error)))
        prewarm(models)
        return InUse(models, self._start(pointer))

    def _start(self, pointer: Pointer) -> SuccessionState:
        active, former, role = list(pointer.active), pointer.former, ""
        beside: list[str] | None = None
        if monitor_only(self._config.machine):
            former = None
        elif pointer.shadow is not None:
            beside, role = [*active, pointer.shadow], "shadow"
        elif former is not None:
            beside, role = list(former), "former"
        kept = None if former is None else list(former)
        return SuccessionState(active, beside, role, kept, pointer.rolled_back)


def _refused_as(kind: str) -> str:
    """Under which name the store refuses a model of ``kind``."""
    return "shadow" if kind == "measured classifier" else kind


def prewarm(models: Models) -> None:
    """Let every session allocate before the first real question; its answer to zeros is of no
    interest."""
    for model in (models.classifier, models.actor, models.surrogate, models.shadow):
        if model is not None:
            with suppress(ModelAnswerError):
                model.session.run(np.zeros((1, model.session.columns)))
            model.session.take_late()
