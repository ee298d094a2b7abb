"""The guard as one pure stage: a cycle in, a decision out; the same bits on every machine."""

from __future__ import annotations

from math import pi
from typing import Final

import msgspec

from firmware_py.acquire.stage import Acquire, AcquireOutput, AcquireState
from firmware_py.config import Config
from firmware_py.guard.alarm import Notice
from firmware_py.guard.announcements import Announced, Announcements
from firmware_py.guard.arming import Arming, ArmingState
from firmware_py.guard.authority import is_ahead
from firmware_py.guard.condition import Condition, ConditionState
from firmware_py.guard.failsafe import Situation, node_reasons
from firmware_py.guard.frame_loss import FrameLoss, FrameLossState
from firmware_py.guard.load_estimate import LoadEstimator, LoadInterval, LoadState, Look
from firmware_py.guard.more_readings import MoreReadings
from firmware_py.guard.oil_protection import OilProtection, OilProtectionState
from firmware_py.guard.pair import NO_FACTS, PairCheck, PairState
from firmware_py.guard.permit import Permit, PermitFacts, PermitState, Start
from firmware_py.guard.protection import Protection, ProtectionState, zone
from firmware_py.guard.readings import CLEARANCE, OIL, PRESSURE, Readings, ReadingsState
from firmware_py.guard.rest import Rest, RestState
from firmware_py.guard.shield import PERIOD_S, Shield
from firmware_py.guard.speaker import Codec, Speaker, SpeakerState
from firmware_py.guard.speed_check import SpeedCheck, SpeedCheckState
from firmware_py.guard.speed_high import NAME as SPEED_HIGH
from firmware_py.guard.speed_high import SpeedHigh, SpeedHighState
from firmware_py.guard.supervision import Heard, Measured, Supervision, SupervisionState
from firmware_py.guard.target import Target
from firmware_py.guard.telling import Telling, Told
from firmware_py.guard.vibration_hold import VibrationHold, VibrationHoldState
from firmware_py.records import (
    Advice,
    Alarm,
    ArmState,
    Block,
    Command,
    CommandReply,
    CommandRequest,
    Cycle,
    Decision,
    Event,
    GuardState,
    Mode,
    NodeMode,
    RawFrame,
    Severity,
    Snapshot,
)

SHIELD_PERIOD_NS: Final = round(PERIOD_S * 1e9)
STATE_PERIOD_NS: Final = 100_000_000
STATE_GAP_NS: Final = 20_000_000
"""A request brings the next state forward, to so long after the one before."""

NODE_SILENT_NS: Final = 500_000_000
FOREIGN_HOLD_NS: Final = 5_000_000_000
"""How long another device counts as present after it was last heard."""

UNKNOWN_VIBRATION: Final = 1.01
"""A vibration that is not known counts as this many times what may fill the clearance: the bearing
narrows to safe."""

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
    telling: dict[str, Told] = {}
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


class GuardCore:
    """Acquisition, protection, shield and arming, one cycle at a time.

    Parameters
    ----------
    config
        The whole configuration (its safe value checked by
        :func:`firmware_py.guard.shield.check_safe`).
    codec
        Codec of the configured link.
    session
        Nonce of this run, in every frame that the guard sends.
    latched
        Danger alarms that stood latched when the guard last ended.
    start, timers
        How this run began, and how long danger limits had been exceeded when the last one ended,
        ns.
    """

    def __init__(
        self,
        config: Config,
        codec: Codec,
        session: int,
        latched: list[str] | None = None,
        start: Start | None = None,
        timers: dict[str, int] | None = None,
    ) -> None:
        self._config = config
        self._session = session
        self._ttl_ns = config.machine.actuator.time_to_live_ms * 1_000_000
        self._fresh_ns = round(config.sampling.fresh_age_ms * 1e6)
        self._speeds = (
            config.machine.operating.speed_min_rpm * pi / 30,
            config.machine.operating.speed_max_rpm * pi / 30,
        )
        self._speeds_rpm = (
            config.machine.operating.speed_min_rpm,
            config.machine.operating.speed_max_rpm,
        )
        self._turning_rad_s = config.limits.min_speed_rpm * pi / 30
        self._acquire = Acquire(config, codec)
        names = latched or []
        self._oil = OilProtection(config, names)
        self._speed_high = SpeedHigh(config, SPEED_HIGH in names)
        self._speed_check, self._rest = SpeedCheck(config), Rest()
        self._protection = Protection(
            config,
            [name for name in names if name != SPEED_HIGH and name not in self._oil.state.alarms],
        )
        self._readings = Readings(config)
        for stage in (self._protection, self._oil):
            stage.resume(timers or {})
        self._permit = Permit(config.drive, start or Start())
        self._unwritable = Condition("trip_file_unwritable", "trip_file_written")
        self._arming = Arming(config)
        self._speaker = Speaker(config, codec, session)
        self._shield = Shield(config)
        self._supervision = Supervision(config, session)
        self._load = LoadEstimator(config)
        self._pair, self._vibration = PairCheck(config), VibrationHold()
        self._frame_loss = FrameLoss(config)
        self._more = MoreReadings(config)
        self._announcements = Announcements(config, self._shield.lead_s)
        self._telling = Telling()
        self._memory = MemoryState(self._arming.safe, self._load.declared())

    # ------------------------------------------------------------------ the cycle

    def step(self, cycle: Cycle) -> Decision:
        """Read, protect, obey, decide, speak."""
        now_ns, m = cycle.now_ns, self._memory
        gap = m.last_ns != NEVER_NS and now_ns - m.last_ns > self._ttl_ns
        notices = self._connections(cycle)
        if gap:
            self._discard()
        acquired = self._acquire.step(cycle.frames, now_ns)
        if acquired.node_ahead_ns or acquired.clock_jumped or acquired.restarted:
            gap = True
            self._discard()
            notices.append(_clock_notice(acquired))
        notices += self._strangers(acquired, now_ns)
        notices += self._frame_loss.step(self._acquire.counters["frames_lost"], now_ns)
        if acquired.restarted or acquired.node_info is not None or acquired.figures is not None:
            a = self._acquire
            m.node_reasons = node_reasons(self._config, a.node_info, a.figures)
        notices += self._slow(acquired, now_ns)
        notices += self._more.step(acquired.readings, now_ns)
        notices += self._supervise(acquired, now_ns)
        if acquired.blocks:
            cap_um = self._readings.smaller_clearance_um(self._acquire.node)
            notices += self._protection.step(acquired.blocks, cap_um)
        notices += self._judge_speed(acquired, now_ns)
        notices += self._judge_pair(acquired.blocks)
        if cycle.advice is not None:
            m.advice = cycle.advice
            m.advices_ahead += is_ahead(cycle.advice, now_ns)
        if now_ns >= m.shield_due_ns or self._command_due(cycle):
            self._look_around(now_ns)
        situation = self._situation(cycle, gap)
        replies = self._obey(cycle.commands, situation, notices)
        before = (self._arming.state.arm_state, self._arming.state.mode)
        m.target, told = self._arming.step(situation, m.advice)
        notices += told
        permit = self._judge_permit(situation, bool(acquired.blocks))
        notices += self._permit.begin(self._protection.tripped) if m.last_ns == NEVER_NS else []
        notices += permit + self._unwritable.step(
            bool(cycle.memory_fault), cycle.memory_fault, now_ns
        )
        if (self._arming.state.arm_state, self._arming.state.mode) != before or replies or permit:
            self._speaker.hurry(
                urgent=not replies or self._arming.state.arm_state == ArmState.TRIPPED
            )
        m.last_ns = now_ns
        events = [
            self._event(notice, count, now_ns)
            for notice, count in self._telling.step(notices, now_ns)
        ]
        if replies:
            m.state_due_ns = min(m.state_due_ns, m.state_ns + STATE_GAP_NS)
        state = self._state(now_ns) if now_ns >= m.state_due_ns else None
        return Decision(
            cycle.seq,
            self._speak(situation),
            acquired.blocks,
            acquired.readings,
            events,
            replies,
            state,
        )

    def snapshot(self, seq: int, now_ns: int) -> Snapshot:
        """The whole state before cycle ``seq``."""
        state = CoreState(
            self._acquire.state,
            self._protection.state,
            self._arming.state,
            self._speaker.state,
            self._memory,
            self._announcements.state,
            self._load.state,
            self._permit.state,
            self._unwritable.state,
            self._telling.state,
            self._readings.state,
            self._oil.state,
            self._speed_check.state,
            self._speed_high.state,
            self._supervision.state,
            self._pair.state,
            self._vibration.state,
            self._frame_loss.state,
            self._rest.state,
            self._more.state,
        )
        return Snapshot(seq, now_ns, msgspec.msgpack.encode(state))

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from ``snapshot`` (of a guard with the same configuration)."""
        state = msgspec.msgpack.decode(snapshot.state, type=CoreState)
        self._acquire.state, self._protection.state = state.acquire, state.protection
        self._arming.state, self._speaker.state, self._memory = (
            state.arming,
            state.speaker,
            state.memory,
        )
        self._announcements.state, self._load.state = state.announced, state.load
        self._permit.state, self._unwritable.state = state.permit, state.unwritable
        self._telling.state = state.telling
        if state.readings is not None:
            self._readings.restore(state.readings)
        self._oil.state = state.oil or self._oil.state
        self._speed_check.state, self._speed_high.state = state.speed_check, state.speed_high
        if state.supervision is not None:  # a recording of a device that had none
            self._supervision.state = state.supervision
        self._pair.restore(state.pair)
        self._vibration.state = state.vibration
        self._frame_loss.state, self._rest.state = state.frame_loss, state.rest
        self._more.state = state.more

    @property
    def tripped(self) -> list[str]:
        """Names of latched danger alarms: what the loop keeps over a restart."""
        return self._protection.tripped + self._oil.tripped + self._speed_high.tripped

    @property
    def timers(self) -> dict[str, int]:
        """How long each danger limit has been exceeded whose delay is not over, ns: kept over a
        restart as well."""
        return self._protection.timers() | self._oil.timers()

    @property
    def barred(self) -> bool:
        """Whether a second restart has withdrawn the permit and nobody has looked since."""
        return self._permit.state.barred

    @property
    def probation(self) -> bool:
        """Whether this run began as a restart, nobody has looked since, and 10 min are not over."""
        return self._permit.state.probation

    @property
    def counters(self) -> dict[str, int]:
        """What came in and what was lost or refused, by name."""
        return dict(
            self._acquire.counters,
            cycle_gaps=self._memory.cycle_gaps,
            advices_ahead=self._memory.advices_ahead,
            speed_doubts=self._speed_check.state.doubts,
            hard_stops=self._rest.state.hard_stops,
        )

    # ------------------------------------------------------------------ what changed around the guard

    def _connections(self, cycle: Cycle) -> list[Notice]:
        """Rooms and link that came or went."""
        m = self._memory
        notices = self._link_health(cycle)
        now = (cycle.link_up, cycle.gate_connected, cycle.brain_connected)
        if (m.link_up, m.gate_connected, m.brain_connected) == now:
            return notices
        for name, before, after in (
            ("link", m.link_up, cycle.link_up),
            ("gate", m.gate_connected, cycle.gate_connected),
            ("brain", m.brain_connected, cycle.brain_connected),
        ):
            if after and not before:
                notices.append(Notice(Severity.INFO, f"{name}_back", f"{name} connected"))
            elif before and not after:
                notices.append(Notice(Severity.ALERT, f"{name}_lost", _gone(name, cycle)))
        if cycle.link_up and not m.link_up:
            self._acquire.reset_clock()
        if not cycle.brain_connected:
            m.advice = None
        m.link_up, m.gate_connected, m.brain_connected = now
        return notices

    def _link_health(self, cycle: Cycle) -> list[Notice]:
        """What the link says is wrong with it (bus-off, queue full, no such port), when that
        changes."""
        m, fault = self._memory, cycle.link_fault
        if fault == m.link_fault:
            return []
        if not m.link_fault:
            m.link_fault_ns = cycle.now_ns
        m.link_fault = fault
        if fault:
            return [Notice(Severity.FAULT, "link_fault", fault)]
        lasted_s = (cycle.now_ns - m.link_fault_ns) * 1e-9
        return [
            Notice(Severity.INFO, "link_well", f"the link is well again, after {lasted_s:.1f} s")
        ]

    def _discard(self) -> None:
        """Guard or host was away for longer than the time to live: nothing that was computed is
        valid.

        The clocks may have moved apart in that time, so they are compared anew.
        """
        m = self._memory
        m.cycle_gaps += 1
        self._acquire.reset_clock()
        m.advice, m.interval_m, m.target = None, None, self._arming.safe
        m.shield_due_ns = 0

    def _strangers(self, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
        """Frames that only a device sends, but that this one did not."""
        m = self._memory
        notices = []
        for message in acquired.foreign:
            own = message.session == self._session
            if own:
                self._acquire.counters["reject_masquerade"] += 1
            if now_ns - max(m.foreign_command_ns, m.foreign_heartbeat_ns) > FOREIGN_HOLD_NS:
                notices.append(
                    Notice(
                        Severity.FAULT,
                        "masquerade" if own else "foreign_device",
                        (
                            f"a frame of session {message.session:#010x} that this device did not "
                            f"send; "
                            "disconnect the other sender"
                        ),
                    )
                )
            if own or isinstance(message, Command):
                m.foreign_command_ns = now_ns
            else:
                m.foreign_heartbeat_ns = now_ns
        return notices

    def _judge_speed(self, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
        """Too fast, or as no shaft turns: then the speed is unknown at once; standing, or not."""
        speed = self._acquire.speed
        notices = self._rest.step(speed)
        if acquired.blocks:
            p = self._protection
            seen = self._rest.look(p.motion, p.displacement_ok, speed, now_ns)
            self._acquire.hear_motion(seen.quiet_s, seen.moving_s)
        notices += self._speed_high.step(acquired.turns, now_ns, speed.lost)
        notices += self._speed_check.step(acquired.turns, acquired.blocks, speed, now_ns)
        self._acquire.doubt_speed(self._speed_check.doubted)
        if not speed.known:
            self._memory.interval_m = None
        return notices

    def _supervise(self, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
        """Hold what node and actuator report against what they were told."""
        a = self._acquire
        fresh = a.sample_age_ns(now_ns) < self._fresh_ns
        measured = Measured(self._readings.value(CLEARANCE), self._readings.value(PRESSURE))
        resting = a.speed.surely_below(self._turning_rad_s) and not self._arming.state.commanding
        return self._supervision.step(
            Heard(
                acquired.node_states,
                measured if acquired.readings else None,
                acquired.restarted,
                a.node,
                a.node_info,
                a.newest_tick_us if fresh else None,
                a.two_senders(now_ns),
                resting,
            ),
            now_ns,
        )

    # ------------------------------------------------------------------ facts

    def _slow(self, acquired: AcquireOutput, now_ns: int) -> list[Notice]:
        """Judge the slow readings, and by them the oil."""
        a, readings = self._acquire, self._readings
        notices = readings.step(
            acquired.blocks, a.status, a.status_heard_ns, a.node, a.speed.reading_rad_s, now_ns
        )
        turning = not a.speed.surely_below(self._turning_rad_s)
        return notices + self._oil.step(
            readings.pressure(now_ns), readings.outlet(now_ns), turning, now_ns
        )

    def _look_around(self, now_ns: int) -> None:
        """Estimate the load and ask the shield: every :data:`PERIOD_S`, and anew for each command
        that is sent.

        While the mark stays away, the shaft may have any speed between the one told and the last
        reading.
        """
        m, readings, known = self._memory, self._readings, self._readings.known()
        m.shield_due_ns = now_ns + SHIELD_PERIOD_NS
        motion, speed = self._protection.motion, self._acquire.speed
        p2p_m = max(motion.peak_to_peak_um) * 1e-6
        smaller_um = readings.smaller_clearance_um(self._acquire.node)
        m.vibration_um = (p2p_m * 1e6, self._protection.set_points_um(smaller_um)[1])
        m.vibration_high = m.vibration_um[0] > m.vibration_um[1]
        displacement_ok = self._protection.displacement_ok and self._pair.plausible
        if (
            not displacement_ok
        ):  # a vibration that is not known may be the largest that is admissible, and more
            share = self._config.limits.clearance_share
            p2p_m = max(p2p_m, UNKNOWN_VIBRATION * share * readings.narrowest_um(smaller_um) * 1e-6)
        if known is None or not motion.complete or not speed.known or not displacement_ok:
            m.load = self._load.declared()
        else:
            m.load = self._load.estimate(
                Look(
                    now_ns * 1e-9,
                    motion.mean_x_m,
                    motion.mean_y_m,
                    p2p_m,
                    known.clearance_um * 1e-6,
                    speed.reading_rad_s,
                    known.oil_C,
                    known.power_W,
                    known.pressure_bar,
                )
            )
        oil_C, oil = self._load.oil_at(readings.value(OIL))
        narrow_m = readings.narrowest_um(smaller_um) * 1e-6
        if speed.known and motion.complete and displacement_ok:
            p2p_m = self._vibration.step(p2p_m, narrow_m, speed.reading_rad_s, now_ns)
        m.interval_m = (
            None
            if not speed.known
            else self._shield.interval(
                speed.reading_rad_s,
                m.load.low_N,
                m.load.film_N,
                oil_C,
                p2p_m,
                narrow_m,
                self._announcements.ahead(now_ns),
                oil,
                speed.speed_rad_s,
            )
        )

    def _judge_pair(self, blocks: list[Block]) -> list[Notice]:
        """Whether the two displacements tell of one shaft, with the slow readings of now."""
        known, notices = self._readings.known(), list[Notice]()
        facts = self._pair.facts(known.clearance_um * 1e-6, known.oil_C) if known else NO_FACTS
        for block in blocks:
            p2p_m = max(self._protection.motion.peak_to_peak_um) * 1e-6
            notices += self._pair.step(block, facts, p2p_m)
        return notices

    def _situation(self, cycle: Cycle, gap: bool) -> Situation:
        m, a, now_ns = self._memory, self._acquire, cycle.now_ns
        speed = a.speed
        return Situation(
            now_ns=now_ns,
            link_up=cycle.link_up,
            samples_fresh=a.sample_age_ns(now_ns) < self._fresh_ns,
            clock_settled=a.clock_settled,
            node_heard=a.node_age_ns(now_ns) < NODE_SILENT_NS and a.node_info is not None,
            node_reasons=m.node_reasons,
            foreign_command=now_ns - m.foreign_command_ns < FOREIGN_HOLD_NS,
            foreign_heartbeat=now_ns - m.foreign_heartbeat_ns < FOREIGN_HOLD_NS,
            cycle_gap=gap,
            mark_lost=not speed.known,
            displacement_ok=self._protection.displacement_ok,
            vibration_high=m.vibration_high,
            pair_ok=self._pair.plausible,
            speed_declared=self._speeds[0] * 0.98 <= speed.speed_rad_s <= self._speeds[1] * 1.02,
            speed_rpm=speed.speed_rad_s * 30 / pi,
            speeds_rpm=self._speeds_rpm,
            vibration_um=m.vibration_um[0],
            vibration_limit_um=m.vibration_um[1],
            interval_m=m.interval_m,
            tripped=self.tripped,
            brain_connected=cycle.brain_connected,
            doubts=self._readings.doubts
            | self._oil.beyond
            | self._supervision.doubts
            | self._arming.doubts
            | self._frame_loss.doubts
            | ({"link_fault": cycle.link_fault} if cycle.link_fault else {}),
        )

    # ------------------------------------------------------------------ acts

    def _obey(
        self, commands: list[CommandRequest], situation: Situation, notices: list[Notice]
    ) -> list[CommandReply]:
        """Answer every request; disarm goes first."""
        replies = []
        for request in sorted(commands, key=lambda c: c.verb != "disarm"):
            if request.verb == "reset":
                left = (
                    self._protection.reset()
                    + self._oil.reset()
                    + self._speed_high.reset(self._acquire.speed.lost)
                )
                notices += self._speed_check.reset()
                self._arming.reset(left)
                self._permit.reset()
                self._supervision.reset()
                situation.tripped = self.tripped
                replies.append(CommandReply(request.seq, not left, left))
                notices.append(
                    Notice(
                        Severity.INFO,
                        "command",
                        f"reset from {request.origin}: {len(left)} trips left",
                    )
                )
            elif request.verb == "announce":
                refused = self._announcements.request(request, situation.now_ns)
                replies.append(CommandReply(request.seq, not refused, refused))
                notices += (
                    []
                    if refused
                    else [
                        Notice(
                            Severity.INFO,
                            "command",
                            (
                                f"announce accepted from {request.origin}: "
                                f"{len(self._announcements.state)} ramps ahead"
                            ),
                        )
                    ]
                )
            else:
                reply, told = self._arming.request(request, situation)
                if request.verb == "arm" and reply.accepted:
                    self._permit.reset()
                replies.append(reply)
                notices += told
        return replies

    def _foreign_trip(self) -> bool:
        """Whether the node follows somebody else, and the permit is configured to go for that."""
        return self._config.drive.trip_on_foreign and "node_elsewhere" in self._supervision.doubts

    def _judge_permit(self, situation: Situation, blocks: bool) -> list[Notice]:
        """The permit of this cycle, after arming has judged it."""
        tripped = (
            self._arming.state.arm_state == ArmState.TRIPPED and self._config.drive.trip_on_danger
        )
        return self._permit.step(
            PermitFacts(
                situation.now_ns,
                situation.samples_fresh,
                blocks and situation.samples_fresh and situation.displacement_ok,
                situation.tripped if tripped else [],
                self._foreign_trip(),
            )
        )

    def _command_due(self, cycle: Cycle) -> bool:
        """Whether a command is due that can really be sent: it rests on an interval of its own."""
        fresh = self._acquire.sample_age_ns(cycle.now_ns) < self._fresh_ns
        return self._speaker.command_due(cycle.now_ns) and self._may_command(fresh, cycle.link_up)

    def _may_command(self, fresh: bool, link_up: bool) -> bool:
        """Whether a command that is due may be sent: armed (or tripped from armed), not monitor,
        samples, a link."""
        arming = self._arming.state
        return arming.commanding and arming.mode != Mode.MONITOR and fresh and link_up

    def _speak(self, situation: Situation) -> list[RawFrame]:
        """Heartbeat always; command only while armed (or tripped from armed), fresh, and not in
        monitor mode."""
        m, arming, permit = self._memory, self._arming.state, self._permit.state
        frames = []
        if self._may_command(situation.samples_fresh, situation.link_up):
            frames += self._speaker.command(
                situation.now_ns, m.target, self._acquire.newest_tick_us
            )
        if frames:
            self._supervision.sent(self._speaker.state.command_counter, m.target, situation.now_ns)
        return frames + self._speaker.heartbeat(
            situation.now_ns, arming.mode, arming.arm_state, permit.granted, permit.trip_request
        )

    def _event(self, notice: Notice, count: int, now_ns: int) -> Event:
        self._memory.event_seq += 1
        return Event(
            self._memory.event_seq,
            now_ns,
            int(notice.severity),
            notice.name,
            notice.text,
            notice.value,
            notice.limit,
            count,
        )

    def _standing(self) -> list[Alarm]:
        """Every alarm that stands, one of each name: protection's, the failsafes', the link's."""
        m = self._memory
        link = [Alarm("link_fault", Severity.FAULT, m.link_fault_ns, 0.0, 0.0, False, m.link_fault)]
        found = [
            *self._protection.standing(),
            *self._pair.standing(),
            *self._readings.standing(),
            *self._oil.standing(),
            *self._speed_high.standing(),
            *self._speed_check.standing(),
            *self._supervision.standing(),
            *self._frame_loss.standing(),
            *self._more.standing(),
            *self._permit.standing(),
            *self._unwritable.standing(),
            *(link if m.link_fault else []),
            *self._arming.standing(),
        ]
        return list({alarm.name: alarm for alarm in reversed(found)}.values())[::-1]

    def _state(self, now_ns: int) -> GuardState:
        """Everything the guard says about itself."""
        m, arming, a = self._memory, self._arming.state, self._acquire
        m.state_ns, m.state_due_ns = now_ns, now_ns + STATE_PERIOD_NS
        m.state_seq += 1
        permit = self._permit.state
        low_m, high_m = m.interval_m or (0.0, 0.0)
        p2p_um = self._protection.motion.peak_to_peak_um
        node = a.node
        return GuardState(
            seq=m.state_seq,
            t_ns=now_ns,
            mode=int(arming.mode),
            arm_state=int(arming.arm_state),
            authority=arming.authority.held,
            authority_reasons=list(arming.authority.reasons),
            speed_rad_s=a.speed.speed_rad_s,
            load_estimate_N=0.5 * (m.load.low_N + m.load.high_N),
            clearance_low_um=low_m * 1e6,
            clearance_high_um=high_m * 1e6,
            target_clearance_um=m.target.clearance_um,
            target_pressure_bar=m.target.pressure_bar,
            clearance_actual_um=a.status.clearance_actual_um if a.status else 0.0,
            peak_to_peak_um=p2p_um,
            run_permit=permit.granted,
            trip_request=permit.trip_request,
            node_following=node is not None
            and node.mode == NodeMode.FOLLOWING
            and node.session == self._session,
            alarms=self._standing(),
            counters=self.counters,
            zone=zone(max(p2p_um), a.speed.speed_rad_s * 30 / pi),
            permit_reasons=permit.reasons,
            channel_causes=self._protection.causes,
        )


def _clock_notice(acquired: AcquireOutput) -> Notice:
    """Why node time from before does not count any more."""
    if acquired.restarted:
        return Notice(
            Severity.FAULT,
            "node_restarted",
            "the node has started again; nothing from before counts",
        )
    if acquired.node_ahead_ns:
        return Notice(
            Severity.FAULT,
            "clock_leap",
            (
                f"the node's clock ran {acquired.node_ahead_ns * 1e-6:.0f} ms ahead of this one: "
                f"the host was suspended; "
                "nothing from before counts"
            ),
        )
    return Notice(
        Severity.FAULT,
        "clock_jump",
        (
            "the node's clock does not agree with its frame counter: the node was stopped or its "
            "clock was set; "
            "nothing from before counts"
        ),
    )


def _gone(name: str, cycle: Cycle) -> str:
    """That a room or the link has gone, and why where that is known."""
    return (
        f"link gone: {cycle.link_fault}" if name == "link" and cycle.link_fault else f"{name} gone"
    )
