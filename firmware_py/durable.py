"""Files and folders that survive a power cut: what stands under a name is old or new, whole."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path


def write_durable(path: Path, data: bytes, mode: int = 0o600) -> None:
    """Replace ``path`` by ``data``: after a power cut either the old or the new content is there.

    Raises
    ------
    OSError
        Disk full, read-only, folder away, no permission.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}.new")
    with contextlib.suppress(FileNotFoundError):
        fresh.unlink()
    try:
        write_new(fresh, data, mode)
        _put(fresh, path)
    except OSError:
        with contextlib.suppress(OSError):
            fresh.unlink()
        raise
    sync_folder(path.parent)


def write_new(path: Path, data: bytes, mode: int) -> None:
    """Make ``path``, which must not be there, of ``data``, down to the disk.

    Raises
    ------
    OSError
        As of :func:`write_durable`, or the file is there.
    """
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    try:
        left = memoryview(data)
        while left:
            left = left[os.write(handle, left) :]
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(folder: Path) -> None:
    """Make what was renamed in ``folder`` durable.

    Raises
    ------
    OSError
        The folder is away, or the disk fails.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _put(fresh: Path, path: Path) -> None:
    """Rename, past a folder that stands in the way (it is kept under another name)."""
    try:
        fresh.replace(path)
    except IsADirectoryError:
        path.replace(path.with_name(f"{path.name}.folder.{time.time_ns()}"))
        fresh.replace(path)
