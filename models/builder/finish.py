"""The finished set of models is moved into the rig folder as a whole: what stands there is the old
set or the new one, never half of each."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from firmware_py.durable import sync_folder, write_new
from firmware_py.machine.folder import MODELS
from firmware_py.model_sets.manifest import KINDS, MANIFEST, manifest_of

PART: Final = ".models.part"
_EXCHANGE: Final = 2
_HERE: Final = -100
"""``RENAME_EXCHANGE`` and ``AT_FDCWD`` of ``renameat2(2)``."""


def move_in(rig: Path, files: Mapping[str, bytes]) -> Path:
    """Make ``files`` the set of the folder ``rig``, with their manifest; returns its folder.

    Parameters
    ----------
    files
        Models by the names that the device loads, and what is to lie beside them.

    Raises
    ------
    OSError
        The folder cannot be written; the set that was there stays.
    """
    part, there = rig / PART, rig / MODELS
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    loaded = [(name, files[name]) for name in sorted(KINDS.values()) if name in files]
    for name, data in [*sorted(files.items()), (MANIFEST, manifest_of(loaded))]:
        write_new(part / name, data, 0o644)
    sync_folder(part)
    if not there.exists():
        part.rename(there)
    else:
        exchange(part, there)
        shutil.rmtree(part, ignore_errors=True)
    sync_folder(rig)
    return there


def exchange(one: Path, other: Path) -> None:
    """Swap two folders in one step of the file system; where that cannot do it, in two."""
    libc = ctypes.CDLL(None, use_errno=True)
    names = os.fsencode(one), os.fsencode(other)
    if libc.renameat2(_HERE, names[0], _HERE, names[1], _EXCHANGE) == 0:
        return
    error = ctypes.get_errno()
    if error not in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
        raise OSError(error, os.strerror(error), str(other))
    aside = other.with_name(f"{one.name}.old")
    shutil.rmtree(aside, ignore_errors=True)
    other.rename(aside)
    one.rename(other)
    aside.rename(one)
