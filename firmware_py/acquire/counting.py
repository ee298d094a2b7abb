"""Frame counters: what was lost, repeated or reordered, when a sender has started again, and when
there are two.

The wire's counter is 16 bit and rises by one per message of one identifier.  Three rules keep a
second sender from pushing the first one out: a near jump forward is believed when the next frame
continues it and not the old sequence; a wide jump, either way, when three frames in a row continue
it; a small one back when six do.  Frames that belong to no sequence are counted, and where the old
one goes on beside them there are two senders.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

from firmware_py.records import (
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    ReadingsFrame,
    RigStatus,
    SampleFrame,
)

NEAR: Final = 64
"""Widest counter jump that the next frame alone may confirm."""

CONFIRM: Final = 3
"""Frames in a row that make a wider jump believable."""

CONFIRM_BACK: Final = 6
"""Frames in a row that make a small step back believable: more than one burst of late frames
holds."""

NEVER_NS: Final = -(1 << 62)
_MASK: Final = 0xFFFF

Message = SampleFrame | RigStatus | NodeState | NodeInfo | ReadingsFrame | NodeFigures | DriveState


class Patience(NamedTuple):
    """How many frames of another sequence, less so many forgiven a second, make two senders; how
    long that stands."""

    frames: float
    forgiven_per_s: float
    hold_ns: int


PATIENCE: Final[dict[type, Patience]] = {
    SampleFrame: Patience(8.0, 1.0, 2_000_000_000),
    RigStatus: Patience(3.0, 0.5, 2_000_000_000),
    NodeState: Patience(3.0, 0.5, 2_000_000_000),
    NodeInfo: Patience(3.0, 0.1, 5_000_000_000),
    ReadingsFrame: Patience(3.0, 0.5, 2_000_000_000),
    NodeFigures: Patience(3.0, 0.1, 5_000_000_000),
    DriveState: Patience(3.0, 0.5, 2_000_000_000),
}
"""A late frame or two, and one burst of them, are one sender's; frames of three periods or more are
not."""


class CounterTrack(msgspec.Struct):
    """Where one message's counter stands (``last`` is -1 before the first frame), and what speaks
    for a second sender.

    ``held`` jumped ahead and waits for the next frame; ``newest`` was taken last; ``beside`` counts
    frames since then that do not continue it; ``level`` is their leaky sum, last changed at
    ``level_ns``.
    """

    last: int = -1
    candidate: int = -1
    run: int = 0
    held: Message | None = None
    held_ns: int = 0
    newest: Message | None = None
    beside: int = 0
    level: float = 0.0
    level_ns: int = 0
    doubled_ns: int = NEVER_NS


class Taken(NamedTuple):
    """A frame that counts: how many were lost before it, and whether its sender began anew."""

    message: Message
    arrival_ns: int
    lost: int
    restarted: bool


def take(
    track: CounterTrack, message: Message, arrival_ns: int, counters: dict[str, int]
) -> list[Taken]:
    """Judge the next frame of one message.

    Parameters
    ----------
    counters
        ``reject_repeated`` (the same frame again), ``reject_conflicting`` (its counter with another
        content) and ``reject_reordered`` (of no sequence) are counted there.

    Returns
    -------
    list
        The frames that count from now on: none, this one, or one that was held before it.
    """
    held = track.held
    if held is not None:
        beyond = (message.counter - held.counter) & _MASK
        between = (message.counter - track.last) & _MASK
        if 1 <= beyond <= NEAR:
            lost = (held.counter - track.last - 1) & _MASK
            first = _taken(track, held, track.held_ns, lost)
            return [first, *take(track, message, arrival_ns, counters)]
        if beyond == 0:
            _refuse_repeated(track, message, held, counters)
            return []
        if 1 <= between < NEAR:  # the old sequence goes on: the held frame is not of it
            track.held = None
            _refuse(track, counters)
            return take(track, message, arrival_ns, counters)
    step = (message.counter - track.last) & _MASK
    if step == 1 or track.last < 0:
        return [_taken(track, message, arrival_ns, 0)]
    if step == 0:
        _refuse_repeated(track, message, track.newest, counters)
        return []
    if step <= NEAR:
        track.held, track.held_ns = message, arrival_ns
        return []
    needed = CONFIRM_BACK if step > _MASK - NEAR else CONFIRM
    track.run = (
        track.run + 1 if track.run and message.counter == (track.candidate + 1) & _MASK else 1
    )
    track.candidate = message.counter
    if track.run < needed:
        _refuse(track, counters)
        return []
    track.beside = 0  # nothing of the old sequence came between: it has ended
    restarted = step > _MASK // 2
    return [_taken(track, message, arrival_ns, 0 if restarted else step - 1, restarted)]


def doubled(track: CounterTrack, kind: type, now_ns: int) -> bool:
    """Whether the message has had two senders of late."""
    return now_ns - track.doubled_ns < PATIENCE[kind].hold_ns


def _taken(
    track: CounterTrack, message: Message, arrival_ns: int, lost: int, restarted: bool = False
) -> Taken:
    """Take ``message`` in; frames of another sequence before it speak for a second sender."""
    track.last, track.newest, track.held, track.run = message.counter, message, None, 0
    if track.beside:
        suspect(track, type(message), track.beside, arrival_ns)
        track.beside = 0
    return Taken(message, arrival_ns, lost, restarted)


def suspect(track: CounterTrack, kind: type, frames: int, now_ns: int) -> None:
    """Add ``frames`` to the leaky sum; while it is full, each more of them lets the verdict stand
    anew."""
    patience = PATIENCE[kind]
    forgiven = max(now_ns - track.level_ns, 0) * 1e-9 * patience.forgiven_per_s
    track.level = min(max(track.level - forgiven, 0.0) + frames, 2.0 * patience.frames)
    track.level_ns = now_ns
    if track.level >= patience.frames:
        track.doubled_ns = now_ns


def _refuse(track: CounterTrack, counters: dict[str, int]) -> None:
    track.beside += 1
    counters["reject_reordered"] += 1


def _refuse_repeated(
    track: CounterTrack, message: Message, known: Message | None, counters: dict[str, int]
) -> None:
    """The same frame again is a repetition; another one under its counter comes from somebody
    else."""
    if message == known:
        counters["reject_repeated"] += 1
        return
    track.beside += 1
    counters["reject_conflicting"] += 1
