"""Work on several processes: in order, with one thread each."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from models.workers import THREADS, map_in_order

T = TypeVar("T")


@pytest.mark.parametrize("workers", [1, 2])
def test_answers_come_in_the_order_of_the_items(workers: int) -> None:
    items = [3, -1, 7, -5, 2]
    assert list(map_in_order(abs, items, workers)) == [3, 1, 7, 5, 2]


def test_each_process_computes_with_one_thread_unless_the_user_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    assert list(map_in_order(os.getenv, THREADS, 2)) == ["1", "1", "3"]
    assert [os.environ.get(name) for name in THREADS] == [None, None, "3"]


def _until(found: Callable[[], T], seconds: float = 30.0) -> T:
    give_up = time.monotonic() + seconds
    while not (seen := found()) and time.monotonic() < give_up:
        time.sleep(0.02)
    return seen


def _workers_of(parent: int) -> list[int]:
    """Children of ``parent`` that are processes of a pool."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(c) for c in children if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()]


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_workers_end_with_a_parent_that_is_killed() -> None:
    command = (
        "import time\n"
        "from models.workers import map_in_order\n"
        "if __name__ == '__main__':\n"
        "    list(map_in_order(time.sleep, [0.0, 600.0, 600.0], 2))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", command])
    try:
        workers = _until(lambda: len(_workers_of(parent.pid)) == 2 and _workers_of(parent.pid))
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    try:
        assert _until(lambda: not any(_runs(worker) for worker in workers))
    finally:
        for worker in filter(_runs, workers):
            os.kill(worker, signal.SIGKILL)
