"""Modes, arming and targets: who may move the actuator, and where to.

boot -> check -> disarmed -> armed -> recovery -> tripped (latched).  The worst active failsafe
decides; disarm is never refused; every other refusal lists all its reasons.
"""

from __future__ import annotations

from math import isfinite
from typing import Final, NamedTuple

import msgspec

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.authority.failsafe import Action, Failsafe, Situation, active
from firmware_py.guard.authority.model_authority import CHANGED, Authority, AuthorityState
from firmware_py.guard.authority.slew import Slew, SlewState
from firmware_py.guard.envelope.target import Target
from firmware_py.records import (
    VERBS,
    Advice,
    Alarm,
    ArmState,
    CommandReply,
    CommandRequest,
    Mode,
    Severity,
)

RECOVERY_MAX_NS: Final = 60_000_000_000
"""A recovery that takes longer ends disarmed: nobody expects a machine to move by itself by
then."""

CHECK_PATIENCE_NS: Final = 3_000_000_000
"""While checking, what is not there *yet* is no event before this time has passed."""


ALARMING: Final = (Action.RECOVER, Action.DISARM)
"""Failsafes with these actions are alarms while they hold; a trip's are the danger alarms that
latched it."""

ALSO_ALARMS: Final = ("foreign_heartbeat", "mark_lost")
"""Faults that take authority alone; the other conditions of that kind are operating states or have
alarms of their own."""


class RequestAnswer(NamedTuple):
    """What one request is answered, and what is told of it."""

    reply: CommandReply
    notices: list[Notice]


class Chosen(NamedTuple):
    """Where the actuator is sent in this cycle, and what has changed."""

    target: Target
    notices: list[Notice]


class ArmingState(msgspec.Struct):
    """Mode, arm state, manual set points, and since when recovery lasts and is free of doubt."""

    mode: Mode
    arm_state: ArmState
    setpoint: Target
    authority: AuthorityState
    commanding: bool = False
    recovery_ns: int = 0
    trouble_ns: int = 0
    check_ns: int = 0
    active: list[str] = []
    standing: dict[str, Alarm] = {}
    slew: SlewState | None = None


class Arming:
    """The state machine.

    Parameters
    ----------
    config
        Device mode, actuator, bearing and feed ranges, authority.
    """

    def __init__(self, config: Config) -> None:
        a, b, f = config.machine.actuator, config.machine.bearing, config.machine.feed
        self.safe = Target(a.safe_radial_clearance_um, a.safe_pressure_bar)
        self._clearances = (b.radial_clearance_min_um, b.radial_clearance_max_um)
        self._pressures = (f.pressure_min_bar, f.pressure_max_bar)
        self._recover_ns = round(config.authority.regain_after_s * 1e9)
        self._authority = Authority(config.authority)
        self._slew = Slew(config, self.safe)
        self._state = ArmingState(
            config.device.start_mode, ArmState.BOOT, self.safe, self._authority.state
        )

    @property
    def state(self) -> ArmingState:
        """The stage's memory (for snapshots)."""
        self._state.authority, self._state.slew = self._authority.state, self._slew.state
        return self._state

    @state.setter
    def state(self, state: ArmingState) -> None:
        self._state = state
        self._authority.state = state.authority
        self._slew.state = state.slew or self._slew.state

    # ------------------------------------------------------------------ one cycle

    def step(self, situation: Situation, advice: Advice | None) -> Chosen:
        """Follow the failsafes, judge authority, and choose the target."""
        failsafes = active(situation)
        notices = self._transition(failsafes, situation)
        reasons = [failsafe.reason(situation) for failsafe in failsafes]
        if not situation.monitor_only:  # else the first reason says it all
            reasons += self._authority.advice_reasons(
                advice, situation.brain_connected, situation.now_ns
            )
            if self._state.arm_state in (ArmState.ARMED, ArmState.RECOVERY):
                reasons += self._authority.know(advice)
        s = self._state
        doubts = list(reasons)
        if not situation.monitor_only:
            doubts += [] if s.arm_state == ArmState.ARMED else ["not armed"]
            doubts += ["mode is not auto"] if s.mode != Mode.AUTO else []
        notices += self._authority.step(doubts, advice.seq if advice else -1, situation.now_ns)
        target = self._target(situation, advice, not reasons)
        if s.commanding and s.mode != Mode.MONITOR:
            notices += self._slew.watch(situation.now_ns)
        return Chosen(target, notices)

    def _transition(self, failsafes: list[Failsafe], situation: Situation) -> list[Notice]:
        """Move to the state that the worst failsafe asks for."""
        s, now_ns = self._state, situation.now_ns
        if s.arm_state == ArmState.BOOT:
            s.arm_state, s.check_ns = ArmState.CHECK, now_ns
        patient = s.arm_state == ArmState.CHECK and now_ns - s.check_ns < CHECK_PATIENCE_NS
        notices = [] if patient else self._tell(failsafes, situation)
        action = max((failsafe.action for failsafe in failsafes), default=Action.NOTHING)
        if action >= Action.RECOVER:
            s.trouble_ns = now_ns
        if action == Action.TRIP:
            if s.arm_state != ArmState.TRIPPED:
                s.arm_state = ArmState.TRIPPED
                notices.append(Notice(Severity.DANGER, "tripped", ", ".join(situation.tripped)))
        elif s.arm_state == ArmState.CHECK and action < Action.RECOVER:
            s.arm_state = ArmState.DISARMED
        elif s.commanding and s.arm_state != ArmState.TRIPPED:
            notices += self._armed(action, failsafes, situation)
        return notices

    def _armed(
        self, action: Action, failsafes: list[Failsafe], situation: Situation
    ) -> list[Notice]:
        """Between armed and recovery, or out of both."""
        s, now_ns = self._state, situation.now_ns
        recovering = s.arm_state == ArmState.RECOVERY
        if action == Action.DISARM or (recovering and now_ns - s.recovery_ns > RECOVERY_MAX_NS):
            s.arm_state, s.commanding = ArmState.DISARMED, False
            reason = "; ".join(f.reason(situation) for f in failsafes) or "recovery took too long"
            return [Notice(Severity.ALERT, "disarmed", reason)]
        if action == Action.RECOVER and not recovering:
            s.arm_state, s.recovery_ns = ArmState.RECOVERY, now_ns
            return [
                Notice(
                    Severity.ALERT, "recovery", "; ".join(f.reason(situation) for f in failsafes)
                )
            ]
        if recovering and now_ns - s.trouble_ns >= self._recover_ns:
            s.arm_state = ArmState.ARMED
            return [
                Notice(Severity.INFO, "recovered", f"after {(now_ns - s.recovery_ns) * 1e-9:.1f} s")
            ]
        return []

    def _tell(self, failsafes: list[Failsafe], situation: Situation) -> list[Notice]:
        """One notice for each failsafe that has just begun to hold (a trip is told with its
        names)."""
        names = [failsafe.name for failsafe in failsafes]
        before, self._state.active = self._state.active, names
        standing = self._state.standing
        self._state.standing = {
            f.name: Alarm(
                f.name,
                Severity.FAULT if f.action >= Action.RECOVER else Severity.ALERT,
                standing[f.name].since_ns if f.name in standing else situation.now_ns,
                0.0,
                0.0,
                False,
                _said(f, situation),
            )
            for f in failsafes
            if (f.action in ALARMING or f.name in ALSO_ALARMS) and not f.alarmed
        }
        if names == before:
            return []
        return [
            Notice(
                Severity.FAULT if f.action >= Action.RECOVER else Severity.ALERT,
                f.name,
                _said(f, situation),
            )
            for f in failsafes
            if f.name not in before and f.action != Action.TRIP and not f.alarmed
        ]

    def _target(self, situation: Situation, advice: Advice | None, sound: bool) -> Target:
        """Set point or advice narrowed to the admissible interval, step by step; otherwise the safe
        values, at once.

        In monitor mode this is what the device would do.
        """
        s = self._state
        if situation.interval_m is None or s.arm_state in (ArmState.TRIPPED, ArmState.RECOVERY):
            return self._slew.retreat(situation.now_ns)
        if s.mode == Mode.MANUAL:
            requested = s.setpoint
        elif (
            sound
            and advice is not None
            and advice.clearance_um is not None
            and (s.mode == Mode.MONITOR or self._authority.state.held)
        ):
            pressure = (
                self.safe.pressure_bar if advice.pressure_bar is None else advice.pressure_bar
            )
            requested = Target(advice.clearance_um, pressure)
        else:
            return self._slew.retreat(situation.now_ns)
        low_m, high_m = situation.interval_m
        return self._slew.follow(
            requested, (low_m * 1e6, high_m * 1e6), self._pressures, situation.now_ns
        )

    @property
    def doubts(self) -> dict[str, str]:
        """Alarms of its own that speak against acting."""
        return self._slew.doubts

    def standing(self) -> list[Alarm]:
        """Failsafes that hold, and authority that a model had and lost."""
        s, authority = self._state, self._authority.state
        lost = s.mode == Mode.AUTO and s.commanding and authority.regain and not authority.held
        alarm = Alarm(
            "authority_lost",
            Severity.ALERT,
            authority.lost_ns,
            0.0,
            0.0,
            False,
            "; ".join(authority.reasons),
        )
        return [*s.standing.values(), *self._slew.standing(), *([alarm] if lost else [])]

    # ------------------------------------------------------------------ requests

    def request(self, request: CommandRequest, situation: Situation) -> RequestAnswer:
        """Answer any verb but ``reset`` (which is protection's to judge first)."""
        handler = {
            "mode": self._set_mode,
            "arm": self._arm,
            "disarm": self._disarm,
            "set_clearance": self._set_clearance,
            "set_pressure": self._set_pressure,
        }.get(request.verb)
        if handler is None:
            reasons = [f"unknown verb {request.verb!r}; use one of {', '.join(VERBS)}"]
        else:
            reasons = handler(request, situation)
        if reasons:
            return RequestAnswer(CommandReply(request.seq, False, reasons), [])
        shown = "" if request.value is None else f" {request.value:g}"
        shown = (
            f" {Mode(request.mode).name.lower()}"
            if request.verb == "mode" and request.mode is not None
            else shown
        )
        notice = Notice(
            Severity.INFO, "command", f"{request.verb}{shown} accepted from {request.origin}"
        )
        return RequestAnswer(CommandReply(request.seq, True, []), [notice])

    def reset(self, left: list[str]) -> None:
        """A person asks to start anew; ``left`` are the trips that cannot be cleared yet."""
        self._authority.reset()
        if self._state.arm_state == ArmState.TRIPPED and not left:
            self._state.arm_state, self._state.commanding, self._state.check_ns = (
                ArmState.CHECK,
                False,
                0,
            )

    def _set_mode(self, request: CommandRequest, situation: Situation) -> list[str]:
        s = self._state
        if request.mode not in tuple(Mode):
            return [f"mode = {request.mode}: not one of 0 monitor, 1 manual, 2 auto"]
        s.mode = Mode(request.mode)
        if s.mode == Mode.MONITOR:
            self._disarm(request, situation)
        if s.mode == Mode.MANUAL:
            s.setpoint = self.safe
        return []

    def _arm(self, request: CommandRequest, situation: Situation) -> list[str]:
        s = self._state
        reasons = (
            ["mode is monitor, which never moves the actuator; choose manual or auto first"]
            if s.mode == Mode.MONITOR
            else []
        )
        reasons += [f.reason(situation) for f in active(situation) if f.bars_arming]
        reasons += situation.node_reasons
        if not reasons and self._authority.state.models == CHANGED:
            self._authority.start(situation.now_ns, situation.models)
        if reasons or s.arm_state in (ArmState.ARMED, ArmState.RECOVERY):
            return reasons
        s.arm_state, s.commanding, s.trouble_ns = ArmState.ARMED, True, 0
        self._authority.start(situation.now_ns, situation.models)
        self._slew.start()
        return []

    def _disarm(self, request: CommandRequest, situation: Situation) -> list[str]:
        s = self._state
        s.commanding = False
        if s.arm_state in (ArmState.ARMED, ArmState.RECOVERY):
            s.arm_state = ArmState.DISARMED
        return []

    def _set_clearance(self, request: CommandRequest, situation: Situation) -> list[str]:
        reasons = self._value_reasons(request, self._clearances, "um radial")
        if not reasons and request.value is not None:
            self._state.setpoint = Target(request.value, self._state.setpoint.pressure_bar)
        return reasons

    def _set_pressure(self, request: CommandRequest, situation: Situation) -> list[str]:
        reasons = self._value_reasons(request, self._pressures, "bar")
        if not reasons and request.value is not None:
            self._state.setpoint = Target(self._state.setpoint.clearance_um, request.value)
        return reasons

    def _value_reasons(
        self, request: CommandRequest, limits: tuple[float, float], unit: str
    ) -> list[str]:
        """Why a set point cannot be taken."""
        value, (low, high) = request.value, limits
        reasons = (
            []
            if self._state.mode == Mode.MANUAL
            else [f"mode is {self._state.mode.name.lower()}; set points belong to manual"]
        )
        if value is None or not isfinite(value):
            reasons.append(f"{request.verb} needs a finite value in {unit}")
        elif not low <= value <= high:
            reasons.append(f"{request.verb} = {value:g}: outside {low:g} .. {high:g} {unit}")
        return reasons


def _said(failsafe: Failsafe, situation: Situation) -> str:
    """What a person reads of a failsafe now; of a wrong node, every difference."""
    differences = situation.node_reasons if failsafe.name == "node_mismatch" else []
    return "; ".join([failsafe.reason(situation), *differences])
