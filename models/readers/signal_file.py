"""What every reader gives: the channels of one file, as they stand in it."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class SignalFileError(ValueError):
    """A file cannot be used; the text names file, place, cause and next step."""


@dataclass(frozen=True)
class Channel:
    """One channel of a file.

    Attributes
    ----------
    name
        As in the file; ``column 3`` where the file names none.
    values
        Shape (n,), in ``unit``.
    unit
        As in the file; empty: the file does not say.
    rate_hz
        None: the file does not say.
    lines
        Line number of each value in a text file, shape (n,); None for other files.
    fault
        Why it cannot be used, which matters only where somebody wants it; empty: nothing is known.
    """

    name: str
    values: Floats
    unit: str = ""
    rate_hz: float | None = None
    lines: NDArray[np.intp] | None = None
    fault: str = ""

    def where(self, index: int) -> str:
        """The place of a value, for messages."""
        if self.lines is not None:
            return f"line {self.lines[index]}, {self.name}"
        return f"{self.name}, sample {index}"


@dataclass(frozen=True)
class SignalFile:
    """The channels of a file, numbers that stand beside them, and what a reader passed over.

    ``facts`` are scalars of the file by name (``rpm``, ``fs``); ``marks_s`` the times of
    once-per-turn marks from the first sample on, where the file holds them as times.
    """

    path: Path
    channels: tuple[Channel, ...]
    facts: dict[str, float] = field(default_factory=dict)
    marks_s: Floats | None = None
    notes: tuple[str, ...] = ()


EXTRA_OF: Final = {
    "asammdf": "export",
    "nptdms": "export",
    "pyarrow": "export",
    "pyarrow.parquet": "export",
    "pyuff": "export",
    "scipy.io": "export",
    "scipy.io.wavfile": "export",
    "scipy.signal": "export",
}
"""Extra of this package that brings a library."""


def library(name: str, path: Path) -> Any:
    """The module ``name``, imported only when a file needs it.

    Raises
    ------
    SignalFileError
        It is not installed; the text says which extra brings it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SignalFileError(
            f"{path.name}: reading it needs the library {name.partition('.')[0]} ({error}); "
            f"install it with: python -m pip install 'orbitd[{EXTRA_OF[name]}]'"
        ) from error


def guarded(path: Path, what: str, work: Callable[[], Any]) -> Any:
    """``work()``; whatever a foreign library raises on bytes that it does not understand becomes
    a :class:`SignalFileError`.

    Libraries for foreign formats raise anything (``KeyError``, ``struct.error``, their own), so
    every exception is caught here, and only here.
    """
    try:
        return work()
    except SignalFileError:
        raise
    except Exception as error:
        first = (str(error).splitlines() or [""])[0][:200]
        raise SignalFileError(
            f"{path.name}: not a {what} that can be read ({type(error).__name__}: {first}); "
            "write it again, or export it as CSV"
        ) from error
