"""Rig, guard and brain in one process on a simulated clock: the same stages and the same encoded
frames.

Deterministic and faster than real time; tests, replay and training live on it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, Protocol

from firmware_py.records import (
    Advice,
    CommandRequest,
    Cycle,
    CycleRecord,
    Decision,
    RawFrame,
    RoomRecord,
    Snapshot,
)

PERIOD_NS: Final = 1_000_000
"""One guard cycle."""

SNAPSHOT_EVERY: Final = 1000
"""Cycles between two snapshots of the guard."""


class RigStage(Protocol):
    """What the loop needs of the rig."""

    def step(self, now_ns: int, frames_in: list[RawFrame]) -> list[RawFrame]:
        """Advance to ``now_ns``; all frames due until then."""


class GuardStage(Protocol):
    """What the loop needs of the guard."""

    def step(self, cycle: Cycle) -> Decision:
        """One cycle."""

    def snapshot(self, seq: int, now_ns: int) -> Snapshot:
        """State before cycle ``seq``."""


class BrainStage(Protocol):
    """What the loop needs of the brain."""

    def step(self, records: list[RoomRecord], now_ns: int) -> list[RoomRecord]:
        """Take in records, give out diagnoses, forecasts, advice."""


Listener = Callable[[RoomRecord, int], object]


@dataclass
class ClosedLoop:
    """The whole device against the rig.

    Parameters
    ----------
    rig, guard
        Stages; the rig's clock starts where ``now_ns`` stands.
    make_brain
        Called for the first brain and for each that replaces a killed one.
    listeners
        Called with every record that crosses a room's border, and its time: recorder, observer.
    """

    rig: RigStage
    guard: GuardStage
    make_brain: Callable[[], BrainStage]
    listeners: Iterable[Listener] = ()
    now_ns: int = PERIOD_NS
    frames_in: list[RawFrame] = field(default_factory=list)
    frames_out: list[RawFrame] = field(default_factory=list)
    _brain: BrainStage | None = None
    _seq: int = 0
    _advice: Advice | None = None
    _commands: deque[CommandRequest] = field(default_factory=deque)
    _command_seq: int = 0

    def __post_init__(self) -> None:
        self._brain = self.make_brain()

    @property
    def brain_runs(self) -> bool:
        """Whether a brain is connected."""
        return self._brain is not None

    def kill_brain(self) -> None:
        """The brain's process is gone, with all it knew."""
        self._brain = None

    def start_brain(self) -> None:
        """A new brain connects and knows nothing."""
        self._brain = self.make_brain()

    def command(self, verb: str, value: float | None = None, mode: int | None = None) -> int:
        """Queue a person's command for the next cycle; its sequence number."""
        self._command_seq += 1
        self._commands.append(CommandRequest(self._command_seq, verb, value, mode, "closed loop"))
        return self._command_seq

    def step(self) -> Decision:
        """One cycle of :data:`PERIOD_NS`: rig, guard, brain, in the order of the wires."""
        self.now_ns += PERIOD_NS
        self.frames_in = self.rig.step(self.now_ns, self.frames_out)
        if self._seq % SNAPSHOT_EVERY == 0:
            self._tell(self.guard.snapshot(self._seq, self.now_ns))
        cycle = Cycle(
            self._seq, self.now_ns, self.frames_in, self._advice, list(self._commands), self.brain_runs, True, True
        )  # fmt: skip
        self._advice = None
        self._commands.clear()
        decision = self.guard.step(cycle)
        self._seq += 1
        self.frames_out = decision.frames_out
        self._tell(CycleRecord(cycle, decision.frames_out, decision.events))
        self._hand_on(decision)
        return decision

    def _hand_on(self, decision: Decision) -> None:
        """What the guard sends to the brain and the gate, and the brain's answers."""
        records: list[RoomRecord] = [*decision.blocks, *decision.readings, *decision.events]
        if decision.state is not None:
            records.append(decision.state)
        for record in (*records, *decision.replies):
            self._tell(record)
        if self._brain is None:
            return
        for answer in self._brain.step(records, self.now_ns):
            if isinstance(answer, Advice):
                self._advice = answer
            self._tell(answer)

    def _tell(self, record: RoomRecord) -> None:
        for listener in self.listeners:
            listener(record, self.now_ns)
