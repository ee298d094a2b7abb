"""The work of one guard cycle is bounded in every state: what it takes in, and what that costs."""

import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from struct import pack, unpack

import pytest

from firmware_py.guard import facts
from firmware_py.guard.process.budget import (
    CYCLE_US,
    EVENTS_PER_CYCLE,
    JUNK_US,
    PEER_LIMITS,
    REFERENCE_US,
    bounded,
)
from firmware_py.guard.process.outbox import Outbox
from firmware_py.guard.state import Stages
from firmware_py.records import (
    Advice,
    Command,
    CommandRequest,
    Cycle,
    DeviceHeartbeat,
    Event,
    Hello,
    RawFrame,
    SampleFrame,
    encode,
)
from firmware_py.wire.can_link import BATCH
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.mav_packet import Framer
from firmware_py.wire.peer_socket import MAX_WAITING, NEWCOMER
from firmware_py.wire.peers import PeerServer
from firmware_py.wire.serial_link import READ_BYTES

from ..scripted_node import MS, Bench, working

CODEC = CanCodec()
CYCLES = 300
pytestmark = pytest.mark.timing

# ----------------------------------------------------------------- microseconds, beside a reference


def reference() -> int:
    """Packing, unpacking and summing: what the guard's own code mostly does."""
    total = 0
    for i in range(1000):
        total += sum(unpack("<8h", pack("<8h", i, 2, 3, 4, 5, 6, 7, 8)))
    return total


def cost_s(work: Callable[[], object], rounds: int = 1) -> float:
    """Processor time of one round."""
    began = time.process_time_ns()
    for _ in range(rounds):
        work()
    return (time.process_time_ns() - began) * 1e-9 / rounds


class Fed:
    """The core of a bench, given only what a case wants beside (or instead of) the node's own
    frames."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.spent_s = 0.0
        step = bench.core.step

        def timed(cycle: Cycle) -> object:
            began = time.process_time_ns()
            decision = step(cycle)
            self.spent_s += (time.process_time_ns() - began) * 1e-9
            return decision

        bench.core.step = timed  # type: ignore[method-assign, assignment]

    def mean_s(self) -> float:
        self.spent_s = 0.0
        for _ in range(CYCLES):
            self.each(self.bench)
        return self.spent_s / CYCLES

    @staticmethod
    def each(b: Bench) -> None:
        b.cycle()


def disarmed(b: Bench) -> None:
    b.ask("disarm")


def tripped(b: Bench) -> None:
    b.node.amplitude_um = 40.0
    b.run(1.5)


def samples_gone(b: Bench) -> None:
    b.tamper = lambda frames: [f for f in frames if f.frame_id != 0x0C0]
    b.run(0.3)


def link_down(b: Bench) -> None:
    b.link_up = False
    b.run(0.3)


def node_gone(b: Bench) -> None:
    b.tamper = lambda frames: [f for f in frames if f.frame_id == 0x0C0]
    b.run(1.0)


def brain_gone(b: Bench) -> None:
    b.brain = False
    b.run(0.3)


def nothing(b: Bench) -> None:
    pass


def with_requests(b: Bench) -> None:
    """Eight a cycle, the worst mix: modes that alternate, arming, set points, and what nobody
    knows."""
    verbs = ("mode", "arm", "set_clearance", "announce", "nonsense", "mode", "arm", "reset")
    b.cycle([CommandRequest(i, verb, 70.0, (b.seq + i) % 3) for i, verb in enumerate(verbs)])


def with_advices(b: Bench) -> None:
    b.advice = lambda: bounded(  # type: ignore[method-assign]
        Advice(b.seq, b.now_ns, b.now_ns, 300 * MS, 70.0, None, True, ["x" * 1000] * 1000, None)
    )
    b.cycle()


def with_frames(make: Callable[[Bench, int], RawFrame]) -> Callable[[Bench], None]:
    def each(b: Bench) -> None:
        b.extra = [make(b, i) for i in range(BATCH)]
        b.cycle()

    return each


def of_nobody(b: Bench, i: int) -> RawFrame:
    return RawFrame(b.now_ns, 0x7FF if i % 2 else 0x0C0, bytes(64))


def forged(b: Bench, i: int) -> RawFrame:
    n = b.seq * BATCH + i
    if i % 2:
        return CODEC.encode(Command(n & 0xFFFF, 0x9999, 0, 120.0, 1.0), b.now_ns)
    return CODEC.encode(DeviceHeartbeat(n & 0xFFFF, 0x9999, 0, 2, True, False), b.now_ns)


def more_samples(b: Bench, i: int) -> RawFrame:
    n = b.seq * BATCH + i
    return CODEC.encode(
        SampleFrame(
            n & 0xFFFF, n * 600 & 0xFFFFFFFF, n * 600 & 0xFFFFFFFF, n & 0xFFFF, 2, bytes(range(48))
        ),
        b.now_ns,
    )


CASES: dict[str, tuple[Callable[[Bench], None], Callable[[Bench], None]]] = {
    "disarmed": (disarmed, Fed.each),
    "armed": (nothing, Fed.each),
    "tripped": (tripped, Fed.each),
    "samples gone": (samples_gone, Fed.each),
    "link down": (link_down, Fed.each),
    "node gone, samples left": (node_gone, Fed.each),
    "brain gone": (brain_gone, Fed.each),
    "requests, 8 a cycle": (nothing, with_requests),
    "advices, 1 a cycle": (nothing, with_advices),
    "frames of nobody, 32 a cycle": (nothing, with_frames(of_nobody)),
    "forged frames, 32 a cycle": (nothing, with_frames(forged)),
    "sample frames, 32 a cycle": (nothing, with_frames(more_samples)),
}


def ratio(case: str) -> float:
    """Mean cycle in references: the least of a few tries, for the machine may be busy."""
    prepare, each = CASES[case]
    bench = working()
    prepare(bench)
    fed = Fed(bench)
    fed.each = each  # type: ignore[method-assign]
    tries = []
    for _ in range(3):
        beside = min(cost_s(reference, 5) for _ in range(3))
        tries.append(fed.mean_s() / beside)
    return min(tries)


def test_every_state_has_a_budget() -> None:
    assert set(CASES) == set(CYCLE_US)


@pytest.mark.skipif(
    sys.gettrace() is not None, reason="a tracer slows the guard's code more than the reference's"
)
@pytest.mark.parametrize("case", CYCLE_US)
def test_a_cycle_keeps_its_budget(case: str) -> None:
    assert ratio(case) <= CYCLE_US[case] / REFERENCE_US


def test_a_fault_costs_no_more_than_being_armed() -> None:
    armed = ratio("armed")
    assert max(ratio("samples gone"), ratio("link down")) < 1.2 * armed


def counted_looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The times at which the shield is asked from now on."""
    looks: list[int] = []
    look = facts.look_around

    def counting(g: Stages, now_ns: int) -> None:
        looks.append(now_ns)
        look(g, now_ns)

    monkeypatch.setattr(facts, "look_around", counting)
    return looks


@pytest.mark.parametrize(
    "prepare", [samples_gone, link_down, node_gone, brain_gone, tripped, nothing]
)
def test_the_shield_works_at_most_every_20_ms_and_for_commands_that_are_sent(
    prepare: Callable[[Bench], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    b = working()
    prepare(b)
    looks = counted_looks(monkeypatch)
    sent = sum(f.frame_id == 0x060 for d in b.run(1.0) for f in d.frames_out)
    assert len(looks) <= 51 + sent
    assert sent or len(looks) <= 51


def test_requests_do_not_make_the_shield_work_nor_fill_the_bus(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    b = working()
    looks = counted_looks(monkeypatch)
    frames, states = 0, 0
    for k in range(1000):
        decision = b.cycle([CommandRequest(k, "mode", None, 1 + k % 2)])
        frames += len(decision.frames_out)
        states += decision.state is not None
    assert len(looks) <= 51 + 200
    assert frames <= 400
    assert states <= 51


@pytest.mark.parametrize("junk", [b"\xfd", b"\0", b"\xfd\x20\0\0\0\x01\x01\x0a\0\0"])
def test_bytes_that_are_no_packets_cost_a_bounded_time(junk: bytes) -> None:
    data = (junk * READ_BYTES)[:READ_BYTES]
    beside = min(cost_s(reference, 5) for _ in range(3))
    assert (
        min(cost_s(lambda: Framer().feed(data, BATCH)) for _ in range(5)) / beside
        <= JUNK_US / REFERENCE_US
    )


# ------------------------------------------------------------------ what a peer may put in


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PeerServer]:
    made = PeerServer(tmp_path / "guard.sock", {"brain": None, "gate": None}, PEER_LIMITS)
    yield made
    made.close()


def peer(server: PeerServer, role: str) -> socket.socket:
    """A connected peer that keeps to no limit of its own."""
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sock.connect(str(server.path))
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16 << 20)
    sock.send(encode(Hello(role, 1)))
    server.poll(0)
    server.poll(0)
    assert server.connected(role)
    sock.setblocking(False)
    return sock


def put(sock: socket.socket, data: bytes, count: int) -> int:
    """How many packets the kernel took."""
    for k in range(count):
        try:
            sock.send(data)
        except BlockingIOError:
            return k
    return count


def advice(reasons: list[str]) -> bytes:
    return encode(Advice(1, 0, 0, 0, 70.0, None, True, reasons, None))


@pytest.mark.parametrize(("role", "record"), [
    ("brain", advice([])),
    ("gate", encode(CommandRequest(1, "disarm"))),
    ("gate", b"\xc1"),
])  # fmt: skip
def test_a_poll_takes_no_more_than_the_roles_records(
    server: PeerServer, role: str, record: bytes
) -> None:
    sock = peer(server, role)
    taken = put(sock, record, 60)
    while taken > 0:
        before = server.counters[f"malformed_{role}"]
        got = len(server.poll(0)) + server.counters[f"malformed_{role}"] - before
        assert 0 < got <= PEER_LIMITS[role].records
        taken -= got
    sock.close()


@pytest.mark.parametrize(("role", "record"), [
    ("brain", advice(["x" * 120_000])),
    ("brain", advice(["x"] * 60_000)),
    ("brain", bytes(120_000)),
    ("gate", encode(CommandRequest(1, "disarm", origin="x" * 120_000))),
    ("gate", encode(CommandRequest(1, "x" * 5_000))),
])  # fmt: skip
def test_what_is_too_large_is_counted_and_never_decoded(
    server: PeerServer, role: str, record: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def decoded(data: bytes) -> None:
        raise AssertionError(f"{len(data)} bytes were decoded")

    sock = peer(server, role)
    monkeypatch.setattr("firmware_py.wire.peer_socket.decode", decoded)
    taken = put(sock, record, 62)
    for _ in range(taken):
        assert server.poll(0) == []
    assert server.counters[f"oversized_{role}"] == taken > 0
    assert server.connected(role)
    sock.close()


def test_the_largest_allowed_advice_passes(server: PeerServer) -> None:
    sock = peer(server, "brain")
    record = advice(["x" * (PEER_LIMITS["brain"].record_bytes - 300)])
    sock.send(record)
    assert len(server.poll(0)) == 1
    sock.close()


def test_a_newcomer_may_say_who_it_is_and_no_more(server: PeerServer) -> None:
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    sock.connect(str(server.path))
    sock.send(encode(Hello("brain" + "x" * NEWCOMER.record_bytes, 1)))
    server.poll(0)
    server.poll(0)
    assert server.counters["oversized_newcomer"] == server.counters["refused_hello"] == 1
    sock.close()


def test_who_connects_without_end_is_let_in_eight_at_a_time(server: PeerServer) -> None:
    class Endless:
        def __init__(self, real: socket.socket) -> None:
            self.real, self.made = real, 0

        def fileno(self) -> int:
            return self.real.fileno()

        def look(self, now_ns: int) -> bool:
            return False

        def close(self) -> None:
            self.real.close()

        def accept(self) -> socket.socket:
            self.made += 1
            return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)[0]

    endless = Endless(server._listener)
    server._listener = endless  # type: ignore[assignment]
    server._accept(0)
    assert endless.made == MAX_WAITING


def test_reasons_of_an_advice_are_cut_to_what_a_person_can_read() -> None:
    short = Advice(1, 0, 0, 0, None, None, True, ["no window yet"] * 3, None)
    assert bounded(short) is short
    long = bounded(Advice(1, 0, 0, 0, None, None, True, ["y" * 201] * 17, None))
    assert [len(text) for text in long.reasons] == [200] * 16


# ------------------------------------------------------------------ events


def test_a_gate_that_comes_back_is_told_a_few_events_a_cycle_in_their_order() -> None:
    outbox, got = Outbox(), []

    def send(event: Event) -> bool:
        got.append(event.seq)
        return True

    for seq in range(1, 101):
        outbox.put(Event(seq, 0, 0, "x", "x"))
    outbox.tell(send, EVENTS_PER_CYCLE)
    assert got == list(range(1, EVENTS_PER_CYCLE + 1))
    outbox.put(Event(101, 0, 0, "x", "x"))
    outbox.acknowledge(10)
    for _ in range(10):
        outbox.tell(send, EVENTS_PER_CYCLE)
    assert got == list(range(1, 102))
    outbox.again()
    got.clear()
    outbox.tell(send, 5)
    assert got == [11, 12, 13, 14, 15]
    outbox.acknowledge(101)
    outbox.tell(send, 5)
    assert len(got) == 5


def test_an_event_that_a_full_queue_did_not_take_is_told_again() -> None:
    outbox, got, room = Outbox(), [], [True, False, False, True, True]

    def send(event: Event) -> bool:
        if taken := room.pop(0):
            got.append(event.seq)
        return taken

    for seq in (1, 2, 3):
        outbox.put(Event(seq, 0, 0, "x", "x"))
    for _ in range(4):
        outbox.tell(send, 2)
    assert got == [1, 2, 3]


def test_a_full_outbox_loses_the_oldest_and_tells_each_of_the_others_once() -> None:
    outbox, got = Outbox(capacity=3), []
    for seq in range(1, 4):
        outbox.put(Event(seq, 0, 0, "x", "x"))
    outbox.tell(lambda event: got.append(event.seq) is None, 2)
    for seq in (4, 5):
        outbox.put(Event(seq, 0, 0, "x", "x"))
    outbox.tell(lambda event: got.append(event.seq) is None, 9)
    assert (got, outbox.dropped) == ([1, 2, 3, 4, 5], 2)
