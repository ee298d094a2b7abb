"""Small files that survive a power cut, written beside the loop that must not wait for a disk.

A write goes to a new file, which is synchronised, renamed over the old one, and made durable by
synchronising the folder.  One thread does that (an fsync takes 1 to 100 ms and more); the loop only
hands over the newest content. The thread runs at the loop's own priority: one of lower priority
could hold the interpreter's lock while others have the processor.  It needs the lock for some 0.1
ms per write, and writes at most ten times a second.
"""

from __future__ import annotations

import os
import stat
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final

from firmware_py.durable import write_durable

BYTES_MAX: Final = 16 * 1024
"""Larger files are not ours."""

RETRY_S: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Waiting times after failures in a row; the last one for ever."""

CHECK_S: Final = 5.0
"""So often the files are looked at: one that somebody removed or replaced is written again."""

PAUSE_S: Final = 0.1
"""Between two rounds of writing."""


class SmallFileError(Exception):
    """The file is there but cannot be read; the text tells path and cause."""


def read_small(path: Path) -> bytes | None:
    """Content of ``path``, None when there is no such file.

    Raises
    ------
    SmallFileError
        Unreadable, not a regular file (a link, folder or pipe in its place), or larger than
        :data:`BYTES_MAX`.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise SmallFileError(f"{path}: {error.strerror}") from error
    try:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode):
            raise SmallFileError(f"{path}: not a regular file")
        if found.st_size > BYTES_MAX:
            raise SmallFileError(f"{path}: {found.st_size} bytes, more than {BYTES_MAX}")
        return os.read(handle, BYTES_MAX)
    except OSError as error:
        raise SmallFileError(f"{path}: {error.strerror}") from error
    finally:
        os.close(handle)


class FileWriter:
    """Writes the newest content of a few files in a thread of its own.

    Parameters
    ----------
    write
        Does one write (:func:`write_durable`; another one in tests).
    prepare
        Called once in the thread, for its priority.

    Notes
    -----
    ``fault`` is the cause while a write fails, empty otherwise; ``failures`` counts.  A failed
    write is tried again after :data:`RETRY_S`, for ever: what is latched stays in memory.
    """

    def __init__(
        self,
        write: Callable[[Path, bytes], None] = write_durable,
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        self.fault = ""
        self.failures = 0
        self._write = write
        self._prepare = prepare
        self._queue: SimpleQueue[tuple[Path, bytes] | None] = SimpleQueue()
        self._wanted: dict[Path, bytes] = {}
        self._kept: dict[Path, os.stat_result] = {}
        self._thread: threading.Thread | None = None

    def keep(self, path: Path, data: bytes) -> None:
        """``path`` is to hold ``data``; returns at once."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="keeper", daemon=True)
            self._thread.start()
        self._queue.put((path, data))

    def kept(self, path: Path) -> bool:
        """Whether ``path`` has been written at all."""
        return path in self._kept

    def close(self, timeout_s: float = 2.0) -> None:
        """Let the thread finish what it was given; a disk that hangs is not waited for longer."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(timeout_s)
            self._thread = None

    def _run(self) -> None:
        self._prepare()
        waiting: dict[Path, bytes] = {}
        tries, ending = 0, False
        while not ending:
            delay_s = RETRY_S[min(tries, len(RETRY_S)) - 1] if tries else CHECK_S
            ending = self._collect(waiting, delay_s)
            waiting |= {
                path: data
                for path, data in self._wanted.items()
                if path not in waiting and not self._as_kept(path)
            }
            tries = tries + 1 if self._write_all(waiting) else 0
            if not ending:
                time.sleep(PAUSE_S)

    def _collect(self, waiting: dict[Path, bytes], delay_s: float) -> bool:
        """Wait for something to do and take everything; True at the end."""
        try:
            item = self._queue.get(timeout=delay_s)
            while item is not None:
                self._wanted[item[0]] = waiting[item[0]] = item[1]
                item = self._queue.get_nowait()
            return True
        except Empty:
            return False

    def _write_all(self, waiting: dict[Path, bytes]) -> bool:
        """Write what waits; True when something failed and has to wait on."""
        fault = ""
        for path, data in list(waiting.items()):
            try:
                self._write(path, data)
                self._kept[path] = path.lstat()
                del waiting[path]
            except OSError as error:
                fault = f"{path}: {error.strerror or error}; make room or give write permission"
                self.failures += 1
        self.fault = fault
        return bool(fault)

    def _as_kept(self, path: Path) -> bool:
        """Whether the file is still the one that was written last."""
        before = self._kept.get(path)
        try:
            now = path.lstat()
        except OSError:
            return False
        return before is not None and (now.st_ino, now.st_size, now.st_mtime_ns) == (
            before.st_ino,
            before.st_size,
            before.st_mtime_ns,
        )
