"""What the brain records of itself, so that a replay finds the same outputs again.

Each step leaves a :class:`~firmware_py.records.BrainStep` (what it took in, by number), and now and
then a :class:`~firmware_py.records.BrainSnapshot` comes before it (where a replay can start).
Samples are no part of a snapshot: they are in the recording already.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final

from firmware_py.brain.normal import digest
from firmware_py.records import (
    Block,
    BrainSnapshot,
    BrainStep,
    CommandRequest,
    GuardState,
    Normal,
    PeerRecord,
    Quality,
    RigReading,
)

SNAPSHOT_PERIOD_NS: Final = 5_000_000_000
"""A recording that begins in the middle is replayed from here on, at the latest."""
BYTES_PER_S: Final = 6_000
"""Larger snapshots (while commissioning gathers decisions) come less often: no more than this on
average."""
PART_BYTES: Final = 64 * 1024
"""A record between two processes is at most twice as large."""


def taken(
    records: Sequence[PeerRecord], seq: int, now_ns: int, late: tuple[int, int] = (0, 0)
) -> BrainStep:
    """The record of step ``seq`` that takes ``records`` and hears of ``late`` answers."""
    return BrainStep(
        seq,
        now_ns,
        runs(record.seq for record in records if isinstance(record, Block)),
        runs(record.seq for record in records if isinstance(record, RigReading)),
        runs(record.seq for record in records if isinstance(record, GuardState)),
        [record.seq for record in records if isinstance(record, CommandRequest)],
        [digest(record) for record in records if isinstance(record, Normal)],
        list(late) if any(late) else [],
    )


def runs(numbers: Iterable[int]) -> list[int]:
    """Increasing ``numbers`` as first and last of each gap-free run, one after the other."""
    ends: list[int] = []
    for number in numbers:
        if ends and number == ends[-1] + 1:
            ends[-1] = number
        else:
            ends += [number, number]
    return ends


def numbers(ends: Sequence[int]) -> list[int]:
    """The numbers in the runs ``ends`` (see :func:`runs`)."""
    pairs = list(pairwise(ends))[::2]
    return [number for first, last in pairs for number in range(first, last + 1)]


class RecentBlocks:
    """The newest blocks of the present gap-free run: what windows and means still look back at.

    Parameters
    ----------
    most
        Samples that are looked back at; blocks beyond are let go.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._blocks: deque[Block] = deque()
        self._samples = 0

    def take(self, block: Block) -> None:
        """Add ``block``; one that does not follow begins anew."""
        if self._blocks and (
            block.quality & Quality.GAP_BEFORE or block.tick_us != end_tick_us(self._blocks[-1])
        ):
            self._blocks.clear()
            self._samples = 0
        self._blocks.append(block)
        self._samples += block.instants
        while self._samples - self._blocks[0].instants >= self._most:
            self._samples -= self._blocks.popleft().instants

    def all(self) -> list[Block]:
        """Oldest first."""
        return list(self._blocks)


def end_tick_us(block: Block) -> int:
    """Unwrapped node tick one period after the last row of ``block``."""
    return block.tick_us + block.instants * block.sample_period_us


class Snapshots:
    """Hands out the snapshots of a run, one part a step, as often as their size allows."""

    def __init__(self, cpu_features: str) -> None:
        self.due_ns = 0
        self._cpu_features = cpu_features
        self._parts: deque[BrainSnapshot] = deque()

    def put(self, seq: int, now_ns: int, blocks: Sequence[Block], state: bytes) -> None:
        """Take the state before step ``seq``."""
        self._parts = deque(split(seq, now_ns, self._cpu_features, blocks, state))
        self.due_ns = now_ns + max(SNAPSHOT_PERIOD_NS, len(state) * 1_000_000_000 // BYTES_PER_S)

    def next_part(self) -> list[BrainSnapshot]:
        """The next part that was not handed out yet, if any."""
        return [self._parts.popleft()] if self._parts else []


def split(
    seq: int, now_ns: int, cpu_features: str, blocks: Sequence[Block], state: bytes
) -> list[BrainSnapshot]:
    """One snapshot in parts that fit between two processes."""
    pieces = [state[at : at + PART_BYTES] for at in range(0, len(state), PART_BYTES)]
    first, last = (blocks[0].seq, blocks[-1].seq) if blocks else (0, -1)
    return [
        BrainSnapshot(seq, now_ns, first, last, cpu_features, piece, part, len(pieces))
        for part, piece in enumerate(pieces)
    ]
