"""The same work on many items: in this process, on several, or on computers that others run.

Whatever does it, an item's answer follows from the item alone, and the answers come in the order of
the items: the same bits anywhere on processors that round alike.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

from firmware_py import __version__
from firmware_py.errors import OrbitdError
from models import PHYSICS_VERSION
from sim_hil.processes import end_with_parent

T = TypeVar("T")
R = TypeVar("R")

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What numpy's linear algebra and torch go by when they are loaded."""
AHEAD: Final = 4
"""Items a remote worker has at hand beside the one that it works on."""

_scheduler: list[Any] = []
"""The client of the scheduler that work is spread over; none: processes of this computer."""


class SpreadError(OrbitdError, ValueError):
    """Work cannot be spread over those computers; the text names cause, value and next step."""

    exit_code = 2


def map_in_order(make: Callable[[T], R], items: Sequence[T], workers: int) -> Iterator[R]:
    """``make`` of every item, in their order, on ``workers`` processes of one thread each, or
    inside :func:`spread` on the workers of the scheduler."""
    if _scheduler:
        yield from _map_spread(_scheduler[-1], make, items)
        return
    if workers == 1:
        yield from map(make, items)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=end_with_parent)
    with _single_threaded(), pool:
        yield from pool.map(make, items)


@contextmanager
def spread(address: str, rig: str = "") -> Iterator[int]:
    """Inside, :func:`map_in_order` asks the workers of the Dask scheduler at ``address``; yields
    how many there are.

    Parameters
    ----------
    rig
        A rig folder that every worker must find under the same name, with the same figures.

    Raises
    ------
    SpreadError
        No scheduler answers, it has no workers, or one of them has another version, or another
        machine under that name.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise SpreadError(
            f"--spread {address}: no Dask scheduler answers ({error}); start one with `dask "
            "scheduler`, and `dask worker` on each computer"
        ) from error
    try:
        try:
            said = client.run(identity, rig)
        except ImportError as error:
            raise SpreadError(
                f"--spread {address}: a worker cannot import {error.name}; install "
                "'orbitd[train,spread]' there"
            ) from error
        if not said:
            raise SpreadError(
                f"--spread {address}: the scheduler has no workers; start `dask worker {address}` "
                "on each computer"
            )
        here = identity(rig)
        other = {where: what for where, what in said.items() if what != here}
        if other:
            where, what = next(iter(other.items()))
            raise SpreadError(
                f"--spread {address}: {len(other)} of {len(said)} workers differ, the first "
                f"{where}: {what}, here {here}; install the same version there, and copy the rig "
                "folder to the same place"
            )
        _scheduler.append(client)
        try:
            yield len(said)
        finally:
            _scheduler.pop()
    finally:
        client.close()


def identity(rig: str) -> str:
    """What must be the same wherever work is done: versions, and the figures of the rig."""
    versions = f"orbitd {__version__}, physics {PHYSICS_VERSION}, code {code_digest()}"
    if not rig:
        return versions
    from sim_hil.rigs import load_rig

    try:
        return f"{versions}, {rig} {load_rig(rig).digest}"
    except OrbitdError as error:
        return f"{versions}, {error}"


@cache
def code_digest() -> str:
    """Changes with the code of device, simulator and trainers, and with the simulator's tables."""
    root, digest = Path(__file__).resolve().parents[1], hashlib.sha256()
    for package in ("firmware_py", "sim_hil", "models"):
        for path in sorted((root / package).rglob("*")):
            if path.suffix in (".py", ".npz"):
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _map_spread(client: Any, make: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """Answers in order; no more items are on their way than the workers need to stay busy."""
    window = AHEAD * max(1, len(client.scheduler_info()["workers"]))
    waiting: list[Any] = []
    for item in items:
        waiting.append(client.submit(_one_thread, make, item, pure=False))
        if len(waiting) >= window:
            yield waiting.pop(0).result()
    while waiting:
        yield waiting.pop(0).result()


def _one_thread(make: Callable[[T], R], item: T) -> R:
    """``make(item)`` with one thread of linear algebra, as processes of this computer have."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return make(item)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes that start meanwhile compute with one thread, unless the user says otherwise.

    With as many threads as cores in each of as many processes they wait for each other: twice the
    time.
    """
    added = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]
