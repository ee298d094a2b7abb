"""Alarms and trips after the vocabulary of API 670 (5th edition; no conformity is claimed).

Displacement and acceleration, alert and danger, channel OK.

Danger with its delay latches and trips; alert does not latch.  A channel that is not OK raises an
alarm with its cause; one that is open or stuck leaves the vote, one that saturates counts as at
least the end of its range, of the others what is good counts
(:mod:`firmware_py.acquire.channel_ok`).  Timers hold while nothing can be said.

The displacement set points are capped by a share of the *smaller* of reported and commanded radial
clearance: a vibration that was harmless in a wide bearing is not in a narrow one.
"""

from __future__ import annotations

from math import sqrt
from operator import itemgetter
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.config.measure_types import Measure
from firmware_py.config.measures import vibration, voted
from firmware_py.guard.alarms.alarm import AlarmState, Notice
from firmware_py.guard.measurement.motion import (
    DISPLACEMENTS,
    BlockSums,
    MotionMeter,
    ShaftMotion,
    watched,
)
from firmware_py.guard.protection.permit import UNREADABLE, UNREADABLE_TEXT
from firmware_py.guard.protection.set_points import Ballot, SetPointAlarms, in_force
from firmware_py.records import N_CHANNELS, Alarm, Block, ChannelCause, Severity, cause_of

ZONES: Final = (("A", 4800.0), ("B", 9000.0), ("C", 13200.0))
"""Zone boundaries ``k / sqrt(rpm)`` um peak-to-peak, by analogy with ISO 20816 / ISO 7919."""

QUIET: Final = ShaftMotion(False, (0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)


OUT_OF_VOTE: Final = frozenset({ChannelCause.OPEN, ChannelCause.STUCK})
UNKNOWN: Final = "not OK"
CAUSES: Final = {
    ChannelCause.OPEN: "is open: at the end of its range without an alternating part; its trip is "
    "defeated",
    ChannelCause.STUCK: "is stuck: it does not move by one count; its trip is defeated",
    ChannelCause.INTERMITTENT: "is intermittent: it steps, drops out or touches the end of its "
    "range out of step with "
    "the shaft; what is clean still counts, and it is OK after 30 s without",
    ChannelCause.SATURATED: "is saturated: it touches the end of its range in step with the shaft "
    "and counts as that",
    ChannelCause.BEYOND: "lies beyond its range; it counts as measured",
}


class ProtectionState(msgspec.Struct):
    """Alarms by name, channels that are not OK or saturated, the window of the last turn and what
    it said."""

    alarms: dict[str, AlarmState]
    not_ok: dict[str, AlarmState]
    window: list[BlockSums]
    motion: ShaftMotion = QUIET
    saturated: dict[str, AlarmState] = {}
    causes: list[int] = msgspec.field(default_factory=lambda: [0] * N_CHANNELS)


def zone(peak_to_peak_um: float, speed_rpm: float) -> str:
    """Vibration zone ``A`` .. ``D`` of a peak-to-peak displacement; empty at standstill."""
    if not speed_rpm > 0.0:
        return ""
    for letter, constant in ZONES:
        if peak_to_peak_um * sqrt(speed_rpm) <= constant:
            return letter
    return "D"


class Protection:
    """Alarms of the displacements and accelerations, and the OK flags of all channels.

    Parameters
    ----------
    config
        Limits, channels and sampling.
    latched
        Names of danger alarms that stood latched when the guard last ended.
    """

    def __init__(self, config: Config, latched: list[str]) -> None:
        self._share = config.limits.clearance_share
        self._meter = MotionMeter(config)
        self._names = [channel.name for channel in config.machine.channel]
        self._watched = watched(config.machine.channel)
        self._rows = vibration(config)
        self._set = SetPointAlarms(self._rows, voted(config.group))
        self._set.latch(latched, unknown=True)
        not_ok = {
            name: AlarmState(f"{name}_not_ok", int(Severity.FAULT), False) for name in self._names
        }
        self._rails = [
            abs(c.ok_high - c.ok_low) / 2 * (1e6 if i in DISPLACEMENTS else 1.0)
            for i, c in enumerate(config.machine.channel)
        ]
        self._state = ProtectionState(
            self._set.states,
            not_ok,
            self._meter.window,
            saturated=self._no_saturated(),
            causes=[0] * len(self._names),
        )
        self.tripped = self._set.tripped()

    @property
    def state(self) -> ProtectionState:
        """The stage's memory (for snapshots)."""
        return self._state

    @state.setter
    def state(self, state: ProtectionState) -> None:
        self._state = state
        state.saturated = (
            self._no_saturated() | state.saturated
        )  # a snapshot of an earlier version has none
        self._meter.window, self._set.states = state.window, state.alarms
        self.tripped = self._set.tripped()

    def _no_saturated(self) -> dict[str, AlarmState]:
        names = [self._names[i] for i in self._watched]
        return {name: AlarmState(f"{name}_saturated", int(Severity.FAULT), False) for name in names}

    def step(self, blocks: list[Block], clearance_um: float) -> list[Notice]:
        """Judge new blocks at the smaller of reported and commanded radial clearance."""
        notices: list[Notice] = []
        for block in blocks:
            self._state.motion = self._meter.step(block)
            t_ns = block.t_acq_ns + block.instants * block.period_ns
            self._judge_channels(block, t_ns, notices)
            self._judge_vibration(block, clearance_um, t_ns, notices)
        if notices:
            self.tripped = self._set.tripped()
        return notices

    # ------------------------------------------------------------------ what stands now

    @property
    def motion(self) -> ShaftMotion:
        """Statistics of the last full turn."""
        return self._state.motion

    @property
    def set_points(self) -> SetPointAlarms:
        """Its set points, and their alarms."""
        return self._set

    @property
    def displacement_ok(self) -> bool:
        """Whether both shaft displacements are OK: what they measure is where the shaft is."""
        s = self._state
        return not any(
            s.not_ok[self._names[i]].standing or s.saturated[self._names[i]].standing
            for i in DISPLACEMENTS
        )

    @property
    def causes(self) -> dict[str, str]:
        """Why each channel that is not OK is not."""
        s = self._state
        return {
            name: ChannelCause(s.causes[i]).name.lower() if s.causes[i] else UNKNOWN
            for i, name in enumerate(self._names)
            if self._stands(name)
        }

    def ballot(self, measure: str) -> Ballot:
        """The vote of a channel: one that saturates in step with the shaft is OK, and votes."""
        return self._set.ballot(measure, not self._state.not_ok[measure].standing)

    def _stands(self, name: str) -> bool:
        """Whether channel ``name`` is said to be not OK, or saturated."""
        s = self._state
        return s.not_ok[name].standing or (name in s.saturated and s.saturated[name].standing)

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        s = self._state
        limits = [
            msgspec.structs.replace(a.record(), text=_text(a, self._names))
            for a in self._set.shown()
        ]
        bad = [
            (a.record(), f"channel {name} {CAUSES.get(ChannelCause(s.causes[i]), 'is ' + UNKNOWN)}")
            for i, name in enumerate(self._names)
            for a in (s.not_ok[name], s.saturated.get(name))
            if a and a.standing
        ]
        return limits + [msgspec.structs.replace(record, text=text) for record, text in bad]

    def reset(self) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        reasons = [
            f"{a.name} still exceeded: {a.value:.4g} above {a.limit:.4g}; stop the machine or "
            f"remove the cause"
            for a in self._set.reset()
        ]
        self.tripped = self._set.tripped()
        return reasons

    def set_points_um(self, clearance_um: float) -> tuple[float, float]:
        """Displacement alert and danger (um peak-to-peak) at a radial clearance: those of the probe
        whose danger is the lower, multiplied by nothing."""
        cap_um = self._share * clearance_um
        limits = [in_force(row, cap=cap_um) for row in self._rows[: len(DISPLACEMENTS)]]
        alert, danger = min(limits, key=itemgetter(1))
        return alert, danger

    def _limits(self, row: Measure, clearance_um: float) -> tuple[float, float]:
        """Alert and danger in force: of a displacement at most a share of the clearance."""
        alert, danger = in_force(row, factor=self._set.factor(row), cap=self._share * clearance_um)
        return alert, danger

    # ------------------------------------------------------------------ one block

    def _judge_channels(self, block: Block, t_ns: int, notices: list[Notice]) -> None:
        """Alarms of channels that are not OK, and one notice for each change of the cause."""
        s = self._state
        for i, name in enumerate(self._names):
            cause = cause_of(block.causes, i)
            saturated = cause == ChannelCause.SATURATED and name in s.saturated
            bad = not saturated and (cause != ChannelCause.OK or not block.channel_ok >> i & 1)
            if bad and (not s.not_ok[name].standing or s.causes[i] != cause):
                notices.append(
                    Notice(
                        Severity.FAULT,
                        s.not_ok[name].name,
                        (
                            f"channel {name} {CAUSES.get(cause, 'is ' + UNKNOWN)}; check sensor, "
                            f"cable and driver"
                        ),
                    )
                )
            elif saturated and not s.saturated[name].standing:
                notices.append(self._saturated(i, name))
            elif not bad and not saturated and self._stands(name):
                notices.append(Notice(Severity.INFO, f"{name}_ok", f"channel {name} is OK again"))
            s.causes[i] = int(cause)
            _stand(s.not_ok[name], bad, t_ns)
            if name in s.saturated:
                _stand(s.saturated[name], saturated, t_ns, self._rails[i])

    def _saturated(self, i: int, name: str) -> Notice:
        """A vibration reaches the end of the range: it counts as that, and a limit beyond it cannot
        be reached."""
        danger = self._rows[self._watched.index(i)].points[-1].limit
        rail, unit = self._rails[i], _unit(i)
        beyond = (
            ""
            if rail > danger
            else f"; the danger limit {danger:.4g} lies beyond what it can show: lower one"
        )
        return Notice(
            Severity.FAULT,
            f"{name}_saturated",
            (
                f"channel {name} touches the end of its range in step with the shaft: its "
                f"vibration is at least "
                f"{rail:.4g} {unit} and counts as that{beyond}; reduce the vibration or fit a "
                f"wider range"
            ),
            rail,
            danger,
        )

    def _judge_vibration(
        self, block: Block, clearance_um: float, t_ns: int, notices: list[Notice]
    ) -> None:
        """Judge the time of ``block`` alone: what lies between two blocks is a gap, in which the
        timers hold."""
        motion = self._state.motion
        measured = motion.peak_to_peak_um + motion.rms_m_s2
        for i, row, value, whole in zip(
            self._watched, self._rows, measured, motion.whole, strict=True
        ):
            cause = cause_of(block.causes, i)
            saturated = cause == ChannelCause.SATURATED
            unknown = cause == ChannelCause.OK and not block.channel_ok >> i & 1
            silent = cause in OUT_OF_VOTE or unknown or (block.unusable >> i & 1 and not saturated)
            value = max(value, self._rails[i]) if saturated else value
            for point, limit in zip(row.points, self._limits(row, clearance_um), strict=True):
                alarm = self._set.states[point.alarm]
                alarm.hold(block.t_acq_ns)
                if silent:
                    alarm.hold(t_ns)
                elif self._set.judge(
                    row, point, value, t_ns, limit=limit, complete=whole and not saturated
                ):
                    least = "at least " if saturated else ""
                    notices.append(
                        Notice(
                            Severity(alarm.severity),
                            alarm.name,
                            (
                                f"{self._names[i]} above {limit:.4g} {_unit(i)} for "
                                f"{point.delay_ns * 1e-9:g} s without a return; "
                                f"now {least}{value:.4g}"
                            ),
                            value,
                            limit,
                        )
                    )


def _text(alarm: AlarmState, names: list[str]) -> str:
    """What a person reads of a limit while its alarm stands, latched or not."""
    if alarm.name == UNREADABLE:
        return UNREADABLE_TEXT
    if not alarm.limit:
        return "latched before this guard started; find the cause, then `reset`"
    channel = alarm.name.rpartition("_")[0]
    now = f"{alarm.value:.4g} {_unit(names.index(channel))}, limit {alarm.limit:.4g}"
    if alarm.latching:
        return (
            f"{channel} passed its danger limit and is now at {now}; find the cause, then `reset`"
        )
    return f"{channel} at {now}; reduce speed or load and look at the diagnosis"


def _unit(i: int) -> str:
    return "um peak-to-peak" if i in DISPLACEMENTS else "m/s2 rms"


def _stand(alarm: AlarmState, standing: bool, t_ns: int, value: float = 0.0) -> None:
    """Let an alarm that has no limit stand or go."""
    if standing and not alarm.standing:
        alarm.since_ns, alarm.value = t_ns, value
    alarm.standing = standing
