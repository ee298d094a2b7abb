"""Film solutions are made once: a file in the runs folder named after everything that decides
them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile

import numpy as np

from models import PHYSICS_VERSION
from models.checkpoint import CheckpointError
from sim_hil.whole_file import whole_file

T = TypeVar("T")


def kept(folder: Path, name: str, key: object, kind: type[T], make: Callable[[], T]) -> T:
    """A dataclass of arrays, from ``folder`` when it lies there already, else from ``make``.

    Parameters
    ----------
    name, key
        Start of the file's name, and everything that decides the arrays (by its ``repr``).

    Raises
    ------
    CheckpointError
        The file there is damaged.
    """
    digest = hashlib.sha256(repr((PHYSICS_VERSION, name, key)).encode()).hexdigest()[:12]
    path = folder / f"{name}-{digest}.npz"
    columns = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    if path.exists():
        try:
            with np.load(path) as stored:
                return kind(**{column: stored[column] for column in columns})
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise CheckpointError(
                f"{path}: damaged ({error}); nothing was overwritten: delete that file to make it "
                "again"
            ) from error
    made = make()
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as stream:
        np.savez(stream, **{column: getattr(made, column) for column in columns})
    return made
