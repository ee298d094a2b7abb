"""Replay of recordings made by the whole device: the same decisions, the same diagnoses, or a named
difference."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from firmware_py import config
from firmware_py.brain.core import BrainCore
from firmware_py.brain.loop import cpu_features
from firmware_py.brain.store import load_models
from firmware_py.gate.loop import metadata, read_models
from firmware_py.gate.recorder import Recorder
from firmware_py.guard.core import GuardCore
from firmware_py.recording import Recordable, Recording, RecordingError, decode_exact
from firmware_py.records import (
    Advice,
    Block,
    BrainSnapshot,
    BrainState,
    BrainStep,
    CycleRecord,
    Diagnosis,
    Forecast,
    GuardState,
    RawFrame,
    RigReading,
    Snapshot,
    WindowRecord,
)
from firmware_py.replay.brain import BrainReplay, BrainReport
from firmware_py.replay.command import Report, main, replay, words
from firmware_py.replay.compare import NUMBER_TOLERANCE
from firmware_py.replay.decisions import DecisionReplay, Replayed
from firmware_py.replay.taken import read_steps
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.rigs import load_rig

BENCH = config.load(config.SHIPPED / "bench")[0]
UNIX_NS = 1_800_000_000_000_000_000
START_NS = 5_000_000_000
SESSION = 0xC0FFEE
BEGUN_CYCLES = 3_600


class Flight:
    """A short flight: arm, go to auto, lose the brain and get it back; a recorder that comes at
    3.1 s gets the brain's state."""

    def __init__(self, listener: Callable[[Recordable, int], None]) -> None:
        codec = codec_for(BENCH)
        rig_data = load_rig("bench")
        models = load_models(BENCH)
        self.brains: list[BrainCore] = []

        def make_brain() -> BrainCore:
            self.brains.append(BrainCore(BENCH, models, cpu_features()))
            return self.brains[-1]

        self.loop = ClosedLoop(
            Rig(rig_data, codec, node_limits(rig_data, BENCH), 7),
            GuardCore(BENCH, codec, SESSION),
            make_brain,
            [listener],
            START_NS,
        )

    def run(self) -> None:
        events: dict[int, Callable[[], object]] = {
            3100: lambda: self.brains[0].record_from_here(),
            2500: lambda: self.loop.command("mode", mode=2),
            2600: lambda: self.loop.command("arm"),
            4000: self.loop.kill_brain,
            4300: self.loop.start_brain,
        }
        for millisecond in range(7_000):
            events.get(millisecond, lambda: None)()
            self.loop.step()


@pytest.fixture(scope="session")
def flown() -> list[tuple[Recordable, int]]:
    """Everything that crossed a room's border, in order."""
    told: list[tuple[Recordable, int]] = []
    Flight(lambda record, now_ns: told.append((record, now_ns))).run()
    return told


@pytest.fixture(scope="session")
def begun(flown) -> list[tuple[Recordable, int]]:
    """The flight until shortly before its first brain dies: armed, with a recorder that came."""
    return [(record, t) for record, t in flown if t <= START_NS + BEGUN_CYCLES * 1_000_000]


@pytest.fixture(scope="session")
def decided(flown, tmp_path_factory) -> list[Replayed]:
    """Every cycle of the flight with the guard's decision."""
    recording = Recording(record(flown, tmp_path_factory.mktemp("decided")))
    return list(DecisionReplay(BENCH).run(recording))


@pytest.fixture(scope="session")
def decided_begun(decided) -> list[Replayed]:
    """Of :func:`begun`."""
    return decided[:BEGUN_CYCLES]


def brain_again(path: Path, decided: list[Replayed], features: str = "") -> BrainReport:
    """The brain's half of a replay of ``path``, on a machine with these CPU features."""
    steps = read_steps(Recording(path))
    again = BrainReplay(steps, BENCH, load_models(BENCH), features or cpu_features())
    for cycle in decided:
        again.step(cycle)
    return again.finish()


def record(told: list[tuple[Recordable, int]], folder: Path, models: object = None) -> Path:
    head = metadata(BENCH, read_models(BENCH) if models is None else models)
    made = Recorder(folder, "test", head, 10**9, lambda: UNIX_NS)
    for item, now_ns in told:
        if not isinstance(item, Block):
            assert made.write(item, now_ns)
    made.close()
    return next(folder.glob("*.mcap"))


def test_the_whole_flight_comes_back_bit_by_bit(flown, tmp_path, capsys):
    assert main([str(record(flown, tmp_path)), "--json"]) == 0
    report = msgspec.json.decode(capsys.readouterr().out, type=Report)
    assert report.decisions.cycles == 7_000
    assert report.decisions.segments == 1
    assert report.decisions.snapshots_compared == 6
    assert report.diagnoses is not None
    assert report.diagnoses.exact
    assert report.diagnoses.compared == report.diagnoses.recorded > 18
    assert report.brain is not None
    assert report.brain.segments == 2, "one a brain"
    assert report.brain.snapshots_compared == 1
    assert report.brain.steps_set_aside == report.brain.outputs_missing == 0
    assert report.brain.records_lost == 0
    assert report.brain.compared == report.brain.recorded
    assert report.brain.compared["ag/advice"] > 60
    assert report.brain.compared["pa/forecast"] > 50


def test_a_recording_that_begins_in_mid_flight_comes_back_from_its_first_snapshot(flown, tmp_path):
    late = [(r, t) for r, t in flown if t > START_NS + 234_000_000]
    report = replay(record(late, tmp_path))
    assert report.ok, report
    assert report.decisions.cycles_outside_segments == 766
    assert report.brain is not None
    assert report.brain.segments == 2, "from the recorder's coming on, and all of the second brain"
    later = [r for r, t in late if isinstance(r, Advice) and t >= START_NS + 3_101_000_000]
    assert report.brain.compared["ag/advice"] == len(later)
    assert report.diagnoses is not None
    assert report.diagnoses.compared >= 11
    assert report.diagnoses.set_aside > 5


def of_before(told):
    """The flight as a device recorded it that did not record the steps of its brain."""
    return [(r, t) for r, t in told if not isinstance(r, BrainStep | BrainSnapshot)]


def test_diagnoses_of_an_older_recording_come_back_bit_by_bit(flown, tmp_path):
    report = replay(record(of_before(flown), tmp_path))
    assert report.ok, report
    assert report.brain is None
    assert report.diagnoses is not None
    assert report.diagnoses.exact
    assert report.diagnoses.compared == report.diagnoses.recorded > 18


def test_an_older_recording_that_begins_in_mid_flight_sets_its_first_diagnoses_aside(
    flown, tmp_path
):
    late = [(r, t) for r, t in of_before(flown) if t > START_NS + 1_234_000_000]
    report = replay(record(late, tmp_path))
    assert report.ok, report
    assert report.diagnoses is not None
    assert report.diagnoses.compared >= 8, "all of the second brain's"
    assert report.diagnoses.set_aside > 5


def test_a_gap_starts_a_new_segment_and_is_counted(flown, tmp_path):
    holed = [(r, t) for r, t in flown if not 2_500_000_000 < t - START_NS < 2_600_000_000]
    report = replay(record(holed, tmp_path))
    assert report.decisions.segments == 2
    assert report.decisions.cycles_missing == 99
    assert report.decisions.different == 0
    assert report.ok, report
    assert report.brain is not None
    assert report.brain.segments == 2
    assert 65 < report.brain.steps_set_aside < 75, "until the next snapshot with all its samples"


def test_an_interrupted_recording_replays_up_to_its_end(begun, tmp_path):
    path = record(begun, tmp_path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    report = replay(path)
    assert report.interrupted
    assert report.ok, report
    assert 1000 < report.decisions.cycles < 2600


def third(data: bytes, share: float) -> int:
    """A place inside a chunk, at about ``share`` of the file."""
    return data.index(b"\x04\0\0\0zstd", round(share * len(data))) + 300


DAMAGES = {
    "the last blocks came back as zeros": lambda d: d[: len(d) * 2 // 3] + bytes(65_536),
    "zeros in the middle": lambda d: d[: len(d) // 2] + bytes(8192) + d[len(d) // 2 + 8192 :],
    "junk in the middle": lambda d: (
        d[: len(d) // 2] + bytes(range(256)) * 32 + d[len(d) // 2 + 8192 :]
    ),
    "a hole": lambda d: d[: len(d) // 2] + d[len(d) // 2 + 20_000 :],
    "a flipped bit": lambda d: (
        d[: third(d, 0.4)] + bytes([d[third(d, 0.4)] ^ 4]) + d[third(d, 0.4) + 1 :]
    ),
    "junk appended": lambda d: d + bytes(range(256)) * 32,
    "two places": lambda d: (
        bytes(64) + d[64 : third(d, 0.3)] + bytes(500) + d[third(d, 0.3) + 500 :]
    ),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_what_is_whole_in_a_damaged_recording_is_replayed_with_a_note(
    begun, tmp_path, capsys, name
):
    path = record(begun, tmp_path)
    path.write_bytes(DAMAGES[name](path.read_bytes()))
    assert main([str(path), "--json"]) == 0
    report = msgspec.json.decode(capsys.readouterr().out, type=Report)
    said = words(report)
    assert any(line.startswith("damage      bytes ") for line in said)
    assert said[-1].startswith("same decisions")
    assert report.decisions.cycles > BEGUN_CYCLES * 3 // 7
    assert report.decisions.different == report.decisions.snapshots_different == 0
    assert report.skipped_bytes > 0
    if report.decisions.segments > 1:
        assert report.decisions.cycles_missing > 0


@pytest.mark.parametrize(
    ("kept", "cause"),
    [
        (lambda item: not isinstance(item, CycleRecord), "no guard cycle is in it"),
        (lambda item: not isinstance(item, Snapshot), "follows a snapshot"),
    ],
)
def test_a_recording_in_which_nothing_can_be_replayed_is_exit_code_2(flown, tmp_path, kept, cause):
    path = record([(item, t) for item, t in flown[:6000] if kept(item)], tmp_path)
    with pytest.raises(RecordingError, match=cause) as refused:
        main([str(path)])
    assert refused.value.exit_code == 2


def changed(told, kind, change, which=1500):
    """``told`` with the ``which``-th record of ``kind`` changed."""
    out, count = [], 0
    for item, now_ns in told:
        if isinstance(item, kind):
            count += 1
            if count == which:
                item = change(item)
        out.append((item, now_ns))
    return out


def flip(frame: RawFrame) -> RawFrame:
    return msgspec.structs.replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1]))


def test_one_changed_bit_in_a_sent_frame_is_found_and_named(begun, tmp_path, capsys):
    sending = sum(1 for r, _ in begun if isinstance(r, CycleRecord) and r.frames_out)
    told, seen = [], 0
    for item, now_ns in begun:
        if isinstance(item, CycleRecord) and item.frames_out:
            seen += 1
            if seen == sending // 2:
                item = msgspec.structs.replace(
                    item, frames_out=[flip(item.frames_out[0]), *item.frames_out[1:]]
                )
        told.append((item, now_ns))
    path = record(told, tmp_path)
    assert main([str(path), "--json"]) == 1
    report = msgspec.json.decode(capsys.readouterr().out, type=Report)
    assert "NOT the same" in words(report)
    assert report.decisions.different == 1
    assert "frames_out" in report.decisions.first_difference


def test_a_changed_diagnosis_is_found(begun, tmp_path):
    told = changed(
        begun,
        Diagnosis,
        lambda d: msgspec.structs.replace(d, probability=d.probability + 1e-12),
        which=6,
    )
    report = replay(record(told, tmp_path))
    assert not report.ok
    assert report.diagnoses is not None
    assert report.diagnoses.different == 1
    told = of_before(told)
    report = replay(record(told, tmp_path / "older"))
    assert not report.ok
    assert report.diagnoses is not None
    assert report.diagnoses.different == 1


@pytest.mark.parametrize(
    ("kind", "field", "change"),
    [
        (Advice, "t_acq_ns", lambda v: v + 1),
        (Advice, "reasons", lambda v: [*v, "none"]),
        (Forecast, "power_W", lambda v: (v[0], v[1] * (1 + 1e-15), v[2])),
        (BrainState, "counters", lambda v: v | {"windows": v["windows"] + 1}),
    ],
)
def test_a_changed_word_of_the_brain_is_found_and_named(
    begun, decided_begun, tmp_path, kind, field, change
):
    def altered(r):
        return msgspec.structs.replace(r, **{field: change(getattr(r, field))})

    report = brain_again(record(changed(begun, kind, altered, which=3), tmp_path), decided_begun)
    assert not report.ok
    assert report.different == 1
    assert field in report.first_difference


def test_a_brain_that_took_something_else_is_found(begun, decided_begun, tmp_path):
    def without_reading(r: BrainStep) -> BrainStep:
        return msgspec.structs.replace(r, readings=[])

    victims = [r for r, _ in begun if isinstance(r, BrainStep) and r.readings]
    victim = victims[len(victims) // 3]
    told = [(without_reading(r) if r is victim else r, t) for r, t in begun]
    report = brain_again(record(told, tmp_path), decided_begun)
    assert not report.ok
    assert report.records_lost == 1


def test_what_the_recorder_lost_of_the_brain_is_counted_not_called_different(
    flown, decided, tmp_path
):
    lost = [id(r) for r, _ in flown if isinstance(r, Advice)][20:23]
    kept = [(r, t) for r, t in flown if id(r) not in lost]
    report = brain_again(record(kept, tmp_path), decided)
    assert report.ok, report
    assert report.outputs_missing == 3
    steps = [id(r) for r, _ in flown if isinstance(r, BrainStep)][100:101]
    kept = [(r, t) for r, t in flown if id(r) not in steps]
    report = brain_again(record(kept, tmp_path / "b"), decided)
    assert report.ok, report
    assert report.segments == 3, "the snapshot at 3.1 s begins another one"
    assert 50 < report.steps_set_aside < 60


def test_on_another_processor_the_brain_says_nearly_the_same(begun, decided_begun, tmp_path):
    def other(share: float):
        def altered(f: Forecast) -> Forecast:
            return msgspec.structs.replace(f, power_W=tuple(v * (1 + share) for v in f.power_W))

        return changed(begun, Forecast, altered, which=10)

    report = brain_again(record(other(NUMBER_TOLERANCE / 2), tmp_path), decided_begun, "other")
    assert report.ok, report
    assert not report.exact
    assert report.segments == 2, "restored at each snapshot"
    report = brain_again(
        record(other(NUMBER_TOLERANCE * 2), tmp_path / "far"), decided_begun, "other"
    )
    assert not report.ok
    assert report.first_difference.startswith("pa/forecast")


def test_a_guard_that_got_a_frame_that_was_not_recorded_is_found(begun, tmp_path):
    """The brain's snapshot that follows asks for samples which are not there this time."""

    def without_frames(r: CycleRecord) -> CycleRecord:
        return msgspec.structs.replace(r, cycle=msgspec.structs.replace(r.cycle, frames=[]))

    carrying = [(r, t) for r, t in begun if isinstance(r, CycleRecord) and r.cycle.frames]
    victim = carrying[len(carrying) // 2][0]
    told = [(without_frames(r) if r is victim else r, t) for r, t in begun]
    assert not replay(record(told, tmp_path)).ok


def test_other_models_leave_the_diagnoses_out_and_say_so(begun, tmp_path, capsys):
    path = record(begun, tmp_path, models={"classifier.onnx": "other"})
    assert main([str(path)]) == 0
    assert "not compared: the model files" in capsys.readouterr().out


def test_the_flight_was_eventful(flown):
    kinds = {type(r) for r, _ in flown}
    assert {CycleRecord, Snapshot, Block, RigReading, GuardState, Advice, WindowRecord} <= kinds
    assert any(r.arm_state == 3 for r, _ in flown if isinstance(r, GuardState)), "never armed"


def test_cycles_are_stored_exactly(flown, tmp_path):
    path = record(flown, tmp_path)
    stored = [
        decode_exact(m, CycleRecord) for m in Recording(path).messages() if m.topic == "guard/cycle"
    ]
    assert stored == [r for r, _ in flown if isinstance(r, CycleRecord)]
