"""The gate's one step: take what the processes say, record it, publish it, answer whoever asks."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Protocol

from firmware_py import __version__
from firmware_py.config import Config
from firmware_py.gate import keys
from firmware_py.gate.answers import Answers
from firmware_py.gate.commands import Answer, CommandDesk
from firmware_py.gate.models_file import ModelsFile
from firmware_py.gate.normal_file import NormalFile
from firmware_py.gate.recorder import Recorder
from firmware_py.gate.station import GroundStation
from firmware_py.gate.telemetry import Telemetry
from firmware_py.gate.view import DeviceState, View
from firmware_py.recording import Recordable, WallClock
from firmware_py.records import (
    Alarm,
    CommandReply,
    CommandRequest,
    Event,
    EventAck,
    ModelsInUse,
    Normal,
    PeerRecord,
)
from firmware_py.routing import Stage, receivers
from firmware_py.wire.peers import PeerClient, PeerServer

SLOW_PERIOD_NS: Final = 1_000_000_000


@dataclass(frozen=True)
class GateParts:
    """The gate's links to the world, opened by the loop."""

    guard: PeerClient
    brain: PeerServer
    telemetry: Telemetry
    recorder: Recorder | None
    normal: NormalFile
    models: ModelsFile


class Counting(Protocol):
    """A part that counts."""

    counters: Counter[str]


class Gate:
    """All that the gate does, one :meth:`step` at a time.

    Parameters
    ----------
    config
        The running configuration.
    doors
        Open links.
    models
        Answer to a query on ``models``.
    unix_ns
        The calendar's time, for the once-a-second pairing.

    Attributes
    ----------
    station
        Link to a ground station, when there is to be one.
    page
        The HTTP page, when there is one: here for its counters.
    """

    def __init__(
        self, config: Config, parts: GateParts, models: Any, unix_ns: Callable[[], int]
    ) -> None:
        self.view = View(config)
        self.desk = CommandDesk(self._send)
        self.station: GroundStation | None = None
        self.page: Counting | None = None
        self.counters: Counter[str] = Counter()
        self._config = config
        self._parts = parts
        self._unix_ns = unix_ns
        self._answers = Answers(
            {keys.CONFIG: config, keys.MODELS: models},
            {keys.STATE: self.state, keys.ALARMS: self._alarms},
            self.view.events,
        )
        self._unacknowledged: deque[tuple[int, int]] = deque()
        self._connections = 0
        self._brains = 0
        self._recorded_in: tuple[str, str] | None = None
        self._next_slow_ns = 0

    def step(self, now_ns: int) -> None:
        """One pass over everything that waits; nothing in it blocks, and commands go first."""
        self._hear_commands(now_ns)
        from_guard = self._parts.guard.poll(now_ns)
        self._forget_after_reconnect()
        for record in from_guard:
            self._take(record, now_ns)
        for _, record in self._parts.brain.poll(now_ns):
            self._take(record, now_ns)
        self._greet_brain()
        self.desk.step(now_ns)
        self._parts.telemetry.queries.questions(
            lambda name, question: self._answers.encode(name, question, now_ns)
        )
        self._acknowledge()
        self._parts.telemetry.set_alive({**self.view.processes(now_ns), "gate": True})
        if self.station:
            self.station.step(
                self.view.guard if self.view.processes(now_ns)["guard"] else None, now_ns
            )
        if now_ns >= self._next_slow_ns:
            self._next_slow_ns = now_ns + SLOW_PERIOD_NS
            self._slow_step(now_ns)

    def ask(self, verb: str, value: object, origin: str, answer: Answer, now_ns: int) -> None:
        """Put a request to its process, on the record; ``answer`` is called once, now or later."""
        self._on_record(self.desk.ask(verb, value, origin, answer, now_ns), now_ns)

    def _on_record(self, request: CommandRequest | None, now_ns: int) -> None:
        if request is not None:
            self._record(request, now_ns)

    def state(self, now_ns: int) -> DeviceState:
        """The whole device at one instant."""
        device, view, recorder = self._config.device, self.view, self._parts.recorder
        return DeviceState(
            site=device.site,
            rig=device.rig,
            instance=device.instance,
            version=__version__,
            now_ns=now_ns,
            unix_ns=self._unix_ns(),
            rooms={**view.processes(now_ns), "gate": True},
            guard=view.guard,
            reading=view.reading,
            diagnosis=view.diagnosis,
            shadow=view.shadow,
            forecast=view.forecast,
            advice=view.advice,
            brain=view.brain,
            commission=view.commission,
            normal=self._parts.normal.words(),
            models=view.models,
            compared=self._parts.models.compared(),
            alarms=self._alarms(now_ns),
            recording=str(recorder.path or "") if recorder else "",
            counters=self.all_counters(),
        )

    def all_counters(self) -> dict[str, int]:
        """Every count of the gate, by name."""
        parts = self._parts
        total = Counter(self.counters)
        for part in (
            self.view,
            self.desk,
            parts.telemetry,
            parts.guard,
            parts.brain,
            parts.recorder,
            self.station,
            self.page,
        ):
            if part is not None:
                total.update(part.counters)
        return dict(total)

    @property
    def _troubles(self) -> dict[str, str]:
        """What is wrong at the gate itself, by name; empty texts are no trouble."""
        recorder = self._parts.recorder
        return {
            "recorder": recorder.trouble if recorder else "",
            "normal_file": self._parts.normal.trouble,
            "models_file": self._parts.models.trouble,
        }

    def _alarms(self, now_ns: int) -> list[Alarm]:
        return self.view.alarms(now_ns, self._troubles)

    def _send(self, record: CommandRequest | EventAck | Normal) -> bool:
        """Hand ``record`` to the stage that it goes to; False when that is impossible now."""
        (stage,) = receivers(Stage.GATE, record)
        if stage is Stage.BRAIN:
            return self._parts.brain.send(stage, record)
        return self._parts.guard.send(record)

    def _greet_brain(self) -> None:
        """A brain that has just come knows nothing of this machine: tell it what is stored."""
        connections = self._parts.brain.counters["connected_brain"]
        if connections != self._brains:
            self._brains = connections
            if self._parts.normal.normal:
                self._send(self._parts.normal.normal)

    def _take(self, record: PeerRecord, now_ns: int) -> None:
        features = self.view.features
        if isinstance(record, ModelsInUse):
            self._keep_models(record)
        self.view.step(record, now_ns)
        ticket = self._record(record, now_ns)
        self._parts.telemetry.publish(record)
        if isinstance(record, Event) and (ticket or self._parts.recorder is None):
            self._unacknowledged.append((ticket, record.seq))
        if isinstance(record, Event) and self.station:
            self.station.tell(record)
        elif isinstance(record, CommandReply):
            self._hand_on(record)
        elif isinstance(record, Normal):
            self._parts.normal.keep(record)
        elif self.view.features is not features and self.view.features:
            self._parts.telemetry.publish_features(self.view.features)

    def _keep_models(self, said: ModelsInUse) -> None:
        """Write down what the brain uses; sets that have just come know nothing of this machine."""
        before = self.view.models
        self._parts.models.take(said)
        changed = before is None or (said.active, said.beside) != (before.active, before.beside)
        if changed and self._parts.normal.normal:
            self._send(self._parts.normal.normal)

    def _hand_on(self, reply: CommandReply) -> None:
        """Give a process's answer to whoever asked; what the brain has forgotten goes from the disk
        as well."""
        request = self.desk.reply(reply)
        if request is not None and request.action == "forget" and reply.accepted:
            self._parts.normal.forget()

    def _record(self, record: Recordable, now_ns: int) -> int:
        """Give ``record`` to the recorder; its ticket, 0 when it is not kept."""
        return self._parts.recorder.write(record, now_ns) if self._parts.recorder else 0

    def _forget_after_reconnect(self) -> None:
        """Another guard, or the same one that will send again: old event numbers mean nothing to
        it."""
        if self._parts.guard.counters["connected"] != self._connections:
            self._connections = self._parts.guard.counters["connected"]
            self._unacknowledged.clear()

    def _acknowledge(self) -> None:
        """Tell the guard which events are on disk; without a recorder, which ones were heard."""
        stored = self._parts.recorder.stored if self._parts.recorder else 0
        last = None
        while self._unacknowledged and self._unacknowledged[0][0] <= stored:
            last = self._unacknowledged.popleft()[1]
        if last is not None:
            self._send(EventAck(seq=last))

    def _hear_commands(self, now_ns: int) -> None:
        queries = self._parts.telemetry.queries
        for asked in queries.commands():
            answer = partial(queries.answer_command, asked.verb, asked.question)
            self._on_record(
                self.desk.hear(asked.verb, asked.payload, "zenoh", answer, now_ns), now_ns
            )

    def _slow_step(self, now_ns: int) -> None:
        """Once a second: the alarm list, the pairing with the calendar, the normal state in each
        new recording."""
        self._parts.telemetry.look()
        guard = self.view.guard
        self.view.losses.step(self.all_counters() | (guard.counters if guard else {}), now_ns)
        self._parts.telemetry.publish_alarms(self._alarms(now_ns))
        self._record(WallClock(t_ns=now_ns, unix_ns=self._unix_ns()), now_ns)
        recorder, normal = self._parts.recorder, self._parts.normal.normal
        place = (str(recorder.path), str(normal.made_unix_ns)) if recorder and normal else None
        if normal and place != self._recorded_in:
            self._recorded_in = place
            self._record(normal, now_ns)
