"""Where compiled kernels are kept between runs: one folder per state of the simulator's sources.

Numba notices a change of the file in which a kernel stands, but not of the constants and functions
that it imports; a folder named after all sources can hold nothing stale.
"""

from __future__ import annotations

import hashlib
import os
from itertools import chain
from pathlib import Path

KERNEL_FOLDERS = ("film", "rotor", "sensors")
"""Where compiled functions, and the constants that they use, are written."""


def keep_compiled() -> None:
    """Point Numba at the folder that belongs to these sources, unless the environment names
    another."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    if os.access(base if base.exists() else base.parent, os.W_OK):
        os.environ["NUMBA_CACHE_DIR"] = str(base / "orbitd" / f"compiled-{_state()}")


def _state() -> str:
    """Sizes and modification times of every source from which kernels are made, as one short
    name."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    folders = [sorted((here / folder).rglob("*.py")) for folder in KERNEL_FOLDERS]
    for path in [here / "jit.py", *chain.from_iterable(folders)]:
        found = path.stat()
        digest.update(f"{path.name} {found.st_size} {found.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]
