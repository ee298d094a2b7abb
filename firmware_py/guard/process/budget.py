"""The budget of one guard cycle: what it may take in, and what it may cost, in every state.

The guard runs 1000 times a second.  Everything that comes from outside is bounded per cycle, so
that neither a sick peer nor a busy bus can hold it up; what is left over waits in the kernel's
queues, and a sender whose queue is full loses the newest.  ``tests/guard/process/test_budget.py``
measures every state beside a reference in the same run.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.records import Advice
from firmware_py.wire.peer_socket import Limit

PEER_LIMITS: Final = {
    "brain": Limit(records=2, record_bytes=16 * 1024),
    "gate": Limit(records=8, record_bytes=4 * 1024),
}
"""Per cycle and peer.  An advice has 0.2 to 2 kB, ten a second; a request or an acknowledgement
less than 1 kB. Of several advices in one cycle the newest counts.  A larger record is counted
(``room_oversized_<role>``) and dropped before it is decoded: decoding costs up to 13 us per kB."""

REASONS_MAX: Final = 16
REASON_CHARS_MAX: Final = 200
"""Of an advice; the rest is cut off, for every reason is carried on in each state and event."""

EVENTS_PER_CYCLE: Final = 16
"""To a gate that comes back and must be told again what it has not acknowledged (up to 1000
events)."""

CYCLE_US: Final = {
    "disarmed": 250,
    "armed": 300,
    "tripped": 300,
    "samples gone": 250,
    "link down": 250,
    "node gone, samples left": 300,
    "brain gone": 300,
    "requests, 8 a cycle": 600,
    "advices, 1 a cycle": 350,
    "frames of nobody, 32 a cycle": 500,
    "forged frames, 32 a cycle": 700,
    "sample frames, 32 a cycle": 1200,
}
"""Mean cost of a cycle of :class:`~firmware_py.guard.core.GuardCore`, where the reference takes
:data:`REFERENCE_US`.  What happens every day gets less than a third of the period; a board three
times slower than the reference still keeps it.

The last three cannot last on a real bus, and 32 sample frames hold 19 ms of samples, which are
judged in one cycle: 1 Mbit/s and 5 Mbit/s carry some 8 frames of 64 bytes in a millisecond."""

JUNK_US: Final = 2500
"""Looking through what one call reads from a serial port, where none of it is a packet."""

REFERENCE_US: Final = 255.0
"""The reference: 1000 rounds of packing, unpacking and summing eight 16-bit numbers (see the
test)."""


def bounded(advice: Advice) -> Advice:
    """``advice`` with no more reasons, and no longer ones, than a person can use."""
    reasons, others = advice.reasons, (advice.models, advice.beside, advice.rolled_back)
    fit = all(len(text) <= REASON_CHARS_MAX for text in (*reasons, *others))
    if len(reasons) <= REASONS_MAX and fit:
        return advice
    models, beside, rolled_back = (text[:REASON_CHARS_MAX] for text in others)
    return msgspec.structs.replace(
        advice,
        reasons=[text[:REASON_CHARS_MAX] for text in reasons[:REASONS_MAX]],
        models=models,
        beside=beside,
        rolled_back=rolled_back,
    )
