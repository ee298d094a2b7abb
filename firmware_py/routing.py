"""Which record goes from which stage to which, in which order, and how often each stage steps.

The three processes, the closed loop on the simulated clock and the replay all go by this one
table.  A stage sends what one of its steps put out in the order of the rows.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from typing import Final, NamedTuple

from firmware_py.records import (
    BRAIN_VERBS,
    Advice,
    Block,
    BrainSnapshot,
    BrainState,
    BrainStep,
    CommandReply,
    CommandRequest,
    CommissionState,
    Cycle,
    CycleRecord,
    Decision,
    Diagnosis,
    Event,
    EventAck,
    Forecast,
    GuardState,
    ModelsInUse,
    Normal,
    PeerRecord,
    Record,
    RigReading,
    ShadowDiagnosis,
    Snapshot,
    WindowRecord,
)

GUARD_PERIOD_NS: Final = 1_000_000
SNAPSHOT_CYCLES: Final = 1000
"""Cycles between two snapshots of the guard."""
BRAIN_PERIOD_NS: Final = 20_000_000
"""Far below the advice's 100 ms; the guard's socket holds many times this."""
GATE_PERIOD_NS: Final = 10_000_000


class Stage(enum.StrEnum):
    """A process of the device; the value is its role on the sockets."""

    GUARD = "guard"
    BRAIN = "brain"
    GATE = "gate"


class Route(NamedTuple):
    """Records of ``kind`` go from ``source`` to each of ``to``."""

    kind: type[Record]
    source: Stage
    to: tuple[Stage, ...]


_GUARD, _BRAIN, _GATE = Stage

ROUTES: Final = (
    Route(Snapshot, _GUARD, (_GATE,)),
    Route(CommandReply, _GUARD, (_GATE,)),
    Route(Event, _GUARD, (_GATE,)),
    Route(Block, _GUARD, (_BRAIN, _GATE)),
    Route(RigReading, _GUARD, (_BRAIN, _GATE)),
    Route(GuardState, _GUARD, (_BRAIN, _GATE)),
    Route(CycleRecord, _GUARD, (_GATE,)),
    Route(BrainSnapshot, _BRAIN, (_GATE,)),
    Route(BrainStep, _BRAIN, (_GATE,)),
    Route(ModelsInUse, _BRAIN, (_GATE,)),  # on disk before a promotion is answered
    Route(CommandReply, _BRAIN, (_GATE,)),
    Route(Normal, _BRAIN, (_GATE,)),
    Route(Diagnosis, _BRAIN, (_GATE,)),
    Route(WindowRecord, _BRAIN, (_GATE,)),
    Route(ShadowDiagnosis, _BRAIN, (_GATE,)),
    Route(Forecast, _BRAIN, (_GATE,)),
    Route(Advice, _BRAIN, (_GUARD, _GATE)),
    Route(BrainState, _BRAIN, (_GATE,)),
    Route(CommissionState, _BRAIN, (_GATE,)),
    Route(CommandRequest, _GATE, (_GUARD, _BRAIN)),  # to the one that answers the verb
    Route(EventAck, _GATE, (_GUARD,)),
    Route(Normal, _GATE, (_BRAIN,)),
)

ROUTES_OF: Final = {
    stage: tuple(route for route in ROUTES if route.source is stage) for stage in Stage
}
"""The rows of each source, in their order."""

_ROWS: Final = {(route.source, route.kind): row for row, route in enumerate(ROUTES)}


def stage_of(verb: str) -> Stage:
    """The stage that answers ``verb``."""
    return Stage.BRAIN if verb in BRAIN_VERBS else Stage.GUARD


def receivers(source: Stage, record: PeerRecord) -> tuple[Stage, ...]:
    """Where ``record`` of ``source`` goes; nowhere when that stage sends none of its kind."""
    row = _ROWS.get((source, type(record)))
    if row is None:
        return ()
    if isinstance(record, CommandRequest):
        return (stage_of(record.verb),)
    return ROUTES[row].to


def in_order(source: Stage, records: Iterable[PeerRecord]) -> list[PeerRecord]:
    """What one step of ``source`` put out, as it is sent: by kind, each kind as it came."""
    return sorted(records, key=lambda record: _ROWS[source, type(record)])


def put_out(cycle: Cycle, decision: Decision) -> list[PeerRecord]:
    """All records of one cycle of the guard, in their order."""
    state = [decision.state] if decision.state is not None else []
    cycle_record = CycleRecord(cycle, decision.frames_out, decision.events)
    return in_order(
        Stage.GUARD,
        [
            *decision.replies,
            *decision.events,
            *decision.blocks,
            *decision.readings,
            *state,
            cycle_record,
        ],
    )
