"""What survives the guard: trips, timers, starts; on good disks and bad ones."""

import json
import os
import socket
import stat
import threading
import time
from collections.abc import Callable
from copy import copy
from pathlib import Path

import pytest

from firmware_py.guard.process.memory import (
    STARTS,
    TIMERS,
    TRIPS,
    Memory,
    StartRecord,
    begin,
    boot_id,
    complain,
)
from firmware_py.guard.process.small_file import BYTES_MAX, FileWriter, write_durable
from firmware_py.guard.protection.permit import UNREADABLE, Start

S = 1_000_000_000
BOOT = "a" * 32


def memory(folder: Path, now_s: float = 1000.0, boot: str = BOOT) -> Memory:
    now_ns = round(now_s * S)
    return Memory(folder, boot=boot, boottime_ns=now_ns, monotonic_ns=now_ns)


def crash(left: Memory) -> None:
    """Killed: what was handed over reaches the disk, nothing says goodbye."""
    left._writer.close()


def note(
    kept: Memory,
    tripped: list[str] | None = None,
    timers: dict[str, int] | None = None,
    now_s: float = 1000.0,
    *,
    barred: bool | None = None,
    probation: bool = True,
) -> None:
    bar = kept.start.barred if barred is None else barred
    kept.note(round(now_s * S), tripped or [], timers or {}, bar, probation)


def until(holds: Callable[[], bool], within_s: float = 10.0) -> None:
    end = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


# ------------------------------------------------------------------ trips


def test_trips_survive_a_crash_and_are_forgotten_after_a_reset(tmp_path: Path) -> None:
    first = memory(tmp_path)
    assert first.latched == []
    note(first, ["disp_x_danger"])
    crash(first)
    second = memory(tmp_path)
    assert second.latched == ["disp_x_danger"]
    note(second, [])
    second.close()
    assert memory(tmp_path).latched == []
    assert not [p for p in tmp_path.iterdir() if p.name.endswith(".new")]


def test_a_channel_in_capitals_keeps_its_trip(tmp_path: Path) -> None:
    first = memory(tmp_path)
    note(first, ["VIB_X_danger", "shaft_trip"], {"TE/101_danger": 5})
    crash(first)
    second = memory(tmp_path)
    assert second.latched == ["VIB_X_danger", "shaft_trip"]
    assert second.complaints == []


def folder_in_its_place(path: Path) -> None:
    path.mkdir()
    (path / "something").write_text("x")


BAD_FILES: dict[str, Callable[[Path], object]] = {
    "empty": lambda p: p.write_bytes(b""),
    "zeros": lambda p: p.write_bytes(b"\0" * 24),
    "half": lambda p: p.write_bytes(b'["disp_x_dan'),
    "junk": lambda p: p.write_bytes(bytes(range(256))),
    "utf-16": lambda p: p.write_bytes('["disp_x_danger"]'.encode("utf-16")),
    "object": lambda p: p.write_bytes(b'{"disp_x_danger": true}'),
    "numbers": lambda p: p.write_bytes(b"[1, 2]"),
    "null": lambda p: p.write_bytes(b"null"),
    "name of nothing": lambda p: p.write_bytes(b'[""]'),
    "name with control characters": lambda p: p.write_bytes(b'["a\\u0000b"]'),
    "too many": lambda p: p.write_bytes(json.dumps([f"alarm_{i}" for i in range(65)]).encode()),
    "deep": lambda p: p.write_bytes(b"[" * 5000),
    "huge": lambda p: p.write_bytes(b" " * (BYTES_MAX + 1) + b"[]"),
    "folder": folder_in_its_place,
    "link to itself": lambda p: p.symlink_to(p),
    "link elsewhere": lambda p: p.symlink_to("/dev/zero"),
    "link to a good file": lambda p: (
        p.with_name("other").write_bytes(b"[]"),
        p.symlink_to(p.with_name("other")),
    ),
    "pipe": lambda p: os.mkfifo(p),
    "socket": lambda p: socket.socket(socket.AF_UNIX).bind(str(p)),
}


@pytest.mark.parametrize("name", [TRIPS, TIMERS, STARTS])
@pytest.mark.parametrize("damage", BAD_FILES)
def test_a_damaged_file_ends_nothing_is_told_and_heals_with_the_next_write(
    tmp_path: Path, name: str, damage: str
) -> None:
    """Of trips it stands latched that nobody knows; of starts it counts as a restart; timers begin
    anew."""
    BAD_FILES[damage](tmp_path / name)
    found = memory(tmp_path)
    assert len(found.complaints) == 1
    assert name in found.complaints[0]
    assert found.latched == ([UNREADABLE] if name == TRIPS else [])
    assert found.start == Start(restart=name == STARTS)
    assert found.timers == {}
    note(found, ["acc_motor_danger"], {"disp_x_danger": 5}, now_s=2000.0)
    crash(found)
    again = memory(tmp_path, 2001.0)
    assert not again.complaints
    assert (again.latched, again.timers) == (["acc_motor_danger"], {"disp_x_danger": 5})


def test_each_file_that_cannot_be_read_is_one_line_of_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in (TRIPS, TIMERS):
        (tmp_path / name).write_text("junk")
    complain(memory(tmp_path))
    lines = capsys.readouterr().err.splitlines()
    assert [name in line for name, line in zip((TRIPS, TIMERS), lines, strict=True)] == [True, True]
    assert all(line.startswith("orbitd guard: ") for line in lines)


def test_what_nobody_may_read_stands_as_unreadable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / TRIPS).write_text("[]")
    real = os.open

    def refuse(path: object, *rest: int, **more: int) -> int:
        if str(path).endswith(TRIPS):
            raise PermissionError(13, "Permission denied")
        return real(path, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "open", refuse)
    assert memory(tmp_path).latched == [UNREADABLE]


def test_a_read_that_fails_half_way_stands_as_unreadable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / TRIPS).write_text("[]")

    def broken(handle: int, size: int) -> bytes:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patched:
        patched.setattr("firmware_py.guard.process.small_file.os.read", broken)
        found = memory(tmp_path)
    assert found.latched == [UNREADABLE]
    assert "Input/output error" in found.complaints[0]


# ------------------------------------------------------------------ starts


def run_of(*starts: tuple[float, str], asked_to_stop: bool = False) -> list[StartRecord]:
    records: list[StartRecord] = []
    before: StartRecord | None = None
    for at_s, boot in starts:
        before = begin(before, boot, round(at_s * S))
        records.append(copy(before))
        before.running = not asked_to_stop
    return records


def test_the_second_restart_within_ten_minutes_bars() -> None:
    assert [r.barred for r in run_of((0, "a"), (100, "a"), (699, "a"))] == [False, False, True]


def test_restarts_more_than_ten_minutes_apart_do_not_bar() -> None:
    assert not any(r.barred for r in run_of((0, "a"), (100, "a"), (701, "a"), (1400, "a")))


def test_a_stop_that_was_asked_for_is_no_restart() -> None:
    assert not any(r.restarts_ns for r in run_of(*[(t, "a") for t in range(5)], asked_to_stop=True))


@pytest.mark.parametrize("boots", ["ab", "bb"])
def test_a_start_after_a_boot_of_the_host_is_cold(boots: str) -> None:
    """Another boot id; or none that differs, but a clock that began again."""
    starts = (500.0, boots[0]), (5.0, boots[1])
    assert run_of(*starts)[-1].restarts_ns == []


def test_the_bar_outlasts_further_starts_and_boots() -> None:
    assert [r.barred for r in run_of((0, "a"), (1, "a"), (2, "a"), (5000, "a"), (1, "b"))][2:] == [
        True
    ] * 3


def test_a_record_that_cannot_be_written_is_a_fault_at_once(tmp_path: Path) -> None:
    found = memory(tmp_path / "absent")
    until(lambda: "starts.json" in found.fault)
    note(found, ["a"])
    until(lambda: found.failures >= 2)
    (tmp_path / "absent").mkdir()
    until(lambda: not found.fault)
    crash(found)
    assert memory(tmp_path / "absent").latched == ["a"]


def test_killed_twice_bars_until_a_person_has_looked(tmp_path: Path) -> None:
    crash(memory(tmp_path, 0.0))
    first = memory(tmp_path, 10.0)
    assert first.start == Start(restart=True)
    note(first)
    crash(first)
    second = memory(tmp_path, 20.0)
    assert second.start == Start(restart=True, barred=True)
    note(second)
    crash(second)
    third = memory(tmp_path, 30.0)
    assert third.start.barred
    note(third, barred=False, probation=False)
    crash(third)
    assert memory(tmp_path, 40.0).start == Start(restart=True)


def test_stopped_as_told_is_a_cold_start(tmp_path: Path) -> None:
    memory(tmp_path, 0.0).close()
    assert memory(tmp_path, 1.0).start == Start()


def test_the_boot_id_is_the_services_or_the_kernels(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ORBITD_BOOT_ID", "ab-cd")
    assert boot_id() == "abcd"
    monkeypatch.delenv("ORBITD_BOOT_ID")
    monkeypatch.setattr("firmware_py.guard.process.memory.BOOT_FILE", tmp_path / "absent")
    assert boot_id() == ""


# ------------------------------------------------------------------ timers


def test_running_timers_survive_a_crash_but_not_a_boot_nor_two_minutes(tmp_path: Path) -> None:
    left = memory(tmp_path)
    note(left, timers={"disp_x_danger": 2 * S})
    crash(left)
    assert memory(tmp_path, 1100.0).timers == {"disp_x_danger": 2 * S}
    assert memory(tmp_path, 1121.0).timers == {}
    assert memory(tmp_path, 999.0).timers == {}, "written in the future"
    assert memory(tmp_path, 1001.0, boot="b").timers == {}


def test_timers_go_to_the_disk_at_most_ten_times_a_second(tmp_path: Path) -> None:
    left = memory(tmp_path)
    handed: list[str] = []
    left._writer.keep = lambda path, data: handed.append(path.name)  # type: ignore[method-assign]
    for ms in range(1000):
        note(left, timers={"disp_x_danger": ms}, now_s=1000.0 + ms * 1e-3)
    assert 9 <= handed.count(TIMERS) <= 11


# ------------------------------------------------------------------ the disk


def test_a_write_is_synchronised_before_it_is_renamed_and_then_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    did: list[str] = []
    replace = Path.replace

    def synchronised(handle: int) -> None:
        did.append("fsync folder" if stat.S_ISDIR(os.fstat(handle).st_mode) else "fsync file")

    def renamed(old: Path, new: Path) -> Path:
        did.append("rename")
        return replace(old, new)

    monkeypatch.setattr(os, "fsync", synchronised)
    monkeypatch.setattr(Path, "replace", renamed)
    write_durable(tmp_path / TRIPS, b"[]")
    assert did == ["fsync file", "rename", "fsync folder"]


@pytest.mark.timing
@pytest.mark.parametrize("cause", [28, 30, 5], ids=["disk full", "read-only", "input/output error"])
def test_a_disk_that_refuses_is_a_fault_tried_again_and_never_waited_for(
    tmp_path: Path, cause: int
) -> None:
    broken = [True]

    def write(path: Path, data: bytes) -> None:
        if broken:
            time.sleep(0.05)
            raise OSError(cause, os.strerror(cause))
        write_durable(path, data)

    keeper = FileWriter(write)
    began = time.monotonic()
    for k in range(1000):
        keeper.keep(tmp_path / TRIPS, b"[%d]" % k)
    assert time.monotonic() - began < 0.05 * 10, "the loop waited for the disk"
    until(lambda: keeper.failures >= 2)
    assert os.strerror(cause) in keeper.fault
    broken.clear()
    until(lambda: not keeper.fault)
    keeper.close()
    assert (tmp_path / TRIPS).read_bytes() == b"[999]"


def test_a_half_written_file_is_never_put_in_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_durable(tmp_path / TRIPS, b'["a"]')

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_durable(tmp_path / TRIPS, b'["b"]')
    assert [p.name for p in tmp_path.iterdir()] == [TRIPS]
    assert (tmp_path / TRIPS).read_bytes() == b'["a"]'


@pytest.mark.parametrize("how", ["removed", "emptied", "replaced"])
def test_a_file_that_somebody_took_away_is_written_again(
    tmp_path: Path, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("firmware_py.guard.process.small_file.CHECK_S", 0.05)
    path = tmp_path / TRIPS
    keeper = FileWriter()
    keeper.keep(path, b'["a"]')
    until(lambda: keeper.kept(path))
    if how == "emptied":
        path.write_bytes(b"")
    else:
        path.unlink()
        if how == "replaced":
            path.mkdir()
    until(lambda: path.is_file() and path.read_bytes() == b'["a"]')
    keeper.close()
    kept_folders = [
        p.name for p in tmp_path.iterdir() if p.is_dir() and p.name.startswith(f"{TRIPS}.folder.")
    ]
    assert len(kept_folders) == (how == "replaced")


def test_a_keeper_that_was_never_used_has_nothing_to_close() -> None:
    keeper, threads = FileWriter(), threading.active_count()
    keeper.close()
    assert threading.active_count() == threads
    assert (keeper.fault, keeper.failures) == ("", 0)
