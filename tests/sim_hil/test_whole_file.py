"""Files that several processes make at the same time: whole, and nobody in another's way."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from sim_hil.whole_file import whole_file


def test_two_that_make_the_same_file_at_once_both_end_with_a_whole_one(tmp_path: Path) -> None:
    path, both_open, both_written = tmp_path / "films.npz", Barrier(2), Barrier(2)

    def make(content: bytes) -> None:
        with whole_file(path) as stream:
            both_open.wait(10)
            stream.write(content)
            both_written.wait(10)

    contents = [b"a" * 10_000, b"b" * 20_000]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(make, contents))
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_write_leaves_what_was_there_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(b"old")

    def interrupted() -> None:
        with whole_file(path) as stream:
            stream.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
