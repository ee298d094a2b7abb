"""Work on several processes: in order, with one thread each."""

import os

import pytest

from models.workers import THREADS, map_in_order


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
