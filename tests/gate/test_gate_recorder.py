"""The recorder on real disks, full ones included, and the files that it leaves behind."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from firmware_py.gate.recorder import FILES_KEPT, QUEUE_RECORDS, Recorder
from firmware_py.recording import Recording, RecordingError, WallClock, decode_exact
from firmware_py.records import Cycle, CycleRecord, Diagnosis, Event, EventAck, RawFrame, Snapshot

UNIX_NS = 1_800_000_000_000_000_000


def cycle(seq: int) -> CycleRecord:
    frame = RawFrame(arrival_ns=seq * 1_000_000, frame_id=0xC0, data=seq.to_bytes(8, "little") * 8)
    return CycleRecord(
        cycle=Cycle(
            seq=seq,
            now_ns=seq * 1_000_000,
            frames=[frame],
            advice=None,
            commands=[],
            brain_connected=True,
            gate_connected=True,
            link_up=True,
        ),
        frames_out=[frame],
        events=[],
    )


def recorder(folder: Path, max_bytes: int = 10**8) -> Recorder:
    return Recorder(
        folder,
        "test",
        {"config": "{}", "orbitd": "x"},
        max_bytes,
        lambda: UNIX_NS + time.monotonic_ns(),
    )


def wait_for(condition, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "never came"
        time.sleep(0.01)


def stored_cycles(path: Path) -> list[CycleRecord]:
    return [
        decode_exact(m, CycleRecord) for m in Recording(path).messages() if m.topic == "guard/cycle"
    ]


def test_what_is_written_comes_back_bit_by_bit(tmp_path):
    written = [cycle(seq) for seq in range(500)]
    snapshot = Snapshot(seq=3, now_ns=3, state=bytes(range(256)))
    diagnosis = Diagnosis(
        seq=1,
        t_acq_ns=1,
        quality=0,
        verdict="x",
        probability=0.1 + 0.2,
        heads={},
        classes={},
        doubt=False,
        unknown=False,
        evidence={"a": float("nan")},
        model="m",
    )
    made = recorder(tmp_path)
    for record in [*written, snapshot, diagnosis, WallClock(t_ns=1, unix_ns=2)]:
        assert made.write(record, 77)
    made.close()
    recording = Recording(next(tmp_path.glob("*.mcap")))
    assert recording.metadata["orbitd"] == "x"
    messages = list(recording.messages())
    assert not recording.interrupted
    assert [decode_exact(m, CycleRecord) for m in messages if m.topic == "guard/cycle"] == written
    assert [decode_exact(m, Snapshot) for m in messages if m.topic == "guard/snapshot"] == [
        snapshot
    ]
    told = msgspec.json.decode(next(m.data for m in messages if m.topic == "ha/diagnosis"))
    assert told["probability"] == 0.1 + 0.2
    assert told["evidence"] == {"a": None}


def test_a_file_cut_anywhere_gives_all_complete_chunks_and_no_error(tmp_path):
    made = recorder(tmp_path / "whole")
    for seq in range(600):
        made.write(cycle(seq), seq)
    made.close()
    data = next((tmp_path / "whole").glob("*.mcap")).read_bytes()
    counts = []
    for cut in range(3000, len(data), 211):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:cut])
        recording = Recording(path)
        counts.append(sum(m.topic == "guard/cycle" for m in recording.messages()))
        assert recording.interrupted
    assert counts == sorted(counts)
    assert counts[-1] == 600


def test_a_killed_process_leaves_a_readable_file(tmp_path):
    program = f"""
import time
from pathlib import Path
from tests.gate.test_gate_recorder import cycle, recorder
made = recorder(Path({str(tmp_path)!r}))
seq = 0
while True:
    ticket = made.write(cycle(seq), seq)
    seq += 1
    if made.stored > 1000: print(made.stored, flush=True)
    time.sleep(0.0002)
"""
    child = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert child.stdout is not None
    stored = int(child.stdout.readline())
    child.kill()
    child.wait()
    recording = Recording(next(tmp_path.glob("*.mcap")))
    cycles = sum(m.topic == "guard/cycle" for m in recording.messages())
    assert recording.interrupted
    assert cycles >= stored


def test_a_full_disk_is_visible_costs_nothing_and_heals(tmp_path):
    program = f"""
import resource, time
from pathlib import Path
from tests.gate.test_gate_recorder import cycle, recorder, wait_for
resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, resource.RLIM_INFINITY))
made = recorder(Path({str(tmp_path)!r}))
for seq in range(3000):
    started = time.perf_counter()
    made.write(cycle(seq), seq)
wait_for(lambda: made.trouble)
print(made.trouble, flush=True)
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
wait_for(lambda: made.stored > 2000)
assert made.trouble == "" and made.counters["recorder_failures"] >= 1
made.close()
assert made.stored == 3000, made.stored
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert done.returncode == 0, done.stderr
    assert "free or change the disk" in done.stdout
    found = {c.cycle.seq for path in tmp_path.glob("*.mcap") for c in stored_cycles(path)}
    assert found == set(range(3000))


def test_a_directory_that_cannot_be_made_is_visible_and_losses_are_counted(tmp_path):
    (tmp_path / "file").write_text("in the way")
    made = recorder(tmp_path / "file" / "folder")
    for seq in range(QUEUE_RECORDS + 5):
        made.write(cycle(seq), seq)
    wait_for(lambda: made.trouble)
    made.close()
    assert made.counters["recorder_lost"] == 5
    assert made.stored == 0


def test_files_are_rotated_and_the_oldest_go_first_while_others_stay(tmp_path):
    stranger = tmp_path / "orbitd-other-1.mcap"
    stranger.write_bytes(bytes(10**6))
    made = recorder(tmp_path, max_bytes=400_000)
    seen: set[Path] = set()
    for seq in range(30_000):
        record = cycle(seq)
        frame = msgspec.structs.replace(
            record.frames_out[0], data=(seq * 0x9E3779B97F4A7C15 % 2**512).to_bytes(64)
        )
        while not made.write(msgspec.structs.replace(record, frames_out=[frame]), seq):
            time.sleep(0.01)
        seen |= {made.path} - {None}
    made.close()
    ours = sorted(tmp_path.glob("orbitd-test-*.mcap"))
    assert len(seen) > len(ours)
    assert sum(path.stat().st_size for path in ours) <= 400_000 * (1 + 1 / FILES_KEPT)
    assert stranger.exists()
    last = [c.cycle.seq for c in stored_cycles(ours[-1])] or [
        c.cycle.seq for c in stored_cycles(ours[-2])
    ]
    assert last[-1] == 29_999


@pytest.mark.parametrize(
    "content", [b"", b"no mcap at all", bytes(100_000), bytes(range(256)) * 500]
)
def test_what_is_no_recording_is_named(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="metadata"):
        Recording(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RecordingError, match="cannot be read"):
        Recording(tmp_path / "none.mcap")


def test_events_are_acknowledged_once_they_are_stored(recording_stage, make_state):
    stage = recording_stage
    stage.guard.send("gate", Event(seq=9, t_ns=1, severity=0, name="x", text="x"))
    stage.until(lambda: stage.gate.view.events() != [])
    assert not [r for r in stage.heard if isinstance(r, EventAck)]

    def flooded():
        for _ in range(20):
            stage.guard.send("gate", make_state())
        return any(isinstance(r, EventAck) for r in stage.heard)

    stage.until(flooded, "an acknowledgement")
    assert [r.seq for r in stage.heard if isinstance(r, EventAck)] == [9]


EPOCH_NS, IN_2023_NS, FOREVER_NS = 0, 1_700_000_000 * 10**9, 10**30


def written(folder: Path, unix_ns: int, files: int = 3) -> list[str]:
    """Names of ``files`` files, each started anew as after a restart, all at the same calendar
    time."""
    names = []
    for _ in range(files):
        made = Recorder(folder, "test", {}, 10**6, lambda: unix_ns)
        made.write(cycle(1), 1)
        wait_for(lambda made=made: made.path is not None)
        assert made.path is not None
        names.append(made.path.name)
        made.close()
        (folder / names[-1]).write_bytes(bytes(200_000))
    return names


@pytest.mark.parametrize(
    "calendars",
    [
        (IN_2023_NS, EPOCH_NS),
        (EPOCH_NS, EPOCH_NS),
        (IN_2023_NS, IN_2023_NS),
        (FOREVER_NS, -FOREVER_NS),
        (IN_2023_NS, IN_2023_NS - 3_600 * 10**9),
    ],
)
def test_what_was_written_first_goes_first_whatever_the_calendar_says(tmp_path, calendars):
    first, second = (written(tmp_path, unix_ns) for unix_ns in calendars)
    assert len({*first, *second}) == 6, "a name was used twice"
    left = {path.name for path in tmp_path.glob("*.mcap")}
    assert set(second) <= left
    assert left - set(second) == set(first[1:]), "the others of the first run still fit"


def test_names_of_before_are_the_oldest_and_whatever_is_not_ours_stays(tmp_path):
    old = [f"orbitd-test-2023010{day}T000000.000000Z.mcap" for day in (1, 2, 3)]
    others = [
        "orbitd-test-b-00000001-20230101T000000.000000Z.mcap",
        "orbitd-test-notes.mcap",
        "orbitd-test-00000001-x.mcap",
        "orbitd-test-7-20230101T000000.000000Z.mcap",
        "orbitd-test-00000001-20230101T000000.000000Z.mcap.part",
    ]
    for name in [*old, *others]:
        (tmp_path / name).write_bytes(bytes(300_000))
    in_its_place = tmp_path / "orbitd-test-00000009-20230101T000000.000000Z.mcap"
    in_its_place.mkdir()
    (tmp_path / "orbitd-test-00000008-20230101T000000.000000Z.mcap").symlink_to(
        tmp_path / others[0]
    )
    made = written(tmp_path, EPOCH_NS, 1)[0]
    assert "-00000010-" in made, "above every number that is there"
    left = {path.name for path in tmp_path.iterdir()}
    assert left & set(old) == set(old[1:])
    assert {*others, in_its_place.name, made} <= left


def test_files_that_others_remove_and_missing_numbers_are_no_trouble(tmp_path):
    names = written(tmp_path, IN_2023_NS, 2)
    for name in names:
        (tmp_path / name).unlink()
    made = recorder(tmp_path, 10**6)
    made.write(cycle(1), 1)
    made.close()
    assert made.trouble == ""
    assert len(list(tmp_path.glob("*.mcap"))) == 1


def test_a_folder_that_cannot_be_read_is_named_and_left_as_it_is(tmp_path, monkeypatch):
    def refuse(_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("firmware_py.gate.recorder.os.scandir", refuse)
    made = recorder(tmp_path)
    made.write(cycle(1), 1)
    wait_for(lambda: made.trouble)
    assert "Permission denied" in made.trouble
    made.close()
    assert list(tmp_path.iterdir()) == []


def test_an_old_file_that_cannot_be_removed_does_not_cost_the_present_ones(tmp_path, monkeypatch):
    first = written(tmp_path, IN_2023_NS, 3)
    unlink = Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        if path.name in first:
            raise PermissionError(13, "Permission denied")
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    second = written(tmp_path, EPOCH_NS, 4)
    assert {*first, *second} <= {path.name for path in tmp_path.iterdir()}
    made = recorder(tmp_path, 10**6)
    made.write(cycle(1), 1)
    made.close()
    assert made.counters["recorder_not_removed"] > 0
    assert made.trouble == ""


def test_a_record_that_no_file_can_hold_is_counted_and_the_next_is_stored(tmp_path):
    made = recorder(tmp_path)
    made.write(
        msgspec.structs.replace(
            cycle(1), cycle=msgspec.structs.replace(cycle(1).cycle, now_ns=2**70)
        ),
        1,
    )
    made.write(cycle(2), 2)
    made.close()
    assert made.counters["recorder_lost"] == 1
    assert [c.cycle.seq for c in stored_cycles(next(tmp_path.glob("*.mcap")))] == [2]


def test_blocks_are_not_stored_twice(recording_stage, make_block):
    stage = recording_stage
    stage.guard.send("gate", make_block(1, bytes(16), 0))
    stage.guard.send("gate", cycle(1))
    stage.until(lambda: stage.gate.view.counters["in_CycleRecord"] == 1)
    stage.recorder.close()
    topics = [
        m.topic for m in Recording(next((stage.folder / "recordings").glob("*.mcap"))).messages()
    ]
    assert "guard/cycle" in topics
    assert "da/block" not in topics
