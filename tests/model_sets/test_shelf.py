"""The shelf: whole sets, one pointer, and after a kill at any step the state before or after it."""

from __future__ import annotations

import errno
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from firmware_py import durable
from firmware_py.model_sets import shelf as module
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import MANIFEST, manifest_of
from firmware_py.model_sets.shelf import (
    Pointer,
    SetNote,
    Shelf,
    StoredSet,
    promoted,
    rolled_back,
    shadowed,
)


def files(text: str) -> dict[str, bytes]:
    model = {"actor.onnx": text.encode()}
    return model | {MANIFEST: manifest_of(model.items())}


def good(_: Path) -> None:
    """An examination that lets everything pass."""


def put(shelf: Shelf, text: str = "one", check: Callable[[Path], None] = good) -> StoredSet:
    return shelf.put(files(text), SetNote(text, "here", 1), check)


def test_a_set_is_found_by_name_and_by_the_start_of_its_id(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path / "shelf")
    assert shelf.sets() == []
    assert shelf.pointer() == Pointer()
    assert not shelf.folder.exists()  # looking makes nothing
    one, two = put(shelf), put(shelf, "two")
    assert shelf.find("one") == one
    assert shelf.find(two.id[:6]) == two
    assert (two.folder / "actor.onnx").read_bytes() == b"two"
    with pytest.raises(SetError, match=r"no set 'three'.* one \("):
        shelf.find("three")
    assert put(shelf, "two") == two  # the same again is the same set


def test_two_sets_of_one_name_are_told_apart_by_their_ids(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    ids = {shelf.put(files(text), SetNote("x", "here", 1), good).id for text in "ab"}
    with pytest.raises(SetError) as caught:
        shelf.find("x")
    assert all(each in str(caught.value) for each in ids)


def test_promotion_and_its_roll_back(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    one, two = put(shelf).id, put(shelf, "two").id
    with pytest.raises(SetError, match="no set is in shadow"):
        shelf.change(promoted, "promote", 2)
    for each in (one, two):
        shelf.change(shadowed(each), "shadow", 2)
        shelf.change(promoted, "promote", 2)
    pointer = shelf.pointer()
    assert (pointer.generation, pointer.active, pointer.former) == (2, [one, two], [one])
    assert [turn.active for turn in pointer.history] == [[one], [one, two]]
    assert shelf.folders(pointer.active) == [shelf.folder / "sets" / each for each in (one, two)]
    back = shelf.change(lambda p: rolled_back(p, "NaN"), "by itself", 3)
    assert (back.active, back.former, back.rolled_back) == ([one], None, "NaN")
    with pytest.raises(SetError, match="nothing was promoted"):
        shelf.change(rolled_back, "rollback", 3)
    assert shelf.change(shadowed(two), "shadow", 4).rolled_back == ""  # a person has acted


def test_what_is_refused_leaves_nothing(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)

    def refuse(part: Path) -> None:
        assert (part / "actor.onnx").read_bytes() == b"bad"
        raise SetError("not this one")

    with pytest.raises(SetError, match="not this one"):
        put(shelf, "bad", refuse)
    assert shelf.sets() == []
    assert list((tmp_path / "sets").iterdir()) == []


def test_a_pointer_that_cannot_be_read_is_named_and_kept(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    put(shelf)
    (tmp_path / "pointer.json").write_text('{"active": ["../../etc"]}')
    with pytest.raises(SetError, match=r"pointer\.json: cannot be used"):
        shelf.pointer()
    with pytest.raises(SetError):
        shelf.change(shadowed(None), "shadow", 1)
    assert "etc" in (tmp_path / "pointer.json").read_text()
    with pytest.raises(SetError, match=r"set '\.\./x' is not in"):
        shelf.folders(["../x"])


def test_a_full_disk_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shelf = Shelf(tmp_path)
    put(shelf)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(durable.os, "write", full)
    with pytest.raises(SetError, match="No space left on device; free or change the disk"):
        put(shelf, "two")
    shelf.change(shadowed(None), "x", 1)  # nothing to change is no write
    with pytest.raises(SetError, match="No space left"):
        shelf.change(shadowed(shelf.sets()[0].id), "x", 1)
    monkeypatch.undo()
    assert [each.note.name for each in shelf.sets()] == ["one"]
    assert shelf.pointer() == Pointer()


def test_the_folder_of_another_owner_is_named(tmp_path: Path) -> None:
    (tmp_path / "models").write_text("in the way")
    with pytest.raises(SetError, match=r"the folder belongs \(\w+\); nothing was changed"):
        put(Shelf(tmp_path / "models" / "bench"))


def test_of_two_promotions_at_once_one_is_refused(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    shelf.change(shadowed(put(shelf).id), "shadow", 1)
    said: list[object] = []
    start = threading.Barrier(2)

    def work() -> None:
        start.wait()
        try:
            said.append(Shelf(tmp_path).change(promoted, "promote", 2))
        except SetError as error:
            said.append(str(error))

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(type(each).__name__ for each in said) == ["Pointer", "str"]
    assert shelf.pointer().generation == 1


STEPS = ("write", "fsync", "rename", "replace", "mkdir", "open")


def killed_at(number: int, work: Callable[[], object]) -> bool:
    """Do ``work`` in a process that is killed at its ``number``-th call of the system; whether it
    was."""
    child = os.fork()
    if child == 0:
        left = [number]

        def counted(call: Callable[..., object]) -> Callable[..., object]:
            def instead(*given: object, **named: object) -> object:
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                return call(*given, **named)

            return instead

        for name in STEPS:
            setattr(os, name, counted(getattr(os, name)))
        try:
            work()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def whole(shelf: Shelf) -> tuple[list[str], Pointer]:
    """What the shelf holds, after it was seen to be whole."""
    found = shelf.sets()
    for each in found:
        assert (each.folder / "actor.onnx").read_bytes() == each.note.name.encode()
    pointer = shelf.pointer()
    shelf.folders(list(pointer.active))
    return [each.note.name for each in found], pointer


@pytest.mark.parametrize("what", ["add", "shadow", "promote", "rollback"])
def test_a_kill_at_any_step_leaves_the_state_before_or_after(tmp_path: Path, what: str) -> None:
    number, before, ends = 0, None, set()
    while True:
        shelf = Shelf(tmp_path / str(number))
        one, two = put(shelf).id, put(shelf, "two").id
        shelf.change(shadowed(one), "shadow", 1)
        shelf.change(promoted, "promote", 1)
        if what == "promote":
            shelf.change(shadowed(two), "shadow", 1)
        before = whole(shelf)
        work = {
            "add": lambda s=shelf: put(s, "three"),
            "shadow": lambda s=shelf, t=two: s.change(shadowed(t), "shadow", 2),
            "promote": lambda s=shelf: s.change(promoted, "promote", 2),
            "rollback": lambda s=shelf: s.change(rolled_back, "rollback", 2),
        }[what]
        killed = killed_at(number, work)
        found = whole(shelf)
        ends.add(found == before)
        if found == before:
            work()  # a person may do it again
            assert whole(shelf) != before
        assert not list((shelf.folder / "sets").glob(".part*"))
        if not killed:
            assert found != before
            break
        number += 1
    assert number >= 5
    assert ends == {True, False}


def test_a_step_that_changes_nothing_writes_nothing(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    put(shelf)
    shelf.change(shadowed(None), "shadow none", 1)
    assert not (tmp_path / module.POINTER).exists()
