import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_py.clock import SimClock
from firmware_py.guard import loop
from firmware_py.guard.core import GuardCore
from firmware_py.guard.loop import Guard, run
from firmware_py.guard.process.memory import Memory
from firmware_py.guard.process.outbox import Outbox
from firmware_py.guard.process.timing import Grid, Lateness
from firmware_py.notify import Notifier
from firmware_py.records import (
    Advice,
    Block,
    CommandReply,
    CommandRequest,
    CycleRecord,
    Event,
    EventAck,
    GuardState,
    PeerRecord,
    RawFrame,
    Snapshot,
    decode,
    encode,
)
from firmware_py.routing import Stage
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.disarm_socket import SOCKET, DisarmSocket
from firmware_py.wire.peers import PeerClient, PeerServer
from tests.first_schema import BENCH

from .scripted_node import MS, SESSION, ScriptedNode, bench

# ------------------------------------------------------------------ grid, lateness, outbox, trips


def test_the_grid_is_absolute_and_skips_whole_periods() -> None:
    grid = Grid(1000, 100)
    assert grid.advance(1010) == 1100
    assert grid.advance(1199) == 1200
    assert (grid.advance(1650), grid.skipped) == (1600, 3)
    assert (grid.advance(1655), grid.skipped) == (1700, 3)


@pytest.mark.parametrize(
    ("now_ns", "due_ns", "skipped"),
    [(1099, 1100, 0), (1100, 1100, 0), (1199, 1100, 0), (1200, 1200, 1)],
)
def test_a_point_is_skipped_only_when_the_next_one_is_due(
    now_ns: int, due_ns: int, skipped: int
) -> None:
    grid = Grid(1000, 100)
    assert (grid.advance(now_ns), grid.skipped) == (due_ns, skipped)


def test_lateness_percentiles() -> None:
    lateness = Lateness(1_000_000)
    for late_us in [10] * 98 + [500, 1001]:
        lateness.add(late_us * 1000)
    counters = lateness.counters()
    assert counters == {
        "cycles": 100,
        "cycles_late": 1,
        "lateness_p50_us": 20,
        "lateness_p99_us": 520,
        "lateness_max_us": 1001,
    }


def test_what_is_later_than_the_histogram_counts_in_its_last_bin() -> None:
    lateness = Lateness(1_000_000)
    assert lateness.percentile_us(0.99) == 20
    lateness.add(50_000_000)
    assert lateness.percentile_us(0.5) == lateness.percentile_us(0.99) == 10_000
    assert lateness.counters()["lateness_max_us"] == 50_000


def event(seq: int) -> Event:
    return Event(seq, 0, 0, "x", "x")


def test_events_wait_for_their_acknowledgement_and_overflow_is_counted() -> None:
    outbox = Outbox(capacity=5)
    for seq in range(1, 8):
        outbox.put(event(seq))
    assert outbox.dropped == 2
    outbox.acknowledge(4)
    assert [e.seq for e in outbox.waiting()] == [5, 6, 7]
    outbox.acknowledge(100)
    assert outbox.waiting() == []


def test_an_event_that_is_not_taken_is_told_again_in_its_order() -> None:
    outbox, told, full = Outbox(), list[int](), [False]

    def send(event: Event) -> bool:
        if not full[0]:
            told.append(event.seq)
        return not full[0]

    for seq in range(1, 5):
        outbox.put(event(seq))
    outbox.tell(send, 2)
    full[0] = True
    outbox.tell(send, 2)
    full[0] = False
    outbox.tell(send, 9)
    outbox.tell(send, 9)
    assert told == [1, 2, 3, 4]


# ---------------------------------------------------------- the shell on real rooms, simulated time


class NodeLink:
    """A link whose far end is the scripted node."""

    def __init__(self) -> None:
        self.node = ScriptedNode(bench())
        self.counters: dict[str, int] = {}
        self.up = True
        self.fault = ""

    def receive(self, now_ns: int) -> list[RawFrame]:
        return self.node.step(now_ns)

    def send(self, frame: RawFrame) -> bool:
        self.node.hear([frame])
        return True

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self.up = False


class House:
    """The guard's shell with two real clients."""

    def __init__(self, folder: Path) -> None:
        self.link = NodeLink()
        path = folder / "guard.sock"
        self.server = PeerServer(path, {"brain": None, "gate": None})
        self.disarm = DisarmSocket(folder / SOCKET)
        core = GuardCore(bench(), CanCodec(), SESSION)
        self.guard = Guard(core, self.link, self.server, self.disarm, Memory(folder))
        self.brain, self.gate = PeerClient(path, "brain"), PeerClient(path, "gate")
        self.clock = SimClock(1_000 * MS)
        self.heard: dict[str, list[PeerRecord]] = {"brain": [], "gate": []}
        self.link.node.step(self.clock.now_ns())

    def run(self, cycles: int) -> None:
        for _ in range(cycles):
            self.clock.sleep_until(self.clock.now_ns() + MS)
            self.guard.cycle(self.clock.now_ns())
            for name, client in (("brain", self.brain), ("gate", self.gate)):
                self.heard[name] += client.poll(self.clock.now_ns())

    def of(self, name: str, kind: type) -> list[PeerRecord]:
        return [r for r in self.heard[name] if isinstance(r, kind)]


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    made = House(tmp_path)
    yield made
    made.brain.close()
    made.gate.close()
    made.guard.close()


def test_rooms_hear_what_is_theirs(house: House) -> None:
    house.run(1200)
    assert len(house.of("brain", Block)) == len(house.of("gate", Block)) > 150
    assert len(house.of("gate", GuardState)) >= 11
    assert not house.of("brain", CycleRecord)
    cycles = house.of("gate", CycleRecord)
    seqs = [c.cycle.seq for c in cycles if isinstance(c, CycleRecord)]
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
    first = next(r for r in house.heard["gate"] if isinstance(r, (Snapshot, CycleRecord)))
    assert isinstance(first, Snapshot)
    assert first.seq == seqs[0]


def test_a_request_is_answered_and_the_brain_may_not_make_one(house: House) -> None:
    house.run(1200)
    house.brain.send(CommandRequest(7, "disarm"))
    house.gate.send(CommandRequest(8, "disarm"))
    house.run(3)
    assert house.of("gate", CommandReply) == [CommandReply(8, True, [])]


def test_a_record_that_the_guard_does_not_know_is_left_alone(
    house: House, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were the routing table to send it one more, the guard goes on."""
    house.run(1200)
    monkeypatch.setattr(loop, "receivers", lambda *_: (Stage.GUARD,))
    house.gate.send(Event(1, 0, 0, "x", "x"))
    house.gate.send(CommandRequest(8, "disarm"))
    house.run(3)
    assert house.of("gate", CommandReply) == [CommandReply(8, True, [])]


def test_a_disarm_from_its_own_room_is_obeyed_without_a_gate(house: House, tmp_path: Path) -> None:
    house.run(1200)
    house.gate.close()
    for k, wish in enumerate(("a", "b")):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock:
            sock.connect(str(tmp_path / SOCKET))
            sock.settimeout(0)
            sock.send(encode(CommandRequest(0, "disarm", id=wish)))
            house.run(11)
            assert decode(sock.recv(4096)) == CommandReply(-1 - k, True, [], wish)
    house.run(150)
    assert not house.of("gate", CommandReply)
    state = house.of("brain", GuardState)[-1]
    assert isinstance(state, GuardState)
    assert state.counters["disarm_asked"] == 2
    told = [event.text for event in house.guard._outbox.waiting()]
    assert f"disarm accepted from user {os.getuid()}" in told


def test_the_newest_of_two_advices_in_a_cycle_counts(house: House) -> None:
    house.run(1200)
    now_ns = house.clock.now_ns()
    for seq, reason in enumerate(("no window yet", "y" * 300)):
        house.brain.send(Advice(seq, now_ns, now_ns, 10**9, None, None, True, [reason], None))
    house.run(150)
    last = house.of("gate", GuardState)[-1]
    assert isinstance(last, GuardState)
    assert "y" * 200 in last.authority_reasons
    assert "no window yet" not in last.authority_reasons


def test_the_service_manager_hears_that_it_is_ready_works_and_stops(house: House) -> None:
    said: list[str] = []
    notifier = Notifier(None)
    notifier._send = said.append  # type: ignore[method-assign]
    beats = iter(range(450))
    run(house.guard, house.clock, notifier, lambda: next(beats) < 449)
    assert said == ["READY=1", "WATCHDOG=1", "WATCHDOG=1", "STOPPING=1"]


def test_the_gate_may_not_advise(house: House) -> None:
    house.run(1200)
    now_ns = house.clock.now_ns()
    house.gate.send(Advice(1, now_ns, now_ns, 10**9, 60.0, None, True, [], None))
    house.run(150)
    last = house.of("gate", GuardState)[-1]
    assert isinstance(last, GuardState)
    assert "the brain has given no advice yet" in last.authority_reasons


def test_events_are_told_again_to_a_gate_that_comes_back_until_it_has_them(house: House) -> None:
    house.run(1200)
    told = [e.seq for e in house.of("gate", Event) if isinstance(e, Event)]
    assert told
    house.gate.close()
    house.run(2)
    house.heard["gate"].clear()
    house.run(300)
    again = [e.seq for e in house.of("gate", Event) if isinstance(e, Event)]
    assert set(told) < set(again)
    house.gate.send(EventAck(max(again)))
    house.run(2)
    house.gate.close()
    house.run(2)
    house.heard["gate"].clear()
    house.run(300)
    assert not set(again) & {e.seq for e in house.of("gate", Event) if isinstance(e, Event)}


def test_the_loop_skips_and_counts_after_a_stall(house: House) -> None:
    beats = iter(range(100))

    def running() -> bool:
        k = next(beats)
        if k == 50:
            house.clock.sleep_until(house.clock.now_ns() + 20 * MS)
        return k < 99

    run(house.guard, house.clock, Notifier(None), running)
    assert house.guard.seq == 99
    assert 19 <= house.guard.skipped <= 20
    assert house.guard.timing.late == 1
    assert house.guard.timing.max_ns == 20 * MS


# ------------------------------------------------------------------ the real process


def test_the_process_starts_serves_and_stops_cleanly(tmp_path: Path) -> None:
    """The command as installed; no bus is there beyond its own hub, so it says what it lacks."""
    env = {**os.environ, "ORBITD_BUS_DIR": str(tmp_path), "OMP_NUM_THREADS": "1"}
    config = tmp_path / "rig.toml"
    config.write_text(BENCH.replace('"orbitd0"', '"guardtest"'))
    code = "import sys; from firmware_py.guard.loop import main; sys.exit(main(sys.argv[1:]))"
    command = [
        sys.executable,
        "-c",
        code,
        "--rig",
        str(config),
        "--runtime-dir",
        str(tmp_path / "rt"),
    ]
    process = subprocess.Popen(command, env=env, cwd=Path(__file__).resolve().parents[2])
    gate = PeerClient(tmp_path / "rt" / "guard.sock", "gate")
    try:
        found = _first_state(gate, process)
        assert found.counters["cycles"] > 0
        assert not found.authority
        assert found.counters["frames_in"] == 0
    finally:
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
        gate.close()
    assert json.loads((tmp_path / "rt" / "trips.json").read_text()) == []


def _first_state(gate: PeerClient, process: "subprocess.Popen[bytes]") -> GuardState:
    while process.poll() is None:
        for record in gate.poll(time.monotonic_ns()):
            if isinstance(record, GuardState):
                return record
        time.sleep(0.02)
    raise AssertionError(f"the guard ended with {process.returncode}")
