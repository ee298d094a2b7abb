"""Models at the gate: what the brain uses goes to the disk before a promotion is answered, what the
comparison counts is kept over restarts, and a wish names a whole id."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from firmware_py import durable
from firmware_py.gate.models_file import WRITE_EVERY_NS, ModelsFile
from firmware_py.gate.requests import MalformedCommandError, parse
from firmware_py.model_sets.compared import read_compared
from firmware_py.model_sets.shelf import Pointer, Shelf
from firmware_py.records import LOST, CommandReply, ModelsInUse
from firmware_py.routing import Stage, in_order

ONE, TWO = "0" * 16, "1" * 16
S = 1_000_000_000


def said(second: int, counts: dict[str, float] | None = None, **changed: object) -> ModelsInUse:
    given: dict[str, object] = {"active": [], "compared": counts or {}, **changed}
    return ModelsInUse(second, second * S, **given)  # type: ignore[arg-type]


def shadow(second: int, **counts: float) -> ModelsInUse:
    return said(second, counts, beside=[ONE], role="shadow")


def kept(folder: Path) -> ModelsFile:
    return ModelsFile(folder, lambda: 7)


def test_looking_makes_nothing(tmp_path: Path) -> None:
    kept(tmp_path / "shelf").take(said(1))
    assert not (tmp_path / "shelf").exists()


def test_what_the_brain_uses_is_what_it_starts_with_next(tmp_path: Path) -> None:
    file, shelf = kept(tmp_path), Shelf(tmp_path)
    file.take(shadow(1))
    assert shelf.pointer().shadow == ONE
    file.take(said(2, active=[ONE], beside=[], role="former", former=[]))
    assert shelf.pointer().active == [ONE]
    assert shelf.pointer().former == []
    assert shelf.pointer().generation == 1
    file.take(said(3, rolled_back="not finite"))
    pointer = shelf.pointer()
    assert (pointer.active, pointer.former, pointer.rolled_back) == ([], None, "not finite")
    assert [turn.why for turn in pointer.history] == ["a person", "not finite"]
    assert pointer.history[0].unix_ns == 7


def test_a_brain_that_found_no_set_changes_no_pointer(tmp_path: Path) -> None:
    Shelf(tmp_path).change(lambda _: Pointer(active=[ONE], former=[]), "x", 1)
    kept(tmp_path).take(said(1, role=LOST, rolled_back="set is not there"))
    assert Shelf(tmp_path).pointer().active == [ONE]


def test_the_pointer_is_written_before_the_answer_goes_out() -> None:
    records = [CommandReply(1, True, []), said(1)]
    assert [type(r).__name__ for r in in_order(Stage.BRAIN, records)] == [
        "ModelsInUse",
        "CommandReply",
    ]


def test_counts_of_several_runs_add_up(tmp_path: Path) -> None:
    file = kept(tmp_path)
    file.take(shadow(1, decisions=3.0))
    file.take(shadow(2, decisions=5.0, agreed=4.0))
    assert file.compared() == {"decisions": 5.0, "agreed": 4.0}
    file.take(shadow(3, decisions=2.0))  # another brain
    assert file.compared() == {"decisions": 7.0, "agreed": 4.0}
    file.close()
    again = kept(tmp_path)  # another gate, and another brain
    again.take(shadow(1, decisions=1.0))
    assert again.compared() == {"decisions": 8.0, "agreed": 4.0}
    again.take(said(2, {"decisions": 9.0}, beside=[TWO], role="shadow"))
    assert again.compared() == {"decisions": 9.0}  # of this pair
    again.close()
    assert read_compared(tmp_path) == {
        f"|{ONE}": {"decisions": 8.0, "agreed": 4.0},
        f"|{TWO}": {"decisions": 9.0},
    }


def test_counts_reach_the_disk_now_and_then(tmp_path: Path) -> None:
    file = kept(tmp_path)
    for second in range(25):
        file.take(shadow(second + 1, decisions=float(second + 1)))
    at_least = 25 - WRITE_EVERY_NS // S
    assert read_compared(tmp_path)[f"|{ONE}"]["decisions"] >= at_least


def test_a_full_disk_is_told_and_made_good(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = kept(tmp_path)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(durable.os, "write", full)
    file.take(shadow(1, decisions=1.0))
    assert "No space left on device" in file.trouble
    monkeypatch.undo()
    file.take(shadow(2, decisions=2.0))
    assert file.trouble == ""
    assert Shelf(tmp_path).pointer().shadow == ONE


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "compared.json").write_text("{")
    assert "compared.json: cannot be used" in kept(tmp_path).trouble
    (tmp_path / "pointer.json").write_text("{")
    file = kept(tmp_path)
    file.take(shadow(1))
    assert "pointer.json: cannot be used" in file.trouble
    assert (tmp_path / "pointer.json").read_text() == "{"


def test_a_wish_about_models() -> None:
    request = parse(1, "models", {"action": "shadow", "set": ONE}, "test")
    assert (request.action, request.target) == ("shadow", ONE)
    assert parse(1, "models", {"action": "rollback"}, "test").target == ""
    for wrong in (
        None,
        "promote",
        {"action": "delete"},
        {"action": "shadow", "set": "../etc"},
        {"action": "shadow", "sets": ONE},
    ):
        with pytest.raises(MalformedCommandError, match=r"models: .*shadow"):
            parse(1, "models", wrong, "test")
