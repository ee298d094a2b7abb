"""How the simulator's kernels are compiled: IEEE arithmetic to the bit, and no needless reference
counts.

No kernel may contract or reorder arithmetic (``fastmath``).  Numba hands such options on to the
kernels that are compiled on the way, so that the last bits would depend on which kernel happened to
be called first after an installation.  For the same reason every kind of kernel says all of its
options.

Most kernels take arrays and numbers and make none: nothing of theirs needs counting, and the
counters' atomic instructions took more than half of the machine's time.
"""

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import IndexDataCacheFile

_IEEE: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": False}

kernel = njit(**_IEEE, _nrt=False)
"""Compiled on its own; allocates nothing."""
inlined = njit(**_IEEE, _nrt=False, forceinline=True)
"""The same, written out wherever it is called."""
allocating = njit(**_IEEE, _nrt=True, nogil=True)
"""May make arrays; frees other threads meanwhile."""


def _one_writer_at_a_time() -> None:
    """Let one process at a time add to the folder of compiled kernels.

    Numba gives a new file the first number that the kernel's index does not hold.  Of two processes
    that add different signatures of one kernel at the same time, both would take the same number,
    and the index would then name machine code of another signature.
    """
    save = IndexDataCacheFile.save

    def locked(file: Any, key: Any, data: Any) -> None:
        with Path(file._cache_path, "lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(file, key, data)

    IndexDataCacheFile.save = locked


_one_writer_at_a_time()
