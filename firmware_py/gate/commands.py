"""Command intake: every request gets exactly one answer, accepted or all reasons why not.

A request arrives as a Zenoh query on the exact key ``cmd/<verb>`` with a JSON object that carries
an id.  It goes to the process that answers the verb with a sequence number of the gate's own; its
:class:`CommandReply` finds its way back by that number, and a process that stays silent is an
answer too.  A request whose id was seen before is not executed again but answered the same.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import msgspec

from firmware_py.gate import requests
from firmware_py.gate.requests import MalformedCommandError
from firmware_py.records import CommandReply, CommandRequest
from firmware_py.routing import stage_of

ANSWER_WITHIN_NS: Final = 1_000_000_000
MAX_PENDING: Final = 64
IDS_KEPT: Final = 1024
"""Executed requests whose id is remembered, the newest; at the rate below that is more than ten
seconds of a flood."""

RATE_HZ: Final = 10.0
BURST: Final = 20.0
"""Of one verb; a person and any sane program stay far below.  ``disarm`` is not limited: all that
wait are one."""

Answer = Callable[[CommandReply], None]


@dataclass
class _Case:
    """One request on its way through a process, and everybody who waits for its answer."""

    deadline_ns: int
    request: CommandRequest
    answers: list[Answer]
    reply: CommandReply | None = None
    others: int = 0


@dataclass
class _Allowance:
    """A token bucket."""

    tokens: float = BURST
    at_ns: int = 0

    def take(self, now_ns: int) -> bool:
        self.tokens = min(BURST, self.tokens + max(0, now_ns - self.at_ns) * 1e-9 * RATE_HZ)
        self.at_ns = now_ns
        if self.tokens < 1.0:
            return False
        self.tokens -= 1.0
        return True


@dataclass
class _Memory:
    """Executed requests by id, the newest ``IDS_KEPT``."""

    cases: OrderedDict[str, _Case] = field(default_factory=OrderedDict)

    def keep(self, request_id: str, case: _Case) -> None:
        self.cases[request_id] = case
        while len(self.cases) > IDS_KEPT:
            self.cases.popitem(last=False)


class CommandDesk:
    """Matches the replies of guard and brain to those who asked.

    Parameters
    ----------
    send
        Hands a request to the process that answers its verb without waiting; False when that is
        impossible now.

    Notes
    -----
    ``counters``: ``commands_asked``, ``commands_answered``, ``commands_refused_here``,
    ``commands_too_fast``, ``commands_repeated`` (an id seen before), ``commands_joined`` (a
    ``disarm`` that shared another's request), ``commands_timed_out``, ``replies_unexpected``.
    """

    def __init__(self, send: Callable[[CommandRequest], bool]) -> None:
        self.counters: Counter[str] = Counter()
        self._send = send
        self._seq = 0
        self._others = (
            0  # requests sent that were no disarm: what makes an earlier disarm out of date
        )
        self._pending: dict[int, _Case] = {}
        self._memory = {
            "disarm": _Memory(),
            "other": _Memory(),
        }  # a flood of disarms forgets no other id
        self._allowances: dict[str, _Allowance] = {}
        self._disarm: tuple[int, _Case] | None = None

    def hear(
        self, verb: str, payload: bytes, origin: str, answer: Answer, now_ns: int
    ) -> CommandRequest | None:
        """Take a request as it came from outside; else as :meth:`ask`."""
        try:
            received = requests.read(verb, payload)
        except MalformedCommandError as error:
            self.counters["commands_asked"] += 1
            self._refuse(answer, str(error), "")
            return None
        return self.ask(verb, received.value, origin, answer, now_ns, received.id)

    def ask(
        self,
        verb: str,
        value: object,
        origin: str,
        answer: Answer,
        now_ns: int,
        request_id: str = "",
    ) -> CommandRequest | None:
        """Put a request to its process; ``answer`` is called once, now or later.

        Returns
        -------
        The request that went there, or None when none had to go: refused here, repeated, or shared.
        """
        self.counters["commands_asked"] += 1
        self._seq += 1
        try:
            request = requests.parse(self._seq, verb, value, origin, request_id)
        except MalformedCommandError as error:
            self._refuse(answer, str(error), request_id)
            return None
        if request_id and self._repeated(request, answer):
            return None
        if verb == "disarm" and self._disarm and self._disarm[0] == now_ns:
            self.counters["commands_joined"] += 1
            self._join(self._disarm[1], answer, request_id)
            return None
        reason = "" if verb == "disarm" else self._full(verb, now_ns)
        if not reason and not self._send(request):
            process = stage_of(verb)
            reason = (
                f"the {process} is not connected; start it with 'orbitd {process}' or 'orbitd run'"
            )
        if reason:
            self._refuse(answer, reason, request_id)
            return None
        self._sent(request, _answering(answer, request_id), now_ns)
        return request

    def reply(self, reply: CommandReply) -> CommandRequest | None:
        """Hand on a process's answer; the request that it answers, None when nobody waits for it
        any more."""
        case = self._pending.pop(reply.seq, None)
        if case is None:
            self.counters["replies_unexpected"] += 1
            return None
        self.counters["commands_answered"] += 1
        self._finish(case, reply)
        return case.request

    def step(self, now_ns: int) -> None:
        """Answer for a process that did not."""
        late = [seq for seq, case in self._pending.items() if now_ns >= case.deadline_ns]
        for seq in late:
            self.counters["commands_timed_out"] += 1
            case = self._pending.pop(seq)
            process = stage_of(case.request.verb)
            text = (
                f"the {process} did not answer within {ANSWER_WITHIN_NS * 1e-9:g} s; see 'orbitd "
                "status'"
            )
            self._finish(case, CommandReply(seq=seq, accepted=False, reasons=[text]))

    def _sent(self, request: CommandRequest, answer: Answer, now_ns: int) -> None:
        case = _Case(now_ns + ANSWER_WITHIN_NS, request, [answer])
        if request.verb == "disarm":
            self._disarm = (now_ns, case)
        else:
            self._others += 1
            self._disarm = None
        case.others = self._others
        self._pending[request.seq] = case
        if request.id:
            self._remembered(request.verb).keep(request.id, case)

    def _repeated(self, request: CommandRequest, answer: Answer) -> bool:
        """Whether the id was executed before: then ``answer`` gets, now or later, what the first
        asker got."""
        found = [
            memory.cases[request.id]
            for memory in self._memory.values()
            if request.id in memory.cases
        ]
        if not found:
            return False
        case = found[0]
        if request.verb == case.request.verb == "disarm" and case.others != self._others:
            return False  # something was commanded since: a disarm must disarm
        self.counters["commands_repeated"] += 1
        if (
            msgspec.structs.replace(
                request, seq=case.request.seq, origin=case.request.origin, id=case.request.id
            )
            != case.request
        ):
            self._refuse(
                answer,
                f"{request.verb}: the id {request.id!r} was used for another command before; "
                "send a new one",
                request.id,
            )
        elif case.reply is None:
            case.answers.append(_answering(answer, request.id))
        else:
            answer(msgspec.structs.replace(case.reply, id=request.id))
        return True

    def _join(self, case: _Case, answer: Answer, request_id: str) -> None:
        """One ``disarm`` to the guard serves all that came in the same step, with no other command
        between."""
        if case.reply is None:
            case.answers.append(_answering(answer, request_id))
        else:
            answer(msgspec.structs.replace(case.reply, id=request_id))
        if request_id:
            self._remembered("disarm").keep(request_id, case)

    def _full(self, verb: str, now_ns: int) -> str:
        """Why no more of ``verb`` is taken now; empty when it is."""
        if not self._allowances.setdefault(verb, _Allowance(at_ns=now_ns)).take(now_ns):
            self.counters["commands_too_fast"] += 1
            return f"{verb}: more than {RATE_HZ:g} in a second; wait before you send the next"
        if len(self._pending) >= MAX_PENDING:
            return f"{MAX_PENDING} commands already wait for an answer; try again in a second"
        return ""

    def _remembered(self, verb: str) -> _Memory:
        return self._memory["disarm" if verb == "disarm" else "other"]

    def _finish(self, case: _Case, reply: CommandReply) -> None:
        case.reply = reply
        answers, case.answers = case.answers, []
        for answer in answers:
            answer(reply)

    def _refuse(self, answer: Answer, reason: str, request_id: str) -> None:
        self.counters["commands_refused_here"] += 1
        answer(CommandReply(seq=self._seq, accepted=False, reasons=[reason], id=request_id))


def _answering(answer: Answer, request_id: str) -> Answer:
    """``answer`` with the asker's own id in the reply."""
    return lambda reply: answer(msgspec.structs.replace(reply, id=request_id))
