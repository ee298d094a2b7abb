"""Queries on Zenoh: small rings in, bounded work, answers that wait for no reader.

Reading is harmless, whatever the key expression; a command must name its exact key.  Zenoh's own
threads only fill the rings.  A reply can block while its reader does not read, so replies leave
through threads of their own (:class:`Mouth`): one for ``disarm``, one for the other commands, one
for what is read; none of them waits for another.
"""

from __future__ import annotations

import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import zenoh
from zenoh.handlers import RingChannel

from firmware_py.gate import keys
from firmware_py.records import BRAIN_VERBS, VERBS, CommandReply

RING: Final = 32
"""Queries of one kind that may wait for the loop; older ones are dropped and their askers get no
answer."""

DISARM_RING: Final = 1024
"""At the greatest rate of one client (some ten thousand a second) this holds what comes in a few
steps."""

DISARMS_PER_STEP: Final = 256
REFUSALS_PER_STEP: Final = 4
"""Of one verb, told why a query is no command; the others are counted and end without a word."""

ANSWERS_PER_STEP: Final = 8
"""Of one kind of question: 800 a second."""

BYTES_PER_STEP: Final = 20_000
BYTES_SAVED_MAX: Final = 500_000
"""Of one kind of question: 2 MB/s, saved up for a burst; the list of a thousand events has some 300
kB."""

MOUTH_WAITING: Final = 512
COMMAND_ORDER: Final = ("disarm", *(verb for verb in (*VERBS, *BRAIN_VERBS) if verb != "disarm"))
"""Disarm waits behind nothing: it has its own ring, and that ring is looked at first."""

QUESTIONS: Final = (keys.STATE, keys.CONFIG, keys.MODELS, keys.EVENTS, keys.ALARMS)
MSGPACK: Final = zenoh.Encoding("application/msgpack")
COMMAND_PARAMETERS: Final = ("as", "_anyke")
BUSY: Final = "the gate answers no more questions of this kind now; ask less often"

to_json = msgspec.json.Encoder().encode
to_msgpack = msgspec.msgpack.Encoder().encode


@dataclass(frozen=True)
class Question:
    """What is asked for, its parameters, and whether the answer is to be msgpack."""

    query: zenoh.Query
    parameters: dict[str, str]

    @property
    def packed(self) -> bool:
        """Whether the answer is to be msgpack."""
        return self.parameters.get("as") == "msgpack"


@dataclass(frozen=True)
class AskedCommand:
    """A command query on its exact key."""

    verb: str
    payload: bytes
    question: Question


class Mouth:
    """Sends replies from a thread of its own; what finds no room is dropped and counted."""

    def __init__(self, name: str, counters: Counter[str]) -> None:
        self._name = name
        self._counters = counters
        # The loop reads the counters while the thread counts: no key may be new by then.
        counters.update({"zenoh_failed": 0, f"replies_dropped_{name}": 0})
        self._waiting: queue.Queue[Callable[[], None] | None] = queue.Queue(MOUTH_WAITING)
        self._thread = threading.Thread(target=self._serve, name=f"reply-{name}", daemon=True)
        self._thread.start()

    def say(self, question: Question, key: str | None, data: bytes) -> None:
        """Answer with ``data`` on ``key`` (None: as an error) and end the query."""
        query, encoding = (
            question.query,
            MSGPACK if question.packed else zenoh.Encoding.APPLICATION_JSON,
        )

        def speak() -> None:
            try:
                if key is None:
                    query.reply_err(data)
                else:
                    query.reply(key, data, encoding=encoding)
            except zenoh.ZError:
                self._counters["zenoh_failed"] += 1
            query.drop()  # type: ignore[no-untyped-call]

        try:
            self._waiting.put_nowait(speak)
        except queue.Full:
            self._counters[f"replies_dropped_{self._name}"] += 1

    def close(self, within_s: float = 1.0) -> None:
        """Say what waits and end."""
        try:
            self._waiting.put(None, timeout=within_s)
        except queue.Full:
            return  # its reader does not read; the thread ends with the process
        self._thread.join(within_s)

    def _serve(self) -> None:
        while (speak := self._waiting.get()) is not None:
            speak()


class Queries:
    """The device's queryables.

    Parameters
    ----------
    session
        Open session.
    prefix
        What every key starts with.
    counters
        ``commands_wildcard_refused``, ``commands_parameters_refused``, ``questions_refused_<kind>``
        (over the budget of a step), ``replies_dropped_<mouth>``, ``zenoh_failed``.
    """

    def __init__(self, session: zenoh.Session, prefix: str, counters: Counter[str]) -> None:
        self._prefix = prefix
        self._commands: list[tuple[str, Any]] = []
        self._questions: list[tuple[str, Any]] = []
        self._left = dict.fromkeys(QUESTIONS, BYTES_SAVED_MAX)
        self._counters = counters
        self._mouths = {name: Mouth(name, counters) for name in ("disarm", "commands", "questions")}

        self.serve(session)

    def serve(self, session: zenoh.Session) -> None:
        """Answer on ``session`` as well."""

        def queryable(name: str, size: int) -> Any:
            return session.declare_queryable(
                f"{self._prefix}/{name}", RingChannel(size), complete=True
            )

        self._commands += [
            (verb, queryable(keys.command(verb), DISARM_RING if verb == "disarm" else RING))
            for verb in COMMAND_ORDER
        ]
        self._commands.sort(key=lambda entry: entry[0] != "disarm")
        self._questions += [(name, queryable(name, RING)) for name in QUESTIONS]

    def commands(self) -> Iterator[AskedCommand]:
        """Command queries that wait on their exact key; all others are refused here."""
        for verb, waiting in list(self._commands):
            refused = 0
            for query in _drain(waiting, DISARMS_PER_STEP if verb == "disarm" else RING):
                question = Question(query, parameters(query))
                if refusal := self._refusal(verb, question):
                    refused += 1
                    self._refuse(verb, question, refusal if refused <= REFUSALS_PER_STEP else "")
                else:
                    yield AskedCommand(
                        verb, query.payload.to_bytes() if query.payload else b"", question
                    )

    def _refuse(self, verb: str, question: Question, refusal: str) -> None:
        """Tell why, behind what is read and not before a disarm; without a text end the query in
        silence."""
        if not refusal:
            question.query.drop()  # type: ignore[no-untyped-call]
            return
        reply = CommandReply(seq=0, accepted=False, reasons=[refusal])
        self._answer("questions", verb, question, reply)

    def questions(self, encode: Callable[[str, Question], bytes]) -> None:
        """Answer the questions that wait, as far as the budget of a step goes; ``encode`` gives
        each answer."""
        mouth = self._mouths["questions"]
        for name in self._left:
            self._left[name] = min(BYTES_SAVED_MAX, self._left[name] + BYTES_PER_STEP)
        for name, waiting in self._questions:
            for number, query in enumerate(_drain(waiting, RING)):
                question = Question(query, parameters(query))
                if self._left[name] <= 0 or number >= ANSWERS_PER_STEP:
                    self._counters[f"questions_refused_{name}"] += 1
                    mouth.say(question, None, BUSY.encode())
                    continue
                data = encode(name, question)
                self._left[name] -= len(data)
                mouth.say(question, f"{self._prefix}/{name}", data)

    def answer_command(self, verb: str, question: Question, reply: CommandReply) -> None:
        """Answer a command and end its query."""
        self._answer("disarm" if verb == "disarm" else "commands", verb, question, reply)

    def _answer(self, mouth: str, verb: str, question: Question, reply: CommandReply) -> None:
        data = to_msgpack(reply) if question.packed else to_json(reply)
        self._mouths[mouth].say(question, f"{self._prefix}/{keys.command(verb)}", data)

    def close(self) -> None:
        """Say what waits and end."""
        for mouth in self._mouths.values():
            mouth.close()

    def _refusal(self, verb: str, question: Question) -> str:
        """Why a query is no command; empty when it is one."""
        key = f"{self._prefix}/{keys.command(verb)}"
        if str(question.query.key_expr) != key:
            self._counters["commands_wildcard_refused"] += 1
            return (
                f"{verb}: asked by a key expression that matches more than this command; reading "
                f"executes nothing, "
                f"a command names its exact key: {key}"
            )
        strange = sorted(set(question.parameters) - set(COMMAND_PARAMETERS))
        if strange:
            self._counters["commands_parameters_refused"] += 1
            return (
                f"{verb}: parameter {strange[0][:40]!r} is unknown; a command takes its id and "
                f"value in the JSON "
                f"payload and no parameter but {COMMAND_PARAMETERS[0]}"
            )
        return ""


def parameters(query: zenoh.Query) -> dict[str, str]:
    """The parameters of ``query``; of a repeated name the first counts."""
    found: dict[str, str] = {}
    for part in str(query.parameters).split(";"):
        name, _, value = part.partition("=")
        if name:
            found.setdefault(name, value)
    return found


def _drain(waiting: Any, limit: int) -> Iterator[zenoh.Query]:
    """At most ``limit`` queries that wait now."""
    for _ in range(limit):
        try:
            query = waiting.try_recv()
        except zenoh.ZError:  # its session was closed
            return
        if query is None:
            return
        yield query
