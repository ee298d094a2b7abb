"""Telemetry and queries on Zenoh: publications that never block, queries that wait in small rings.

Everything here is called from the gate's one loop; Zenoh's own threads only fill the rings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

import msgspec
import zenoh
from zenoh.handlers import RingChannel

from firmware_py.gate import keys
from firmware_py.gate.features import Features
from firmware_py.records import BRAIN_VERBS, VERBS, Alarm, Block, Event, Record, Severity

RING: Final = 32
"""Queries of one kind that may wait for the loop; older ones are dropped and their askers get no answer."""

COMMAND_ORDER: Final = ("disarm", *(verb for verb in (*VERBS, *BRAIN_VERBS) if verb != "disarm"))
"""Disarm waits behind nothing: it has its own ring, and that ring is looked at first."""

MSGPACK: Final = zenoh.Encoding("application/msgpack")

_to_json = msgspec.json.Encoder().encode
_to_msgpack = msgspec.msgpack.Encoder().encode


class Telemetry:
    """The device's side of Zenoh.

    Parameters
    ----------
    session
        Open session; closed by :meth:`close`.
    prefix
        What every key starts with.

    Notes
    -----
    ``counters``: ``zenoh_failed`` (publications and replies that the session refused).
    """

    def __init__(self, session: zenoh.Session, prefix: str) -> None:
        self.counters: Counter[str] = Counter()
        self._session = session
        self._prefix = prefix
        events = [keys.event(severity) for severity in Severity]
        names = [*keys.PUBLISHED.values(), keys.FEATURES, keys.ALARMS, *events]
        self._publishers = {name: self._publisher(name) for name in names}
        self._commands = {verb: self._queryable(keys.command(verb)) for verb in COMMAND_ORDER}
        self._questions = {name: self._queryable(name)
                           for name in (keys.STATE, keys.CONFIG, keys.MODELS, keys.EVENTS, keys.ALARMS)}
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    def publish(self, record: Record) -> None:
        """Send out ``record`` under its own key, if it has one."""
        if isinstance(record, Event):
            self._put(keys.event(record.severity), _to_json(record))
        elif isinstance(record, Block):
            self._put(keys.PUBLISHED[Block], _to_msgpack(record))
        elif key := keys.PUBLISHED.get(type(record)):
            self._put(key, _to_json(record))

    def publish_features(self, features: Features) -> None:
        """Send out the decimated features."""
        self._put(keys.FEATURES, _to_json(features))

    def publish_alarms(self, alarms: list[Alarm]) -> None:
        """Send out the full list of active alarms."""
        self._put(keys.ALARMS, _to_json(alarms))

    def commands(self) -> Iterator[tuple[str, zenoh.Query]]:
        """Command queries that wait, with their verb."""
        for verb, queryable in self._commands.items():
            while (query := queryable.try_recv()) is not None:
                yield verb, query

    def questions(self) -> Iterator[tuple[str, zenoh.Query]]:
        """Other queries that wait, with the name asked for."""
        for name, queryable in self._questions.items():
            while (query := queryable.try_recv()) is not None:
                yield name, query

    def answer(self, name: str, query: zenoh.Query, value: Any) -> None:
        """Answer ``query`` on ``name`` with ``value`` as JSON, or as msgpack when asked so, and end it."""
        encode, encoding = _to_json, zenoh.Encoding.APPLICATION_JSON
        if query.parameters.get("as") == "msgpack":
            encode, encoding = _to_msgpack, MSGPACK
        try:
            query.reply(f"{self._prefix}/{name}", encode(value), encoding=encoding)
        except zenoh.ZError:
            self.counters["zenoh_failed"] += 1
        query.drop()  # type: ignore[no-untyped-call]

    def set_alive(self, rooms: dict[str, bool]) -> None:
        """Hold a liveliness token for each living room, and for no other."""
        for room, lives in rooms.items():
            if lives and room not in self._tokens:
                self._tokens[room] = self._session.liveliness().declare_token(f"{self._prefix}/{keys.live(room)}")
            elif not lives and room in self._tokens:
                self._tokens.pop(room).undeclare()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Close the session."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _publisher(self, name: str) -> zenoh.Publisher:
        raw = name == keys.PUBLISHED[Block]
        return self._session.declare_publisher(
            f"{self._prefix}/{name}",
            encoding=MSGPACK if raw else zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP)

    def _queryable(self, name: str) -> Any:
        return self._session.declare_queryable(f"{self._prefix}/{name}", RingChannel(RING), complete=True)

    def _put(self, name: str, payload: bytes) -> None:
        try:
            self._publishers[name].put(payload)
        except zenoh.ZError:
            self.counters["zenoh_failed"] += 1
