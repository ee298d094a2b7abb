"""The kill matrix: its arithmetic by default, one trial of each cell as a slow test."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.gate.recorder import Recorder
from firmware_py.records import DeviceHeartbeat, Event

from . import kill_matrix
from .kill_matrix import Seen, Trial, lost_events, missing, read, table

MS = 1_000_000


def made(victim: str, kind: str, ok: bool = True) -> Trial:
    return Trial(victim, kind, 100.0, 180.0, ok, False, 900.0, 950.0, 3.0)


def test_what_is_missing_is_made_up_ten_to_a_device() -> None:
    done = [made("guard", "KILL")] * 17 + [made("rig", "STOP")] * 30
    cells = list(missing(done, 30))
    assert cells[:2] == [("guard", "KILL", 10), ("guard", "KILL", 3)]
    assert sum(count for _, _, count in cells) == 8 * 30 - 47
    assert not [cell for cell in cells if cell[:2] == ("rig", "STOP")]


def test_an_interrupted_file_is_read_on_and_its_half_line_left_out(tmp_path: Path) -> None:
    path = tmp_path / "kills.jsonl"
    assert read(path) == ([], 0)
    lines = [
        json.dumps(vars(made("gate", "KILL"))),
        json.dumps({"lost_events": 2}),
        '{"victim": "ga',
    ]
    path.write_text("\n".join(lines))
    assert read(path) == ([made("gate", "KILL")], 2)


def test_the_table_has_a_line_for_each_cell() -> None:
    lines = table(
        [made("guard", "KILL"), made("guard", "KILL", ok=False), made("rig", "STOP")], 0
    ).splitlines()
    assert len(lines) == 4
    assert "1/2" in lines[1]
    assert lines[-1] == "lost acknowledged events: 0"


@pytest.mark.parametrize(
    ("seqs", "lost"), [((1, 2, 3), 0), ((1, 2, 4), 1), ((2, 3), 1), ((1, 2, 1, 2), 0), ((), 0)]
)
def test_a_hole_in_the_numbers_is_a_lost_event(
    tmp_path: Path, seqs: tuple[int, ...], lost: int
) -> None:
    recorder = Recorder(tmp_path, "lab-bench-default", {}, 10**8, lambda: 0)
    for t_ns, seq in enumerate(seqs, start=1):
        recorder.write(Event(seq, t_ns * MS, 0, "x", "x"), t_ns * MS)
    recorder.close()
    assert lost_events(tmp_path) == lost


def test_the_permit_gap_is_between_heartbeats_that_grant() -> None:
    def beat(permit: bool) -> DeviceHeartbeat:
        return DeviceHeartbeat(0, 1, 0, 0, permit, False)

    seen = Seen(
        beats=[
            (0, beat(True)),
            (50 * MS, beat(False)),
            (900 * MS, beat(True)),
            (950 * MS, beat(True)),
        ]
    )
    assert kill_matrix._permit_gap_ms(seen, 20 * MS) == 900.0
    assert kill_matrix._permit_gap_ms(seen, 960 * MS) is None


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_one_trial_of_each_victim_and_signal(tmp_path: Path) -> None:
    """Every reaction is within its bar, the machine never coasts down, and no acknowledged event is
    lost."""
    command = [
        sys.executable,
        kill_matrix.__file__,
        "--repeats",
        "1",
        "--out",
        str(tmp_path / "kills.jsonl"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-1000:]
    assert len(read(tmp_path / "kills.jsonl")[0]) == 8
