"""The shelf of a device: sets of models that a person has added, and a pointer to those in use.

::

    STATE/models/RIG/
      pointer.json      which sets are in use, which one comes back, which one runs in shadow
      compared.json     what the comparison has counted (:mod:`~firmware_py.model_sets.compared`)
      sets/ID/          one set: manifest.json, its signature, models, set.json (name, source)

A set is named by the start of its manifest's SHA-256 and never changes, but for its signatures
when it is added again; it may hold one model or all.  The pointer names *layers*: sets on top of
the device's own folder, of which the last one that has a file goes first.  Sets appear whole, by
renaming a finished folder; the pointer is replaced whole.  A power cut therefore leaves the state
before or after a step, and parts that the next ``add`` removes.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pwd
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Final

import msgspec

from firmware_py.decoding import FILE_LIMIT_BYTES, OutsideError, from_json, read_file
from firmware_py.durable import sync_folder, write_durable, write_new
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import MANIFEST, set_id

POINTER: Final = "pointer.json"
NOTE: Final = "set.json"
SETS: Final = "sets"
PART: Final = ".part-"
HISTORY: Final = 50
"""Changes of the pointer that are remembered."""
FILE_MODE: Final = 0o644
ID: Final = r"^[0-9a-f]{16}\Z"

SetId = Annotated[str, msgspec.Meta(pattern=ID)]
Layers = list[SetId]
"""Sets on top of the device's own folder; none: that folder alone."""


class PointerTurn(msgspec.Struct, frozen=True):
    """One change of what is in use."""

    generation: int
    active: Layers
    why: str
    unix_ns: int = 0


class Pointer(msgspec.Struct, frozen=True):
    """What the device uses.

    ``former`` comes back with ``rollback``; None: nothing was promoted, or it has come back.
    ``rolled_back`` says why a set was taken out of use, until a person acts.
    """

    schema: int = 1
    generation: int = 0
    active: Layers = []
    former: Layers | None = None
    shadow: SetId | None = None
    rolled_back: str = ""
    history: list[PointerTurn] = []


class SetNote(msgspec.Struct, frozen=True):
    """What a person called a set, and where it came from."""

    name: str
    source: str
    added_unix_ns: int


class StoredSet(msgspec.Struct, frozen=True):
    """A set on the shelf."""

    id: str
    folder: Path
    note: SetNote


class Shelf:
    """The sets of one device; nothing is made before something is added.

    Parameters
    ----------
    folder
        ``STATE/models/RIG``.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sets = folder / SETS

    def pointer(self) -> Pointer:
        """What is in use.

        Raises
        ------
        SetError
            It stands there and cannot be read.
        """
        path = self.folder / POINTER
        try:
            return from_json(read_file(path), Pointer, FILE_LIMIT_BYTES)
        except FileNotFoundError:
            return Pointer()
        except (OSError, OutsideError) as error:
            raise SetError(
                f"{path}: cannot be used ({error}); remove it to use the device's own models again"
            ) from error

    def sets(self) -> list[StoredSet]:
        """Every whole set, the oldest first."""
        found = []
        for path in self._sets.glob("*"):
            with contextlib.suppress(OSError, OutsideError):
                note = from_json(read_file(path / NOTE), SetNote, FILE_LIMIT_BYTES)
                if re.search(ID, path.name) and (path / MANIFEST).is_file():
                    found.append(StoredSet(path.name, path, note))
        return sorted(found, key=lambda each: (each.note.added_unix_ns, each.id))

    def find(self, named: str) -> StoredSet:
        """The set that a person means: its name, or the start of its id.

        Raises
        ------
        SetError
            None, or more than one.
        """
        sets = self.sets()
        found = [s for s in sets if s.note.name == named]
        found = found or [s for s in sets if len(named) >= 4 and s.id.startswith(named)]
        if len(found) == 1:
            return found[0]
        if found:
            ids = ", ".join(s.id for s in found)
            raise SetError(f"{named!r} may be {ids}; give the start of the one that is meant")
        known = ", ".join(f"{s.note.name} ({s.id})" for s in sets) or "none"
        raise SetError(
            f"no set {named!r} on the shelf; there are: {known}; `orbitd models add` adds one"
        )

    def folders(self, layers: list[str]) -> list[Path]:
        """The folders of ``layers``, in their order.

        Raises
        ------
        SetError
            One is not there.
        """
        for each in layers:
            if not re.search(ID, each) or not (self._sets / each / MANIFEST).is_file():
                raise SetError(
                    f"set {each!r} is not in {self._sets}; add it again, or `orbitd models "
                    "rollback`"
                )
        return [self._sets / each for each in layers]

    def put(
        self,
        files: Mapping[str, bytes],
        note: SetNote,
        examine: Callable[[Path], object],
    ) -> StoredSet:
        """Add a set: written apart, examined where it lies, then moved in as a whole.

        Parameters
        ----------
        files
            Name and content, ``manifest.json`` among them.
        examine
            Raises where the set in that folder must not be taken.

        Raises
        ------
        SetError
            The shelf cannot be written.
        """
        name = set_id(files[MANIFEST])
        with self._locked("add"):
            self._clear_parts()
            there = self._sets / name
            known = (there / MANIFEST).is_file()
            part = self._sets / f"{PART}{name}"
            try:
                part.mkdir()
                for each, data in files.items():
                    write_new(part / each, data, FILE_MODE)
                examine(part)
                if known:
                    return self._signed_again(name, files)
                write_new(part / NOTE, msgspec.json.encode(note), FILE_MODE)
                sync_folder(part)
                part.rename(there)
                sync_folder(self._sets)
            except OSError as error:
                raise self._unwritable(error) from error
            finally:
                shutil.rmtree(part, ignore_errors=True)
            return StoredSet(name, there, note)

    def _signed_again(self, name: str, files: Mapping[str, bytes]) -> StoredSet:
        """Give a set that is there the signatures with which it has come again."""
        for each, data in files.items():
            if each.endswith(".sig"):
                write_durable(self._sets / name / each, data, FILE_MODE)
        return next(s for s in self.sets() if s.id == name)

    def change(self, step: Callable[[Pointer], Pointer], why: str, unix_ns: int) -> Pointer:
        """Replace the pointer by ``step`` of it, with nobody else between.

        Raises
        ------
        SetError
            ``step`` refuses, or the pointer cannot be read or written.
        """
        with self._locked("pointer"):
            before = self.pointer()
            after = step(before)
            if after == before:
                return before
            if after.active != before.active:
                turn = PointerTurn(before.generation + 1, after.active, why, unix_ns)
                after = msgspec.structs.replace(
                    after,
                    generation=turn.generation,
                    history=[*before.history, turn][-HISTORY:],
                )
            data = msgspec.json.format(msgspec.json.encode(after), indent=1)
            try:
                write_durable(self.folder / POINTER, data, FILE_MODE)
            except OSError as error:
                raise self._unwritable(error) from error
            return after

    def make(self) -> None:
        """Make the folders, for others to add sets as well.

        Raises
        ------
        OSError
            They cannot be made.
        """
        self._sets.mkdir(parents=True, exist_ok=True)

    @contextmanager
    def _locked(self, what: str) -> Iterator[None]:
        """Alone with the shelf: a second one waits."""
        try:
            self.make()
            flags = os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC  # whoever may read it may lock it
            handle = os.open(self.folder / f".{what}.lock", flags, FILE_MODE)
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)

    def _clear_parts(self) -> None:
        """Remove what an interrupted ``add`` left."""
        for path in self._sets.glob(f"{PART}*"):
            shutil.rmtree(path, ignore_errors=True)

    def _unwritable(self, error: OSError) -> SetError:
        whose = _owner(self.folder)
        return SetError(
            f"{error.filename or self.folder}: {error.strerror or error}; free or change the disk, "
            f"or act as the user to whom the folder belongs{whose}; nothing was changed"
        )


def _owner(folder: Path) -> str:
    """Whose the nearest folder is that is there."""
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    try:
        return f" ({pwd.getpwuid(there.stat().st_uid).pw_name})"
    except (KeyError, OSError):
        return ""


def shadowed(shadow: str | None) -> Callable[[Pointer], Pointer]:
    """The step that puts a set (None: none) into shadow; a person has acted."""
    return lambda p: msgspec.structs.replace(p, shadow=shadow, rolled_back="")


def promoted(p: Pointer) -> Pointer:
    """What is in shadow comes into use; what was in use comes back with ``rollback``.

    Raises
    ------
    SetError
        Nothing is in shadow.
    """
    if p.shadow is None:
        raise SetError("promote: no set is in shadow; `orbitd models shadow SET` comes first")
    active = [*(each for each in p.active if each != p.shadow), p.shadow]
    return msgspec.structs.replace(p, active=active, former=p.active, shadow=None, rolled_back="")


def rolled_back(p: Pointer, why: str = "") -> Pointer:
    """What was in use before comes back.

    Raises
    ------
    SetError
        Nothing was promoted since.
    """
    if p.former is None:
        raise SetError("rollback: nothing was promoted that could be taken back")
    return msgspec.structs.replace(p, active=p.former, former=None, rolled_back=why)
