"""What of the models outlives the brain: the pointer to the sets in use, and the comparison.

The brain decides and has no disk; the gate writes down what it says.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.model_sets.compared import (
    Counts,
    pair,
    read_compared,
    together,
    write_compared,
)
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.shelf import Pointer, Shelf
from firmware_py.records import LOST, ModelsInUse

WRITE_EVERY_NS: Final = 10_000_000_000
"""The comparison of the last so many seconds is lost with the gate."""


class ModelsFile:
    """Keeps pointer and comparison as the brain tells them.

    Parameters
    ----------
    folder
        Of the shelf.
    unix_ns
        The calendar's time, for the history of the pointer.

    Attributes
    ----------
    trouble
        Empty, or why something cannot be read or written.
    """

    def __init__(self, folder: Path, unix_ns: Callable[[], int]) -> None:
        self.trouble = ""
        self._folder, self._unix_ns = folder, unix_ns
        self._shelf = Shelf(folder)
        self._kept: tuple[object, ...] | None = None
        self._earlier: dict[str, Counts] = {}
        self._pair, self._now = "", Counts()
        self._next_ns = 0
        self._unwritten = False
        try:
            self._earlier = read_compared(folder)
        except SetError as error:
            self.trouble = str(error)

    def take(self, said: ModelsInUse) -> None:
        """Keep what the brain has said; what cannot be written is tried again with the next."""
        self._count(said)
        try:
            self._point(said)
            if self._unwritten and said.t_ns >= self._next_ns:
                self._next_ns = said.t_ns + WRITE_EVERY_NS
                self._write()
            self.trouble = ""
        except SetError as error:
            self.trouble = str(error)
        except OSError as error:
            self.trouble = (
                f"{self._folder}: {error.strerror or error}; free or change the disk: what the "
                "comparison of models counts is lost at a restart"
            )

    def compared(self) -> Counts:
        """All that was ever counted of the present pair."""
        return together(self._earlier.get(self._pair, {}), self._now)

    def close(self) -> None:
        """Write what was counted since the last time."""
        if self._unwritten:
            try:
                self._write()
            except OSError as error:
                self.trouble = f"{self._folder}: {error.strerror or error}"

    def _count(self, said: ModelsInUse) -> None:
        """Take the counts of this run; a new run, or another pair, ends the one before."""
        name = "" if said.beside is None else pair(said.active, said.beside)
        again = any(said.compared.get(key, 0.0) < value for key, value in self._now.items())
        if name != self._pair or again:
            if self._now:
                self._earlier = self._all()
                self._next_ns = 0
            self._pair, self._now = name, {}
        if name and said.compared != self._now:
            self._now, self._unwritten = dict(said.compared), True

    def _all(self) -> dict[str, Counts]:
        """Every pair with what this run has counted, the present one last."""
        others = {name: counts for name, counts in self._earlier.items() if name != self._pair}
        return {**others, self._pair: self.compared()} if self._now else self._earlier

    def _write(self) -> None:
        write_compared(self._folder, self._all())
        self._unwritten = False

    def _point(self, said: ModelsInUse) -> None:
        """Let the pointer say what the brain uses; of a brain that found no set it says nothing."""
        shadow = said.beside[-1] if said.role == "shadow" and said.beside else None
        wanted = (said.active, said.former, shadow, said.rolled_back)
        if said.role == LOST or wanted == self._kept:
            return

        def step(before: Pointer) -> Pointer:
            active, former, _, rolled_back = wanted
            return msgspec.structs.replace(
                before, active=active, former=former, shadow=shadow, rolled_back=rolled_back
            )

        if wanted != ([], None, None, "") or self._shelf.folder.exists():
            self._shelf.change(step, said.rolled_back or "a person", self._unix_ns())
        self._kept = wanted
