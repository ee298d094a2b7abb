"""What the comparison of two sets has counted, over every run of the brain: ``compared.json``.

The brain counts from its start; here stand the sums of earlier runs, by pair of sets.  Every figure
is a count or a sum, so that runs add up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.decoding import FILE_LIMIT_BYTES, OutsideError, from_json, read_file
from firmware_py.durable import write_durable
from firmware_py.model_sets.errors import SetError

NAME: Final = "compared.json"
PAIRS_KEPT: Final = 50
FILE_MODE: Final = 0o644

Counts = dict[str, float]


class ComparedFile(msgspec.Struct):
    """Counts by pair, the newest pair last."""

    schema: int = 1
    pairs: dict[str, Counts] = {}


def pair(active: Sequence[str], beside: Sequence[str]) -> str:
    """The name of a pair of sets: what is active, and what ran beside."""
    return f"{'+'.join(active)}|{'+'.join(beside)}"


def read_compared(folder: Path) -> dict[str, Counts]:
    """Counts by pair; none without a file.

    Raises
    ------
    SetError
        It stands there and cannot be read.
    """
    path = folder / NAME
    try:
        return from_json(read_file(path), ComparedFile, FILE_LIMIT_BYTES).pairs
    except FileNotFoundError:
        return {}
    except (OSError, OutsideError) as error:
        raise SetError(f"{path}: cannot be used ({error}); remove it to count anew") from error


def write_compared(folder: Path, pairs: Mapping[str, Counts]) -> None:
    """Replace the file by the newest :data:`PAIRS_KEPT` of ``pairs``.

    Raises
    ------
    OSError
        It cannot be written.
    """
    kept = dict(list(pairs.items())[-PAIRS_KEPT:])
    folder.mkdir(parents=True, exist_ok=True)
    write_durable(folder / NAME, msgspec.json.encode(ComparedFile(pairs=kept)), FILE_MODE)


def together(one: Mapping[str, float], other: Mapping[str, float]) -> Counts:
    """The sum of two runs."""
    return {name: one.get(name, 0.0) + other.get(name, 0.0) for name in {**one, **other}}
