"""A file appears under its name only when it is whole, whoever writes it at the same time."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A stream whose bytes replace ``path`` at once when the block ends without an exception.

    The part is a file beside ``path`` that belongs to this thread alone: of two that make the same
    file, the later one replaces the earlier one's, and neither takes the other's part away.

    Raises
    ------
    OSError
        The folder is missing, full or may not be written to.
    """
    own = f"{os.getpid()}-{threading.get_native_id()}"
    part = path.with_name(f"{path.name}.{own}.part")
    try:
        with part.open("wb") as stream:
            yield stream
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
