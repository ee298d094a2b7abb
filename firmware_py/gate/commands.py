"""Command intake: every wish gets exactly one answer, accepted or all reasons why not.

A wish arrives as a Zenoh query on ``cmd/<verb>`` with its value as JSON.  It goes to the room that answers the verb
with a sequence number of the gate's own; that room's :class:`CommandReply` finds its way back by that number, and a
room that stays silent is an answer too.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import msgspec

from firmware_py.records import (
    BRAIN_VERBS,
    COMMISSION_ACTIONS,
    VERBS,
    CommandReply,
    CommandRequest,
    Mode,
    PlannedRamp,
)

ANSWER_WITHIN_NS: Final = 1_000_000_000
MAX_PENDING: Final = 64
UNITS: Final = {"set_clearance": "um, radial", "set_pressure": "bar"}

Answer = Callable[[CommandReply], None]


class MalformedCommandError(ValueError):
    """A wish that cannot be put to the guard; the text says what is wrong with it."""


@dataclass(frozen=True)
class _Pending:
    deadline_ns: int
    answer: Answer
    request: CommandRequest


class CommandDesk:
    """Matches the replies of guard and brain to those who asked.

    Parameters
    ----------
    send
        Hands a request to the room that answers its verb without waiting; False when that is impossible now.

    Notes
    -----
    ``counters``: ``commands_asked``, ``commands_answered``, ``commands_refused_here``,
    ``commands_timed_out``, ``replies_unexpected``.
    """

    def __init__(self, send: Callable[[CommandRequest], bool]) -> None:
        self.counters: Counter[str] = Counter()
        self._send = send
        self._seq = 0
        self._pending: dict[int, _Pending] = {}

    def ask(self, verb: str, payload: bytes, origin: str, answer: Answer, now_ns: int) -> CommandRequest | None:
        """Put a wish to its room; ``answer`` is called once, now or later.

        Returns
        -------
        The request that went there, or None when it was refused here.
        """
        self._seq += 1
        self.counters["commands_asked"] += 1
        try:
            request = parse(self._seq, verb, payload, origin)
        except MalformedCommandError as error:
            self._refuse(answer, str(error))
            return None
        if len(self._pending) >= MAX_PENDING and verb != "disarm":
            self._refuse(answer, f"{MAX_PENDING} commands already wait for an answer; try again in a second")
            return None
        if not self._send(request):
            room = room_of(verb)
            self._refuse(answer, f"the {room} is not connected; start it with 'orbitd {room}' or 'orbitd run'")
            return None
        self._pending[request.seq] = _Pending(now_ns + ANSWER_WITHIN_NS, answer, request)
        return request

    def reply(self, reply: CommandReply) -> CommandRequest | None:
        """Hand on a room's answer; the request that it answers, None when nobody waits for it any more."""
        pending = self._pending.pop(reply.seq, None)
        if pending is None:
            self.counters["replies_unexpected"] += 1
            return None
        self.counters["commands_answered"] += 1
        pending.answer(reply)
        return pending.request

    def step(self, now_ns: int) -> None:
        """Answer for a room that did not."""
        late = [seq for seq, pending in self._pending.items() if now_ns >= pending.deadline_ns]
        for seq in late:
            self.counters["commands_timed_out"] += 1
            pending = self._pending.pop(seq)
            room = room_of(pending.request.verb)
            text = f"the {room} did not answer within {ANSWER_WITHIN_NS * 1e-9:g} s; see 'orbitd status'"
            pending.answer(CommandReply(seq=seq, accepted=False, reasons=[text]))

    def _refuse(self, answer: Answer, reason: str) -> None:
        self.counters["commands_refused_here"] += 1
        answer(CommandReply(seq=self._seq, accepted=False, reasons=[reason]))


def room_of(verb: str) -> str:
    """The room that answers ``verb``."""
    return "brain" if verb in BRAIN_VERBS else "guard"


def parse(seq: int, verb: str, payload: bytes, origin: str) -> CommandRequest:
    """The request that ``verb`` with the JSON ``payload`` means.

    Raises
    ------
    MalformedCommandError
        Unknown verb, no JSON, or a value that the verb does not take.
    """
    if verb not in (*VERBS, *BRAIN_VERBS):
        raise MalformedCommandError(f"verb '{verb}' is unknown; use one of {', '.join((*VERBS, *BRAIN_VERBS))}")
    try:
        value = msgspec.json.decode(payload) if payload else None
    except msgspec.DecodeError as error:
        raise MalformedCommandError(f"{verb}: the payload is no JSON ({error}); send e.g. 60.0") from error
    if verb == "mode":
        return CommandRequest(seq=seq, verb=verb, mode=_mode(value), origin=origin)
    if verb in UNITS:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise MalformedCommandError(f"{verb}: needs one finite number ({UNITS[verb]}), got {value!r}")
        return CommandRequest(seq=seq, verb=verb, value=float(value), origin=origin)
    if verb == "announce":
        return CommandRequest(seq=seq, verb=verb, origin=origin, ramp=_ramp(value))
    if verb == "commission":
        if value not in COMMISSION_ACTIONS:
            raise MalformedCommandError(f"commission: {value!r} is none of {', '.join(COMMISSION_ACTIONS)}")
        return CommandRequest(seq=seq, verb=verb, origin=origin, action=str(value))
    if value is not None:
        raise MalformedCommandError(f"{verb}: takes no value, got {value!r}; send an empty payload")
    return CommandRequest(seq=seq, verb=verb, origin=origin)


def _ramp(value: object) -> PlannedRamp:
    try:
        return msgspec.convert(value, PlannedRamp)
    except msgspec.ValidationError as error:
        raise MalformedCommandError(
            f'announce: {error}; send e.g. {{"start_s": 3, "end_s": 5, "speed_rpm": 9000, "load_N": 60}}') from error


def _mode(value: object) -> int:
    names = [mode.name.lower() for mode in Mode]
    if value not in names:
        raise MalformedCommandError(f"mode: {value!r} is none of {', '.join(names)}")
    return Mode[str(value).upper()]
