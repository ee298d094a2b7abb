"""The device without its processes: guard, brain and what the gate does for them, one cycle at a
time.

Pure: the time and the frames come in, the decision goes out, and every record takes the way of
:mod:`firmware_py.routing`.  Closed loop, demo and tests run this; the processes run the same
stages and take the same table.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from firmware_py.guard.process.budget import bounded
from firmware_py.records import (
    Advice,
    CommandReply,
    CommandRequest,
    Cycle,
    Decision,
    ModelsInUse,
    Normal,
    PeerRecord,
    PlannedRamp,
    RawFrame,
    Snapshot,
)
from firmware_py.routing import (
    BRAIN_PERIOD_NS,
    SNAPSHOT_CYCLES,
    Stage,
    in_order,
    put_out,
    receivers,
)

ORIGIN: Final = "closed loop"
"""Who asked, in a request that was made here."""


class GuardStage(Protocol):
    """What the device needs of the guard."""

    def step(self, cycle: Cycle) -> Decision:
        """One cycle."""

    def snapshot(self, seq: int, now_ns: int) -> Snapshot:
        """State before cycle ``seq``."""


class BrainStage(Protocol):
    """What the device needs of the brain."""

    def step(self, records: list[PeerRecord], now_ns: int) -> list[PeerRecord]:
        """Take in records, give out diagnoses, forecasts, advice."""


Listener = Callable[[PeerRecord, int], object]


class Device:
    """Guard and brain, wired as their processes are.

    Parameters
    ----------
    guard
        The guard's stage.
    make_brain
        Called for the first brain and for each that replaces a killed one; None: no brain.
    listeners
        Called with every record that reaches the gate or leaves it, and its time: recorder,
        observer.
    """

    def __init__(
        self,
        guard: GuardStage,
        make_brain: Callable[[], BrainStage] | None,
        listeners: Iterable[Listener] = (),
    ) -> None:
        self._guard, self._make_brain = guard, make_brain
        self._listeners = tuple(listeners)
        self._brain = make_brain() if make_brain else None
        self._brain_due_ns = 0
        self._seq = self._command_seq = 0
        self._asked: list[PeerRecord] = []
        self._waiting: dict[tuple[Stage, Stage], list[PeerRecord]] = defaultdict(list)
        self._normal: Normal | None = None
        self._forgets: set[int] = set()
        self._sets: tuple[object, object] = ([], None)

    @property
    def brain_runs(self) -> bool:
        """Whether a brain is connected."""
        return self._brain is not None

    def kill_brain(self) -> None:
        """The brain's process is gone, with all it knew."""
        self._brain = None
        for source in Stage:
            self._waiting[source, Stage.BRAIN].clear()

    def start_brain(self) -> None:
        """A new brain connects and knows nothing but what the gate has stored."""
        self._brain = self._make_brain() if self._make_brain else None
        if self._normal is not None:
            self.adopt(self._normal)

    def adopt(self, normal: Normal) -> None:
        """Let the gate hand ``normal``, which it has stored, to the brain."""
        self._normal = normal
        self._asked.append(normal)

    def command(
        self,
        verb: str,
        value: float | None = None,
        mode: int | None = None,
        *,
        ramp: PlannedRamp | None = None,
        action: str = "",
        target: str = "",
        owner: str = "",
        reason: str = "",
    ) -> int:
        """Queue a person's command for the next cycle, to the stage that answers it; its sequence
        number."""
        self._command_seq += 1
        request = CommandRequest(
            self._command_seq, verb, value, mode, ORIGIN, ramp, action,
            target=target, owner=owner, reason=reason,
        )  # fmt: skip
        self._asked.append(request)
        if action == "forget":
            self._forgets.add(request.seq)
        return request.seq

    def step(self, now_ns: int, frames: list[RawFrame], *, link_up: bool = True) -> Decision:
        """One cycle of the guard, and a step of the brain when one is due."""
        asked, self._asked = self._asked, []
        self._send(Stage.GATE, asked, now_ns)
        if self._seq % SNAPSHOT_CYCLES == 0:
            self._send(Stage.GUARD, [self._guard.snapshot(self._seq, now_ns)], now_ns)
        cycle = self._cycle(now_ns, frames, link_up)
        decision = self._guard.step(cycle)
        self._seq += 1
        self._send(Stage.GUARD, put_out(cycle, decision), now_ns)
        if self._brain is not None and now_ns >= self._brain_due_ns:
            self._brain_due_ns = max(self._brain_due_ns + BRAIN_PERIOD_NS, now_ns)
            answers = self._brain.step(self._take(Stage.BRAIN), now_ns)
            self._send(Stage.BRAIN, in_order(Stage.BRAIN, answers), now_ns)
        return decision

    def _cycle(self, now_ns: int, frames: list[RawFrame], link_up: bool) -> Cycle:
        waiting = self._take(Stage.GUARD)
        advices = [record for record in waiting if isinstance(record, Advice)]
        commands = [record for record in waiting if isinstance(record, CommandRequest)]
        advice = bounded(advices[-1]) if advices else None
        return Cycle(self._seq, now_ns, frames, advice, commands, self.brain_runs, True, link_up)

    def _take(self, stage: Stage) -> list[PeerRecord]:
        """What waits for ``stage``: the gate's first, as its loop reads it."""
        found: list[PeerRecord] = []
        for source in reversed(Stage):
            found += self._waiting.pop((source, stage), [])
        return found

    def _send(self, source: Stage, records: Iterable[PeerRecord], now_ns: int) -> None:
        for record in records:
            if source is Stage.GATE:
                self._tell(record, now_ns)
            for stage in receivers(source, record):
                if stage is Stage.GATE:
                    self._keep(record)
                    self._tell(record, now_ns)
                elif stage is Stage.GUARD or self.brain_runs:
                    self._waiting[source, stage].append(record)

    def _keep(self, record: PeerRecord) -> None:
        """Store the machine's normal state, as the gate does for the next brain and for other
        models; or forget it."""
        if isinstance(record, Normal):
            self._normal = record
        elif isinstance(record, CommandReply) and record.accepted and record.seq in self._forgets:
            self._normal = None
        elif isinstance(record, ModelsInUse):
            before, self._sets = self._sets, (record.active, record.beside)
            if self._sets != before and self._normal is not None:
                self.adopt(self._normal)  # a set that has just come knows nothing of this machine

    def _tell(self, record: PeerRecord, now_ns: int) -> None:
        for listener in self._listeners:
            listener(record, now_ns)
