"""What the gate knows now: the latest record of each kind, the alarms, the events of late.

Telemetry, queries, metrics and the page all read this one view; only the gate's loop writes it.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.gate.features import Decimator, SignalFeatures
from firmware_py.gate.instances import Instances
from firmware_py.gate.losses import Losses
from firmware_py.records import (
    Advice,
    Alarm,
    Block,
    BrainState,
    CommissionState,
    Diagnosis,
    Event,
    Forecast,
    GuardState,
    ModelsInUse,
    PeerRecord,
    RigReading,
    Severity,
    ShadowDiagnosis,
)

EVENTS_KEPT: Final = 1000
SAME_WITHIN_NS: Final = 60_000_000_000
LOOKED_BACK: Final = 8
"""An event that says the same as one of so many before it, within so long, is one event with a
count."""

SILENT_AFTER_NS: Final = 1_000_000_000
"""A process whose heartbeat (guard: ``GuardState``, brain: ``Advice``, both 10 Hz) is older is not
alive."""


class DeviceState(msgspec.Struct, frozen=True, kw_only=True):
    """Answer to a query on ``state``: the whole device at one instant.

    ``normal`` says when the stored normal state of the machine was learned, or what is wrong with
    its file.
    """

    site: str
    rig: str
    instance: str
    version: str
    now_ns: int
    unix_ns: int
    rooms: dict[str, bool]
    guard: GuardState | None
    reading: RigReading | None
    diagnosis: Diagnosis | None
    forecast: Forecast | None
    advice: Advice | None
    brain: BrainState | None
    commission: CommissionState | None
    normal: str
    alarms: list[Alarm]
    recording: str
    counters: dict[str, int]
    shadow: ShadowDiagnosis | None = None
    models: ModelsInUse | None = None
    compared: dict[str, float] = {}
    """All that was counted of the sets at work, over every run of the brain."""


class View:
    """The latest of everything.

    Parameters
    ----------
    config
        For the decimated features.
    """

    def __init__(self, config: Config) -> None:
        self.guard: GuardState | None = None
        self.reading: RigReading | None = None
        self.diagnosis: Diagnosis | None = None
        self.shadow: ShadowDiagnosis | None = None
        self.forecast: Forecast | None = None
        self.advice: Advice | None = None
        self.brain: BrainState | None = None
        self.commission: CommissionState | None = None
        self.models: ModelsInUse | None = None
        self.features: SignalFeatures | None = None
        self.decimator = Decimator(config)
        self.instances = Instances(config)
        self.counters: Counter[str] = Counter()
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._heard_ns: dict[str, int] = {}
        self._since_ns: dict[str, int] = {}
        self.losses = Losses()

    def step(self, record: PeerRecord, now_ns: int) -> None:
        """Take in ``record``."""
        self.counters[f"in_{type(record).__name__}"] += 1
        match record:
            case Block():
                self.features = self.decimator.step(record) or self.features
            case GuardState():
                self.guard, self._heard_ns["guard"] = record, now_ns
            case Advice():
                self.advice, self._heard_ns["brain"] = record, now_ns
            case BrainState():
                self.brain = record
            case CommissionState():
                self.commission = record
            case ModelsInUse():
                self.models = record
            case RigReading():
                self.reading = record
            case Diagnosis():
                self.diagnosis = record
            case ShadowDiagnosis():
                self.shadow = record
            case Forecast():
                self.forecast = record
            case Event():
                self._keep(record)

    def _keep(self, event: Event) -> None:
        """Keep ``event``; one that says the same as the newest of its name shortly before takes its
        place, counted."""
        for place in range(len(self._events) - 1, max(-1, len(self._events) - 1 - LOOKED_BACK), -1):
            old = self._events[place]
            if (
                (old.name, old.text, old.severity) == (event.name, event.text, event.severity)
                and 0 <= event.t_ns - old.t_ns < SAME_WITHIN_NS
                and event.name != "command"
            ):
                del self._events[place]
                event = msgspec.structs.replace(event, count=event.count + old.count)
                break
        self._events.append(event)

    def processes(self, now_ns: int) -> dict[str, bool]:
        """Which processes are alive by their heartbeat."""
        heard = self._heard_ns
        return {
            process: process in heard and now_ns - heard[process] < SILENT_AFTER_NS
            for process in ("guard", "brain")
        }

    def events(self, since: int = -1) -> list[Event]:
        """Kept events with a sequence number above ``since``, oldest first."""
        return [event for event in self._events if event.seq > since]

    def alarms(self, now_ns: int, troubles: Mapping[str, str] | None = None) -> list[Alarm]:
        """Every active alarm: the guard's while it lives, silent processes, and the gate's own
        ``troubles`` (text by name).

        A normal state that the brain refuses to use is one: the machine is not judged as its owner
        thinks.
        """
        alive = self.processes(now_ns)
        standing = {
            f"{process}_silent": (
                Severity.FAULT,
                f"the {process} does not answer; see its log, or `orbitd run`",
            )
            for process, lives in alive.items()
            if not lives
        }
        standing |= {
            name: (Severity.ALERT, text) for name, text in (troubles or {}).items() if text
        }
        if alive["brain"] and self.commission is not None and self.commission.phase == "refused":
            standing["normal_refused"] = (Severity.ALERT, self.commission.text)
        self._since_ns = {name: self._since_ns.get(name, now_ns) for name in standing}
        own = [
            Alarm(name, severity, self._since_ns[name], 0.0, 0.0, False, text)
            for name, (severity, text) in standing.items()
        ]
        return (
            own
            + (self.guard.alarms if self.guard and alive["guard"] else [])
            + self.losses.standing()
        )
