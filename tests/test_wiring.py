"""One wiring: the three loops on real sockets and the device on the simulated clock take every
record the same way, in the same order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from firmware_py import config, notify
from firmware_py.brain import loop as brain_loop
from firmware_py.brain.commissioning import belonging
from firmware_py.brain.core import BrainCore
from firmware_py.clock import SimClock
from firmware_py.gate import keys, session
from firmware_py.gate.core import Gate, GateParts
from firmware_py.gate.models_file import ModelsFile
from firmware_py.gate.normal_file import NormalFile
from firmware_py.gate.telemetry import Telemetry
from firmware_py.guard.core import GuardCore
from firmware_py.guard.loop import Guard
from firmware_py.guard.process.memory import Memory
from firmware_py.records import (
    BRAIN_VERBS,
    VERBS,
    Advice,
    Baseline,
    BrainSnapshot,
    BrainStep,
    CommandReply,
    CommandRequest,
    Cycle,
    CycleRecord,
    Decision,
    EventAck,
    GuardState,
    Mode,
    Normal,
    PeerRecord,
    PlannedRamp,
    RawFrame,
    Record,
    Snapshot,
)
from firmware_py.routing import (
    BRAIN_PERIOD_NS,
    GATE_PERIOD_NS,
    GUARD_PERIOD_NS,
    ROUTES,
    ROUTES_OF,
    Stage,
    in_order,
    receivers,
    stage_of,
)
from firmware_py.wire.disarm_socket import SOCKET, DisarmSocket
from firmware_py.wire.link import codec_for
from firmware_py.wire.peers import PeerClient, PeerServer
from sim_hil.closed_loop import ClosedLoop
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.rigs import load_rig
from tests.brain.machine import model, models
from tests.brain.onnx_models import own

BENCH = config.load(config.SHIPPED / "bench")[0]
MODELS = replace(models(fleet=True), shadow=model(own()))
SESSION = 0xC0FFEE
START_NS = 5_000_000_000
RAMP = PlannedRamp(1.0, 2.0, 5000.0, 90.0)
REQUESTS = {
    2000: ("mode", "manual"),
    2100: ("arm", None),
    2200: ("set_clearance", 62.0),
    2300: ("announce", msgspec.to_builtins(RAMP)),
    2400: ("commission", "start"),
    2500: ("commission", "cancel"),
    2550: ("models", {"action": "rollback"}),
    2600: ("set_pressure", 1.0),
    2640: ("bypass", {"target": "disp_x", "seconds": 9.0, "owner": "A. P.", "reason": "probe"}),
    2660: ("shelve", {"target": "disp_x_alert", "seconds": 9.0}),
    2700: ("disarm", None),
    2800: ("reset", None),
}
"""What a person asks for, by millisecond: every verb."""
SECONDS = 3.2


def normal() -> Normal:
    assert MODELS.classifier is not None
    return Normal(
        belongs=belonging(MODELS.classifier, BENCH),
        minutes=1.0,
        decisions=24,
        points=6,
        ranges={"speed_rad_s": (100.0, 1300.0)},
        offset=[3.0, 5.0],
        variance=[1.2, 1.1],
        scale=[1.0, 1.1],
        quiet=[0.0] * 4,
        baseline=Baseline([6.5, 6e-5, 0.3], [0.5, 2e-5, 0.2], [(1.0, -2.0)] * 5, 0.2),
    )


class Heard:
    """What arrived at each stage, by who sent it: one list a step of the sender."""

    def __init__(self) -> None:
        self.batches: dict[tuple[Stage, Stage], list[list[type[Record]]]] = {}
        self.requests: list[CommandRequest] = []
        self.replies: list[CommandReply] = []
        self.at_brain: list[tuple[type[Record], int]] = []
        self.at_gate: list[tuple[type[Record], int]] = []

    def note(self, source: Stage, to: Stage, records: Sequence[PeerRecord]) -> None:
        kinds = [type(record) for record in records]
        if (source, to) == (Stage.GUARD, Stage.GATE):
            shared = [r for r in records if Stage.BRAIN in receivers(source, r)]
            self.at_gate += [(type(r), r.seq) for r in shared]  # type: ignore[union-attr]
        if kinds:
            self.batches.setdefault((source, to), []).append(kinds)

    def kinds(self, source: Stage, to: Stage) -> set[type[Record]]:
        return {kind for batch in self.batches.get((source, to), []) for kind in batch}


def by_cycle(records: Iterable[PeerRecord]) -> list[list[PeerRecord]]:
    """What came from the guard, a list a cycle: its record ends it."""
    out: list[list[PeerRecord]] = [[]]
    for record in records:
        out[-1].append(record)
        if isinstance(record, CycleRecord):
            out.append([])
    return out


def by_step(records: Iterable[PeerRecord]) -> list[list[PeerRecord]]:
    """What came from the brain, a list a step: a snapshot or the step begins it."""
    out: list[list[PeerRecord]] = [[]]
    for record in records:
        follows = out[-1] and isinstance(out[-1][-1], BrainSnapshot)
        if isinstance(record, BrainSnapshot) or (isinstance(record, BrainStep) and not follows):
            out.append([])
        out[-1].append(record)
    return out


class TappedGuard(GuardCore):
    heard: Heard

    def step(self, cycle: Cycle) -> Decision:
        self.heard.note(Stage.BRAIN, Stage.GUARD, [cycle.advice] if cycle.advice else [])
        self.heard.note(Stage.GATE, Stage.GUARD, cycle.commands)
        self.heard.requests += cycle.commands
        return super().step(cycle)


class TappedBrain(BrainCore):
    heard: Heard

    def step(
        self, records: list[PeerRecord], now_ns: int, late: tuple[int, int] = (0, 0)
    ) -> list[PeerRecord]:
        of_gate = [r for r in records if isinstance(r, CommandRequest | Normal)]
        assert records[: len(of_gate)] == of_gate, "the gate's come first"
        self.heard.requests += [r for r in of_gate if isinstance(r, CommandRequest)]
        self.heard.note(Stage.GATE, Stage.BRAIN, of_gate)
        of_guard = records[len(of_gate) :]
        self.heard.note(Stage.GUARD, Stage.BRAIN, of_guard)
        self.heard.at_brain += [(type(r), r.seq) for r in of_guard]  # type: ignore[union-attr]
        return super().step(records, now_ns, late)


def make_rig() -> Rig:
    data = load_rig("bench")
    return Rig(data, codec_for(BENCH), node_limits(data, BENCH), 7)


def make_guard(heard: Heard) -> TappedGuard:
    core = TappedGuard(BENCH, codec_for(BENCH), SESSION)
    core.heard = heard
    return core


def make_brain(heard: Heard) -> TappedBrain:
    core = TappedBrain(BENCH, MODELS, "")
    core.heard = heard
    return core


class RigLink:
    """A link whose far end is the rig."""

    def __init__(self) -> None:
        self.counters: dict[str, int] = {}
        self.up, self.fault = True, ""
        self._rig, self._sent = make_rig(), list[RawFrame]()

    def receive(self, now_ns: int) -> list[RawFrame]:
        frames, self._sent = self._rig.step(now_ns, self._sent), []
        return frames

    def send(self, frame: RawFrame) -> bool:
        self._sent.append(frame)
        return True

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self.up = False


class Live(SimClock):
    """The three loops on their sockets; the brain's sleep is when the other two run."""

    def __init__(self, folder: Path) -> None:
        super().__init__(START_NS)
        self.heard, self.cycles = Heard(), 0
        server = PeerServer(folder / "guard.sock", {"brain": None, "gate": None})
        disarm = DisarmSocket(folder / SOCKET)
        core = make_guard(self.heard)
        self.guard = Guard(core, RigLink(), server, disarm, Memory(folder))
        prefix = keys.prefix(BENCH.device.site, BENCH.device.rig)
        stored = NormalFile(folder / "state", lambda: 1)
        stored.keep(normal())
        self.doors = GateParts(
            PeerClient(folder / "guard.sock", "gate"),
            PeerServer(folder / "gate.sock", {"brain": None}),
            Telemetry(session.open_device(BENCH.zenoh, folder, prefix), prefix),
            None,
            stored,
            ModelsFile(folder / "state" / "models", lambda: 1),
        )
        self._tap()
        self.gate = Gate(BENCH, self.doors, {}, lambda: 1)
        brain_loop.run(
            make_brain(self.heard), folder, self, notify.Notifier(None), lambda: self.done
        )
        self.doors.telemetry.close()
        self.doors.guard.close()
        self.doors.brain.close()
        self.guard.close()

    @property
    def done(self) -> bool:
        return self.cycles >= SECONDS * 1000

    def sleep_until(self, t_ns: int) -> None:
        while self.now_ns() < t_ns:
            super().sleep_until(self.now_ns() + GUARD_PERIOD_NS)
            if self.cycles in REQUESTS:
                verb, value = REQUESTS[self.cycles]
                self.gate.ask(verb, value, "test", self.heard.replies.append, self.now_ns())
            self.cycles += 1
            self.guard.cycle(self.now_ns())
            if self.cycles % (GATE_PERIOD_NS // GUARD_PERIOD_NS) == 0:
                self.gate.step(self.now_ns())

    def _tap(self) -> None:
        """Note what the gate reads from its two sockets."""
        of_guard, of_brain = self.doors.guard.poll, self.doors.brain.poll
        rest: list[PeerRecord] = []

        def guard_poll(now_ns: int) -> list[PeerRecord]:
            records = of_guard(now_ns)
            *whole, rest[:] = by_cycle([*rest, *records])
            for batch in whole:
                self.heard.note(Stage.GUARD, Stage.GATE, batch)
            return records

        def brain_poll(now_ns: int) -> list[tuple[str, PeerRecord]]:
            records = of_brain(now_ns)
            for batch in by_step(record for _, record in records):
                self.heard.note(Stage.BRAIN, Stage.GATE, batch)
            return records

        self.doors.guard.poll = guard_poll  # type: ignore[method-assign]
        self.doors.brain.poll = brain_poll  # type: ignore[method-assign]


def simulated() -> Heard:
    """The same on the simulated clock."""
    heard = Heard()
    at_gate: list[PeerRecord] = []
    loop = ClosedLoop(
        make_rig(),
        make_guard(heard),
        lambda: make_brain(heard),
        [lambda record, _: at_gate.append(record)],
        START_NS,
    )
    loop.device.adopt(normal())
    for millisecond in range(round(SECONDS * 1000)):
        if millisecond in REQUESTS:
            ask(loop, *REQUESTS[millisecond])
        loop.step()
    verbs = {r.seq: r.verb for r in at_gate if isinstance(r, CommandRequest)}
    of_guard, of_brain = list[PeerRecord](), list[PeerRecord]()
    for record in at_gate:
        sources = {route.source for route in ROUTES if route.kind is type(record)}
        if isinstance(record, CommandReply):
            heard.replies.append(record)
            sources = {stage_of(verbs[record.seq])}
        if Stage.GUARD in sources:
            of_guard.append(record)
        elif Stage.BRAIN in sources and not isinstance(record, Normal):
            of_brain.append(record)
    for batch in by_cycle(of_guard)[:-1]:
        heard.note(Stage.GUARD, Stage.GATE, batch)
    for batch in by_step(of_brain):
        heard.note(Stage.BRAIN, Stage.GATE, batch)
    return heard


def ask(loop: ClosedLoop, verb: str, value: object) -> None:
    """The request that the gate makes of ``value``."""
    if verb == "mode":
        loop.command(verb, mode=Mode[str(value).upper()])
    elif verb == "announce":
        loop.command(verb, ramp=RAMP)
    elif verb == "models":
        loop.command(verb, action=value["action"])  # type: ignore[index]
    elif isinstance(value, dict):
        loop.command(verb, value["seconds"], **{k: v for k, v in value.items() if k != "seconds"})
    elif verb == "commission":
        loop.command(verb, action=str(value))
    else:
        loop.command(verb, value)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Heard]:
    return {"live": Live(tmp_path_factory.mktemp("live")).heard, "simulated": simulated()}


NOT_SIMULATED = {EventAck}
"""The guard's loop keeps events until they are acknowledged; the pure stage does not."""
NOT_IN_THIS_FLIGHT = {(Normal, Stage.BRAIN)}
"""Nothing is learned in three seconds."""


@pytest.mark.parametrize("way", ["live", "simulated"])
def test_each_stage_hears_the_kinds_of_the_table_and_no_others(both, way: str) -> None:
    for source in Stage:
        for to in set(Stage) - {source}:
            said = {route.kind for route in ROUTES_OF[source] if to in route.to}
            said -= {kind for kind, by in NOT_IN_THIS_FLIGHT if by is source}
            assert both[way].kinds(source, to) == said - NOT_SIMULATED, (source, to)


@pytest.mark.parametrize("way", ["live", "simulated"])
def test_each_step_is_heard_in_the_order_of_the_table(both, way: str) -> None:
    for (source, to), batches in both[way].batches.items():
        if (source, to) == (Stage.GUARD, Stage.BRAIN):
            continue  # several cycles at once: see the next test
        order = [route.kind for route in ROUTES_OF[source]]
        for kinds in batches:
            assert kinds == sorted(kinds, key=order.index), (source, to)


@pytest.mark.parametrize("way", ["live", "simulated"])
def test_the_brain_hears_of_the_guard_what_the_gate_hears_in_the_same_order(both, way: str) -> None:
    at_brain, at_gate = both[way].at_brain, both[way].at_gate
    first = max(at_brain.index(at_gate[0]) if at_gate[0] in at_brain else 0, 0)
    start = at_gate.index(at_brain[first])
    common = min(len(at_brain) - first, len(at_gate) - start)
    assert common > 500
    assert at_brain[first : first + common] == at_gate[start : start + common]


def test_every_request_arrives_where_it_is_answered_and_is_answered_alike(both) -> None:
    live, closed = both["live"], both["simulated"]
    assert [r.verb for r in live.requests] == [r.verb for r in closed.requests]
    assert {r.verb for r in closed.requests} == {*VERBS, *BRAIN_VERBS}
    for a, b in zip(live.requests, closed.requests, strict=True):
        assert msgspec.structs.replace(a, origin="", id="") == msgspec.structs.replace(
            b, origin="", id=""
        )
    assert [(r.seq, r.accepted) for r in live.replies] == [
        (r.seq, r.accepted) for r in closed.replies
    ]


def test_a_request_goes_to_the_stage_of_its_verb_and_unknown_kinds_nowhere() -> None:
    for verb in (*VERBS, *BRAIN_VERBS):
        request = CommandRequest(1, verb)
        assert receivers(Stage.GATE, request) == (stage_of(verb),)
        assert receivers(Stage.BRAIN, request) == ()
    advice = Advice(1, 0, 0, 0, None, None, False, [], None)
    assert receivers(Stage.BRAIN, advice) == (Stage.GUARD, Stage.GATE)
    assert receivers(Stage.GATE, advice) == ()


def test_records_are_put_in_the_order_of_the_table_and_stay_as_they_came_within_a_kind() -> None:
    snapshots = [Snapshot(seq, 0, b"") for seq in range(3)]
    replies = [CommandReply(seq, True, []) for seq in (5, 4)]
    assert in_order(Stage.GUARD, [replies[0], *snapshots, replies[1]]) == [*snapshots, *replies]


def test_the_rates_fit_into_one_another() -> None:
    assert BRAIN_PERIOD_NS % GATE_PERIOD_NS == GATE_PERIOD_NS % GUARD_PERIOD_NS == 0
    assert GuardState in {route.kind for route in ROUTES_OF[Stage.GUARD]}
