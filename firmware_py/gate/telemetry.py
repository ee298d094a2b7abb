"""Telemetry on Zenoh: publications that never block, and what lives."""

from __future__ import annotations

from collections import Counter

import zenoh

from firmware_py.gate import keys
from firmware_py.gate.features import Features
from firmware_py.gate.queries import MSGPACK, Queries, to_json, to_msgpack
from firmware_py.records import Alarm, Block, Event, Record, Severity


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
    ``counters``: ``zenoh_failed`` (publications and replies that the session refused), and those of
    :class:`~firmware_py.gate.queries.Queries`.
    """

    def __init__(self, session: zenoh.Session, prefix: str) -> None:
        self.counters: Counter[str] = Counter()
        self._session = session
        self._prefix = prefix
        events = [keys.event(severity) for severity in Severity]
        names = [*keys.PUBLISHED.values(), keys.FEATURES, keys.ALARMS, *events]
        self._publishers = {name: self._publisher(name) for name in names}
        self.queries = Queries(session, prefix, self.counters)
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    def publish(self, record: Record) -> None:
        """Send out ``record`` under its own key, if it has one."""
        if isinstance(record, Event):
            self._put(keys.event(record.severity), to_json(record))
        elif isinstance(record, Block):
            self._put(keys.PUBLISHED[Block], to_msgpack(record))
        elif key := keys.PUBLISHED.get(type(record)):
            self._put(key, to_json(record))

    def publish_features(self, features: Features) -> None:
        """Send out the decimated features."""
        self._put(keys.FEATURES, to_json(features))

    def publish_alarms(self, alarms: list[Alarm]) -> None:
        """Send out the full list of active alarms."""
        self._put(keys.ALARMS, to_json(alarms))

    def set_alive(self, rooms: dict[str, bool]) -> None:
        """Hold a liveliness token for each living room, and for no other."""
        for room, lives in rooms.items():
            if lives and room not in self._tokens:
                self._tokens[room] = self._session.liveliness().declare_token(f"{self._prefix}/{keys.live(room)}")
            elif not lives and room in self._tokens:
                self._tokens.pop(room).undeclare()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Say what waits and close the session."""
        self.queries.close()
        self._session.close()  # type: ignore[no-untyped-call]

    def _publisher(self, name: str) -> zenoh.Publisher:
        raw = name == keys.PUBLISHED[Block]
        return self._session.declare_publisher(
            f"{self._prefix}/{name}",
            encoding=MSGPACK if raw else zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP)

    def _put(self, name: str, payload: bytes) -> None:
        try:
            self._publishers[name].put(payload)
        except zenoh.ZError:
            self.counters["zenoh_failed"] += 1
