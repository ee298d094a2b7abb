"""The guard's state: one tree, a field a stage; and the stages that hold it."""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec

from firmware_py.acquire.stage import Acquire, AcquireState
from firmware_py.config import Config
from firmware_py.config.bearings import views
from firmware_py.config.measures import SPEED_HIGH
from firmware_py.guard.alarms.condition import Condition, ConditionState
from firmware_py.guard.alarms.event_limit import EventAllowance, EventLimit
from firmware_py.guard.authority.arming import Arming, ArmingState
from firmware_py.guard.authority.speaker import GuardCodec, Speaker, SpeakerState
from firmware_py.guard.envelope.admissible import Envelope
from firmware_py.guard.envelope.announcements import Announced, Announcements
from firmware_py.guard.envelope.load_estimate import LoadInterval, LoadState
from firmware_py.guard.envelope.target import Target
from firmware_py.guard.envelope.vibration_hold import VibrationHoldState
from firmware_py.guard.plausibility.frame_loss import FrameLoss, FrameLossState
from firmware_py.guard.plausibility.more_readings import MoreReadings
from firmware_py.guard.plausibility.pair import PairCheck
from firmware_py.guard.plausibility.pair_window import PairState
from firmware_py.guard.plausibility.reading_rows import CLEARANCE
from firmware_py.guard.plausibility.reading_state import ReadingsState
from firmware_py.guard.plausibility.readings import Readings
from firmware_py.guard.plausibility.rest import Rest, RestState
from firmware_py.guard.plausibility.speed_check import SpeedCheck, SpeedCheckState
from firmware_py.guard.protection.added import AddedMeasures, AddedState
from firmware_py.guard.protection.bearing import BearingGuard, BearingGuardState
from firmware_py.guard.protection.bypass import Bypasses, BypassesState
from firmware_py.guard.protection.multiply import Multiply, MultiplyState
from firmware_py.guard.protection.oil import OilProtection, OilProtectionState
from firmware_py.guard.protection.permit import Permit, PermitState, Start
from firmware_py.guard.protection.set_points import Ballot, SetPointAlarms
from firmware_py.guard.protection.speed_high import SpeedHigh, SpeedHighState
from firmware_py.guard.protection.vibration import Protection, ProtectionState
from firmware_py.guard.protection.voting import GroupState, Voting
from firmware_py.guard.supervision import Supervision, SupervisionState
from firmware_py.machine.parts import has_reading, monitor_only
from firmware_py.records import Advice, Severity

NEVER_NS: Final = -(1 << 62)


class MemoryState(msgspec.Struct):
    """What the core itself remembers between cycles."""

    target: Target
    load: LoadInterval
    last_ns: int = NEVER_NS
    advice: Advice | None = None
    interval_m: tuple[float, float] | None = None
    shield_due_ns: int = 0
    state_due_ns: int = 0
    state_ns: int = 0
    foreign_command_ns: int = NEVER_NS
    foreign_heartbeat_ns: int = NEVER_NS
    link_up: bool = True
    gate_connected: bool = False
    brain_connected: bool = False
    state_seq: int = 0
    event_seq: int = 0
    cycle_gaps: int = 0
    advices_ahead: int = 0
    node_reasons: list[str] = []
    vibration_high: bool = False
    vibration_um: tuple[float, float] = (0.0, 0.0)
    link_fault: str = ""
    link_fault_ns: int = 0
    models: str = ""
    beside: str = ""


class CoreState(msgspec.Struct):
    """The whole guard (for snapshots)."""

    acquire: AcquireState
    protection: ProtectionState
    arming: ArmingState
    speaker: SpeakerState
    memory: MemoryState
    announced: list[Announced]
    load: LoadState
    permit: PermitState = msgspec.field(default_factory=PermitState)
    unwritable: ConditionState = msgspec.field(default_factory=ConditionState)
    telling: dict[str, EventAllowance] = {}
    readings: ReadingsState | None = None
    oil: OilProtectionState | None = None
    speed_check: SpeedCheckState = msgspec.field(default_factory=SpeedCheckState)
    speed_high: SpeedHighState = msgspec.field(default_factory=SpeedHighState)
    supervision: SupervisionState | None = None
    pair: PairState = msgspec.field(default_factory=PairState)
    vibration: VibrationHoldState = msgspec.field(default_factory=VibrationHoldState)
    frame_loss: FrameLossState = msgspec.field(default_factory=FrameLossState)
    rest: RestState = msgspec.field(default_factory=RestState)
    more: dict[str, ConditionState] = {}
    bearings: dict[str, BearingGuardState] = {}
    groups: dict[str, GroupState] = {}
    added: AddedState = msgspec.field(default_factory=AddedState)
    multiply: dict[str, MultiplyState] = {}
    bypasses: BypassesState = msgspec.field(default_factory=BypassesState)
    models_back: ConditionState = msgspec.field(default_factory=ConditionState)


class Stages:
    """Every stage of the guard, its memory, and the figures of the configuration that the wiring
    needs.

    Parameters
    ----------
    config, codec, session, latched, start, timers
        See :class:`firmware_py.guard.core.GuardCore`.
    """

    def __init__(
        self,
        config: Config,
        codec: GuardCodec,
        session: int,
        latched: list[str] | None = None,
        start: Start | None = None,
        timers: dict[str, int] | None = None,
    ) -> None:
        self.config = config
        self.monitor_only = "; ".join(monitor_only(config.machine))
        self.first, *others = views(config)
        self.session = session
        self.ttl_ns = config.machine.actuator.time_to_live_ms * 1_000_000
        self.fresh_ns = round(config.sampling.fresh_age_ms * 1e6)
        self.speeds = (
            config.machine.operating.speed_min_rpm * pi / 30,
            config.machine.operating.speed_max_rpm * pi / 30,
        )
        self.speeds_rpm = (
            config.machine.operating.speed_min_rpm,
            config.machine.operating.speed_max_rpm,
        )
        self.turning_rad_s = config.limits.min_speed_rpm * pi / 30
        self.acquire = Acquire(config, codec)
        names = latched or []
        self.oil = OilProtection(config, names)
        self.speed_high = SpeedHigh(config, SPEED_HIGH in names)
        self.speed_check, self.rest = SpeedCheck(config), Rest(config.machine)
        self.bearings = [BearingGuard(view, names) for view in others]
        self.voting, self.added = Voting(config, names), AddedMeasures(config, names)
        self.multiply, self.bypasses = Multiply(config), Bypasses(config)
        owned = {SPEED_HIGH, *self.oil.state.alarms, *self.voting.owned}
        owned |= set(self.added.set_points.states)
        owned |= {name for bearing in self.bearings for name in bearing.alarms}
        self.protection = Protection(
            self.first.config, [name for name in names if name not in owned]
        )
        self.readings = Readings(config)
        ran = timers or {}
        for limits in self.set_points:
            limits.resume(ran)
        self.permit = Permit(config.drive, start or Start())
        self.unwritable = Condition("trip_file_unwritable", "trip_file_written")
        self.models_back = Condition("models_rolled_back", "models_acknowledged", Severity.ALERT)
        self.arming = Arming(config)
        self.speaker = Speaker(config, codec, session)
        self.envelope = Envelope(config)
        self.supervision = Supervision(config, session)
        self.pair = PairCheck(config)
        self.frame_loss = FrameLoss(config)
        self.more = MoreReadings(config)
        self.announcements = Announcements(config, self.envelope.shield.lead_s)
        self.telling = EventLimit()
        nothing = LoadInterval(0.0, 0.0, 0.0, False)
        self.memory = MemoryState(
            self.arming.safe, nothing if self.monitor_only else self.envelope.load.declared()
        )

    @property
    def state(self) -> CoreState:
        """The whole guard."""
        return CoreState(
            self.acquire.state,
            self.protection.state,
            self.arming.state,
            self.speaker.state,
            self.memory,
            self.announcements.state,
            self.envelope.load.state,
            self.permit.state,
            self.unwritable.state,
            self.telling.state,
            self.readings.state,
            self.oil.state,
            self.speed_check.state,
            self.speed_high.state,
            self.supervision.state,
            self.pair.state,
            self.envelope.vibration.state,
            self.frame_loss.state,
            self.rest.state,
            self.more.state,
            {bearing.name: bearing.state for bearing in self.bearings},
            self.voting.state,
            self.added.state,
            self.multiply.state,
            self.bypasses.state,
            self.models_back.state,
        )

    @state.setter
    def state(self, state: CoreState) -> None:
        self.acquire.state, self.protection.state = state.acquire, state.protection
        self.arming.state, self.speaker.state, self.memory = (
            state.arming,
            state.speaker,
            state.memory,
        )
        self.announcements.state, self.envelope.load.state = state.announced, state.load
        self.permit.state, self.unwritable.state = state.permit, state.unwritable
        self.telling.state = state.telling
        if state.readings is not None:
            self.readings.restore(state.readings)
        self.oil.state = state.oil or self.oil.state
        self.speed_check.state, self.speed_high.state = state.speed_check, state.speed_high
        if state.supervision is not None:  # a recording of a device that had none
            self.supervision.state = state.supervision
        self.pair.restore(state.pair)
        self.envelope.vibration.state = state.vibration
        self.frame_loss.state, self.rest.state = state.frame_loss, state.rest
        self.more.state, self.models_back.state = state.more, state.models_back
        for bearing in self.bearings:
            if bearing.name in state.bearings:
                bearing.restore(state.bearings[bearing.name])
        self.voting.state, self.added.state = state.groups, state.added
        self.multiply.state, self.bypasses.state = state.multiply, state.bypasses

    @property
    def vibrations(self) -> list[Protection]:
        """The protection of every bearing's channels, the first one's first."""
        return [self.protection, *(bearing.protection for bearing in self.bearings)]

    @property
    def set_points(self) -> list[SetPointAlarms]:
        """The set points of every measure, and their alarms."""
        others = (self.oil.set_points, self.added.set_points)
        return [*(each.set_points for each in self.vibrations), *others]

    @property
    def tripped(self) -> list[str]:
        """Names of latched alarms that trip: of groups, and of measures that trip alone."""
        alone = [name for each in self.vibrations for name in each.tripped]
        alone += self.oil.tripped + self.speed_high.tripped + self.added.set_points.tripped()
        return alone + self.voting.tripped

    @property
    def latched(self) -> list[str]:
        """Names of all latched alarms, whether they trip or vote: kept over a restart."""
        alone = [name for each in self.set_points for name in each.latched()]
        return alone + self.speed_high.tripped + self.voting.tripped

    @property
    def first_out(self) -> str:
        """The alarm that tripped first of those that are latched; of a group with the measure that
        was in danger first."""
        since = {name: a.since_ns for each in self.set_points for name, a in each.states.items()}
        since |= {SPEED_HIGH: self.speed_high.state.since_ns} | self.voting.since_ns
        first = min(self.tripped, key=lambda name: since[name], default="")
        members = [name for name in self.voting.dangers(first) if name in self.latched]
        began = min(members, key=lambda name: since[name], default="")
        return f"{first} ({began})" if began else first

    def ballot(self, measure: str) -> Ballot:
        """What a measure of a group says."""
        stages: list[Protection | AddedMeasures] = [*self.vibrations, self.added]
        for stage in stages:
            if stage.set_points.may_vote(measure):
                return stage.ballot(measure)
        return self.oil.ballot(measure)

    @property
    def measures(self) -> bool:
        """Whether the rig sends a measured clearance."""
        return has_reading(self.config.machine, CLEARANCE)

    def away(self, now_ns: int) -> bool:
        """Whether the guard was not called for longer than a command lives."""
        last_ns = self.memory.last_ns
        return last_ns != NEVER_NS and now_ns - last_ns > self.ttl_ns

    def fresh(self, now_ns: int) -> bool:
        """Whether the newest samples are new enough to act on."""
        return self.acquire.sample_age_ns(now_ns) < self.fresh_ns

    @property
    def turning(self) -> bool:
        """Whether the shaft may turn."""
        return not self.acquire.speed.surely_below(self.turning_rad_s)
