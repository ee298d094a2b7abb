"""Frame counters: what was lost, repeated or reordered, and when a node has started again.

The wire's counter is 16 bit and rises by one per message of one identifier.  A small jump forward is a
loss, a small jump backward a late frame.  Any wider jump is believed only when three frames in a row
continue it: one forged or damaged frame cannot push the true ones out.
"""

from __future__ import annotations

from typing import Final

import msgspec

NEAR: Final = 64
"""Widest counter jump (either way) that one frame alone may claim."""

CONFIRM: Final = 3
"""Frames in a row that make a wider jump believable."""

REPEATED: Final = -1
REORDERED: Final = -2
RESTARTED: Final = -3
"""Verdicts of :func:`advance` below zero; a restarted counter's frame is good, the others are not."""

_MASK: Final = 0xFFFF


class CounterTrack(msgspec.Struct):
    """Where one message's counter stands; ``last`` is -1 before the first frame."""

    last: int = -1
    candidate: int = -1
    run: int = 0


def advance(track: CounterTrack, counter: int) -> int:
    """Judge the next ``counter`` of a message.

    Returns
    -------
    int
        Number of frames lost before this one (0 = none), or :data:`REPEATED`, :data:`REORDERED`
        (drop the frame), or :data:`RESTARTED` (take it: the sender began anew).
    """
    step = (counter - track.last) & _MASK
    if step == 1 or track.last < 0:
        track.last = counter
        track.run = 0
        return 0
    if step == 0:
        return REPEATED
    if step <= NEAR:
        track.last = counter
        track.run = 0
        return step - 1
    if step > _MASK - NEAR:
        return REORDERED
    return _far_jump(track, counter, step)


def _far_jump(track: CounterTrack, counter: int, step: int) -> int:
    """A jump wider than :data:`NEAR`: refused until :data:`CONFIRM` frames in a row continue it."""
    track.run = track.run + 1 if track.run and counter == (track.candidate + 1) & _MASK else 1
    track.candidate = counter
    if track.run < CONFIRM:
        return REORDERED
    track.last = counter
    track.run = 0
    return step - 1 if step <= _MASK // 2 else RESTARTED
