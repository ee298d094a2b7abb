"""The guard's process: read, step, write, sleep, a thousand times a second."""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from firmware_py import launch
from firmware_py.clock import Clock, MonotonicClock
from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.guard.process.budget import EVENTS_PER_CYCLE, PEER_LIMITS, bounded
from firmware_py.guard.process.memory import Memory, complain
from firmware_py.guard.process.outbox import Outbox
from firmware_py.guard.process.timing import Grid, Lateness
from firmware_py.notify import Notifier, from_environment
from firmware_py.records import (
    Advice,
    CommandRequest,
    Cycle,
    Decision,
    Event,
    EventAck,
    GuardState,
)
from firmware_py.routing import (
    GUARD_PERIOD_NS,
    ROUTES_OF,
    SNAPSHOT_CYCLES,
    Stage,
    put_out,
    receivers,
)
from firmware_py.wire import disarm_socket
from firmware_py.wire.disarm_socket import DisarmSocket
from firmware_py.wire.link import Link, codec_for, open_device_link
from firmware_py.wire.peers import PeerServer

WATCHDOG_CYCLES: Final = 200
FIFO_PRIORITY: Final = 20


class Guard:
    """The thin shell around :class:`GuardCore`: link and sockets in, link and sockets out.

    Parameters
    ----------
    core
        The pure stage.
    link
        Bus or serial port to the node.
    server
        Socket on which brain and gate call.
    disarm
        Socket on which any local program may disarm.
    memory
        Where trips, timers and starts survive a restart.
    """

    def __init__(
        self, core: GuardCore, link: Link, server: PeerServer, disarm: DisarmSocket, memory: Memory
    ) -> None:
        self._core = core
        self._link = link
        self._server = server
        self._disarm = disarm
        self._memory = memory
        self._outbox = Outbox()
        self._gate_known = False
        self.timing = Lateness(GUARD_PERIOD_NS)
        self.skipped = 0
        self.seq = 0

    def cycle(self, now_ns: int) -> None:
        """One cycle: everything waiting in, one decision, everything out."""
        cycle = self._read(now_ns)
        if cycle.gate_connected and (not self._gate_known or self.seq % SNAPSHOT_CYCLES == 0):
            self._server.send(Stage.GATE, self._core.snapshot(self.seq, now_ns))
        if cycle.gate_connected and not self._gate_known:
            self._outbox.again()
        self._gate_known = cycle.gate_connected
        decision = self._core.step(cycle)
        for frame in decision.frames_out:
            self._link.send(frame)
        self._send_out(cycle, decision)
        self._memory.note(
            now_ns, self._core.tripped, self._core.timers, self._core.barred, self._core.probation
        )
        self.seq += 1

    def close(self) -> None:
        """Told to stop: give link and socket back, and note that it was no crash."""
        self._link.close()
        self._memory.close()
        self._disarm.close()
        self._server.close()

    def _read(self, now_ns: int) -> Cycle:
        """What is waiting, up to the limits: advice from the brain alone, requests from the gate
        alone, and ``disarm`` from its own socket."""
        advice: Advice | None = None
        commands: list[CommandRequest] = []
        for role, record in self._server.poll(now_ns):
            if Stage.GUARD not in receivers(Stage(role), record):
                continue
            if isinstance(record, Advice):
                advice = bounded(record)
            elif isinstance(record, CommandRequest):
                commands.append(record)
            elif isinstance(record, EventAck):
                self._outbox.acknowledge(record.seq)
        disarm = self._disarm.poll(now_ns)
        if disarm is not None:
            commands.append(disarm)
        frames = self._link.receive(now_ns)
        return Cycle(
            self.seq,
            now_ns,
            frames,
            advice,
            commands,
            self._server.connected("brain"),
            self._server.connected("gate"),
            self._link.up,
            self._memory.fault,
            self._link.fault,
        )

    def _send_out(self, cycle: Cycle, decision: Decision) -> None:
        """Send what goes out to whom it goes (:mod:`firmware_py.routing`); a slow reader loses its
        own, counted by the server."""
        for event in decision.events:
            self._outbox.put(event)
        replies = [reply for reply in decision.replies if not self._disarm.answer(reply)]
        decision = msgspec.structs.replace(decision, replies=replies)
        if decision.state is not None:
            state = self._with_counters(decision.state)
            decision = msgspec.structs.replace(decision, state=state)
        connected = {Stage.BRAIN: cycle.brain_connected, Stage.GATE: cycle.gate_connected}
        records = put_out(cycle, decision)
        for route in ROUTES_OF[Stage.GUARD]:
            if route.kind is Event and cycle.gate_connected:
                self._outbox.tell(self._send_event, EVENTS_PER_CYCLE)
                continue
            for record in records:
                if type(record) is route.kind:
                    for stage in route.to:
                        if connected[stage]:
                            self._server.send(stage, record)

    def _send_event(self, event: Event) -> bool:
        return self._server.send(Stage.GATE, event)

    def _with_counters(self, state: GuardState) -> GuardState:
        """The state with what only the loop can count."""
        counters = state.counters | self.timing.counters()
        counters |= {f"link_{name}": count for name, count in self._link.counters.items()}
        counters |= {f"room_{name}": count for name, count in self._server.counters.items()}
        counters |= self._disarm.counters
        counters |= {
            "periods_skipped": self.skipped,
            "events_dropped": self._outbox.dropped,
            "trip_file_failures": self._memory.failures,
        }
        return msgspec.structs.replace(state, counters=counters)


def run(guard: Guard, clock: Clock, notifier: Notifier, running: Callable[[], bool]) -> None:
    """Read, step, write, sleep on an absolute grid while ``running()``."""
    grid = Grid(clock.now_ns(), GUARD_PERIOD_NS)
    while running():
        now_ns = clock.now_ns()
        guard.timing.add(now_ns - grid.due_ns)
        guard.cycle(now_ns)
        if guard.seq == 1:
            notifier.ready()
        if guard.seq % WATCHDOG_CYCLES == 0:
            notifier.watchdog()
        clock.sleep_until(grid.advance(clock.now_ns()))
        guard.skipped = grid.skipped
    notifier.stopping()


def build(
    config: Config,
    runtime: Path,
    state: Path,
    peers: Mapping[str, int | None],
    rig: Path = Path(),
) -> Guard:
    """The guard of ``config`` on its real link and sockets; ``peers`` tells who may call, ``rig``
    is the rig folder."""
    server = PeerServer(
        runtime / "guard.sock", peers, PEER_LIMITS
    )  # first: from here on this one is the guard
    disarm = DisarmSocket(runtime / disarm_socket.SOCKET)
    memory = Memory(state, prepare=_first_in_line)
    complain(memory)
    session = int.from_bytes(os.urandom(4), "little") | 1
    core = GuardCore(
        config, codec_for(config), session, memory.latched, memory.start, memory.timers
    )
    return Guard(core, open_device_link(config, rig), server, disarm, memory)


def main(argv: list[str]) -> int:
    """``orbitd guard``: protect, and hold the only hand on the actuator."""
    parser = argparse.ArgumentParser(prog="orbitd guard", description="the guard process alone")
    launch.add_options(parser)
    launch.add_peers(parser, "brain", "gate")
    started = launch.from_options(parser.parse_args(argv))
    stop: list[int] = []
    for number in (
        signal.SIGTERM,
        signal.SIGINT,
    ):  # before the start is noted: who is told to stop has not crashed
        signal.signal(number, lambda received, _frame: stop.append(received))
    state = Path(os.environ.get("STATE_DIRECTORY", started.runtime))
    guard = build(started.config, started.runtime, state, started.peers, started.source.path)
    real_time()
    run(guard, MonotonicClock(), from_environment(), lambda: not stop)
    guard.close()
    return 0


def real_time() -> None:
    """First in line for the processor where that is allowed, and no garbage collection in the
    loop."""
    _first_in_line()
    gc.collect()
    gc.freeze()
    gc.disable()


def _first_in_line() -> None:
    """The calling thread before all others, where that is allowed."""
    with contextlib.suppress(
        PermissionError
    ):  # on a laptop; the lateness histogram shows what that costs
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
