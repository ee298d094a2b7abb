"""Telemetry on Zenoh: publications that never block, and what lives."""

from __future__ import annotations

from collections import Counter

import zenoh

from firmware_py.gate import keys
from firmware_py.gate.features import SignalFeatures
from firmware_py.gate.queries import MSGPACK, Queries, to_json, to_msgpack
from firmware_py.gate.session import SessionError, SocketWatch
from firmware_py.records import Alarm, Block, Event, Record, Severity


class Telemetry:
    """The device's side of Zenoh.

    Parameters
    ----------
    session
        Open session; closed by :meth:`close`.
    prefix
        What every key starts with.
    door
        Watches the local socket, when there is one to watch.

    Notes
    -----
    ``counters``: ``zenoh_failed`` (publications and replies that a session refused),
    ``zenoh_listened_again``, and those of :class:`~firmware_py.gate.queries.Queries`.
    """

    def __init__(
        self, session: zenoh.Session, prefix: str, watch: SocketWatch | None = None
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._sessions = [session]
        self._prefix = prefix
        self._watch = watch
        events = [keys.event(severity) for severity in Severity]
        self._names = [*keys.PUBLISHED.values(), keys.FEATURES, keys.ALARMS, *events]
        self._publishers = {name: [self._publisher(session, name)] for name in self._names}
        self.queries = Queries(session, prefix, self.counters)
        self._tokens: dict[str, list[zenoh.LivelinessToken]] = {}

    def publish(self, record: Record) -> None:
        """Send out ``record`` under its own key, if it has one."""
        if isinstance(record, Event):
            self._put(keys.event(record.severity), to_json(record))
        elif isinstance(record, Block):
            self._put(keys.PUBLISHED[Block], to_msgpack(record))
        elif key := keys.PUBLISHED.get(type(record)):
            self._put(key, to_json(record))

    def publish_features(self, features: SignalFeatures) -> None:
        """Send out the decimated features."""
        self._put(keys.FEATURES, to_json(features))

    def publish_alarms(self, alarms: list[Alarm]) -> None:
        """Send out the full list of active alarms."""
        self._put(keys.ALARMS, to_json(alarms))

    def look(self) -> None:
        """Listen again when somebody removed the local socket; who is connected keeps the session
        that he has."""
        if self._watch is None or not self._watch.lost():
            return
        try:
            session = self._watch.open_again()
        except SessionError:
            self.counters["zenoh_failed"] += 1
            return
        self._sessions.append(session)
        for name in self._names:
            self._publishers[name].append(self._publisher(session, name))
        for process, tokens in self._tokens.items():
            tokens.append(
                session.liveliness().declare_token(f"{self._prefix}/{keys.live(process)}")
            )
        self.queries.serve(session)
        self.counters["zenoh_listened_again"] += 1

    def set_alive(self, rooms: dict[str, bool]) -> None:
        """Hold a liveliness token for each living process, and for no other."""
        for process, lives in rooms.items():
            if lives and process not in self._tokens:
                self._tokens[process] = [
                    session.liveliness().declare_token(f"{self._prefix}/{keys.live(process)}")
                    for session in self._sessions
                ]
            elif not lives and process in self._tokens:
                for token in self._tokens.pop(process):
                    token.undeclare()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Say what waits and close every session."""
        self.queries.close()
        for session in self._sessions:
            session.close()  # type: ignore[no-untyped-call]

    def _publisher(self, session: zenoh.Session, name: str) -> zenoh.Publisher:
        raw = name == keys.PUBLISHED[Block]
        return session.declare_publisher(
            f"{self._prefix}/{name}",
            encoding=MSGPACK if raw else zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def _put(self, name: str, payload: bytes) -> None:
        for publisher in self._publishers[name]:
            try:
                publisher.put(payload)
            except zenoh.ZError:
                self.counters["zenoh_failed"] += 1
