"""What a replay needs: cycles, decisions, steps of the brain, snapshots, windows."""

from __future__ import annotations

import msgspec

from firmware_py.records.acquired import Block, RigReading
from firmware_py.records.base import Record
from firmware_py.records.brain import Advice
from firmware_py.records.command import CommandReply, CommandRequest
from firmware_py.records.guard import Event, GuardState
from firmware_py.records.wire import RawFrame


class Cycle(Record, frozen=True, tag=True):
    """All that one guard cycle read: with the snapshot before it, it determines the decision."""

    seq: int
    now_ns: int
    frames: list[RawFrame]
    advice: Advice | None
    commands: list[CommandRequest]
    brain_connected: bool
    gate_connected: bool
    link_up: bool
    memory_fault: str = ""
    """Why the files that survive the guard cannot be written; empty while they can."""
    link_fault: str = ""
    """What is wrong with the link, up or not."""


class Decision(Record, frozen=True, tag=True):
    """All that one guard cycle put out."""

    seq: int
    frames_out: list[RawFrame]
    blocks: list[Block]
    readings: list[RigReading]
    events: list[Event]
    replies: list[CommandReply]
    state: GuardState | None


class CycleRecord(Record, frozen=True, tag=True):
    """One cycle for the flight recorder: what came in, and the frames and events that went out."""

    cycle: Cycle
    frames_out: list[RawFrame]
    events: list[Event]


class Snapshot(Record, frozen=True, tag=True):
    """The guard's whole state before cycle ``seq``: a replay segment starts here."""

    seq: int
    now_ns: int
    state: bytes


class BrainStep(Record, frozen=True, tag=True, omit_defaults=True):
    """What one step of the brain took in: with the snapshot before it, it determines the outputs.

    The records themselves are recorded elsewhere, or come out of the guard's replay.  ``blocks``,
    ``readings`` and ``states`` (of the guard) hold their sequence numbers as runs: first and last,
    first and last.  ``requests``: sequence numbers; ``normals``: names
    (:func:`firmware_py.brain.normal.digest`).  Those of the gate are taken first, then those of the
    guard in its order.
    """

    seq: int
    now_ns: int
    blocks: list[int] = msgspec.field(default_factory=list)
    readings: list[int] = msgspec.field(default_factory=list)
    states: list[int] = msgspec.field(default_factory=list)
    requests: list[int] = msgspec.field(default_factory=list)
    normals: list[str] = msgspec.field(default_factory=list)
    late: list[int] = msgspec.field(default_factory=list)
    """Answers that came late since the step before: of the models in use, of those beside."""


class BrainSnapshot(Record, frozen=True, tag=True):
    """A part of the brain's whole state before step ``seq``, but for its samples.

    Those are in the blocks from ``first_block`` to ``last_block`` (0 to -1: none).  ``state`` of
    all ``parts`` together is the tree of :mod:`firmware_py.brain.tree`.  ``cpu_features``: where
    the outputs after it are exact to the bit.
    """

    seq: int
    now_ns: int
    first_block: int
    last_block: int
    cpu_features: str
    state: bytes
    part: int = 0
    parts: int = 1


class WindowRecord(Record, frozen=True, tag=True):
    """What the brain decided on: ``last_t_acq_ns`` closes the window, for replay.

    ``normal`` names the machine's normal state that it was judged against (empty: the fleet's).
    """

    seq: int
    last_t_acq_ns: int
    last_block_seq: int
    diagnosis_seq: int
    cpu_features: str
    normal: str = ""
