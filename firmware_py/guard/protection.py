"""Alarms and trips after the vocabulary of API 670 (5th edition; no conformity is claimed).

Displacement and acceleration, alert and danger, channel OK.

Danger with its delay latches and trips; alert does not latch.  A channel that is not OK raises an alarm
and defeats its own trip.  The displacement set points are capped by a share of the *smaller* of reported
and commanded radial clearance: a vibration that was harmless in a wide bearing is not in a narrow one.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.guard.alarm import QUIET_NS, AlarmState, Notice
from firmware_py.guard.motion import ACCELERATIONS, DISPLACEMENTS, BlockSums, Motion, MotionMeter
from firmware_py.records import CHANNELS, N_CHANNELS, Alarm, Block, Severity

ZONES: Final = (("A", 4800.0), ("B", 9000.0), ("C", 13200.0))
"""Zone boundaries ``k / sqrt(rpm)`` um peak-to-peak, by analogy with ISO 20816 / ISO 7919."""

WATCHED: Final = DISPLACEMENTS + ACCELERATIONS
QUIET: Final = Motion(False, (0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)


class ProtectionState(msgspec.Struct):
    """Alarms by name, the OK mask, the window of the last turn and what it said."""

    alarms: dict[str, AlarmState]
    not_ok: dict[str, AlarmState]
    window: list[BlockSums]
    motion: Motion = QUIET


def zone(peak_to_peak_um: float, speed_rpm: float) -> str:
    """Vibration zone ``A`` .. ``D`` of a peak-to-peak displacement; empty at standstill."""
    if not speed_rpm > 0.0:
        return ""
    for letter, constant in ZONES:
        if peak_to_peak_um * sqrt(speed_rpm) <= constant:
            return letter
    return "D"


class Protection:
    """Alarms of the five vibration channels and the OK flags of all eight.

    Parameters
    ----------
    config
        Limits, channels and sampling.
    latched
        Names of danger alarms that stood latched when the guard last ended.
    """

    def __init__(self, config: Config, latched: list[str]) -> None:
        lim = config.limits
        self._limits = lim
        self._delays_ns = (round(lim.alert_delay_s * 1e9), round(lim.danger_delay_s * 1e9))
        self._meter = MotionMeter(config)
        alarms = {}
        for i in WATCHED:
            for severity in (Severity.ALERT, Severity.DANGER):
                name = f"{CHANNELS[i]}_{severity.name.lower()}"
                alarms[name] = AlarmState(name, int(severity), severity is Severity.DANGER)
        for name in latched:  # even one that this version does not judge stands until somebody resets it
            alarms.setdefault(name, AlarmState(name, int(Severity.DANGER), latching=True)).standing = True
        not_ok = {name: AlarmState(f"{name}_not_ok", int(Severity.FAULT), False) for name in CHANNELS}
        self._state = ProtectionState(alarms, not_ok, self._meter.window)
        self.tripped = self._latched()

    @property
    def state(self) -> ProtectionState:
        """The stage's memory (for snapshots)."""
        return self._state

    @state.setter
    def state(self, state: ProtectionState) -> None:
        self._state = state
        self._meter.window = state.window
        self.tripped = self._latched()

    def step(self, blocks: list[Block], clearance_um: float) -> list[Notice]:
        """Judge new blocks at the smaller of reported and commanded radial clearance."""
        notices: list[Notice] = []
        for block in blocks:
            self._state.motion = self._meter.step(block)
            t_ns = block.t_acq_ns + len(block.samples) // (2 * N_CHANNELS) * block.period_ns
            self._judge_channels(block.channel_ok, t_ns, notices)
            self._judge_vibration(block, clearance_um, t_ns, notices)
        if notices:
            self.tripped = self._latched()
        return notices

    # ------------------------------------------------------------------ what stands now

    @property
    def motion(self) -> Motion:
        """Statistics of the last full turn."""
        return self._state.motion

    def _latched(self) -> list[str]:
        """Names of latched danger alarms (kept in ``tripped``, which is asked for in every cycle)."""
        return [a.name for a in self._state.alarms.values() if a.latching and a.standing]

    def timers(self) -> dict[str, int]:
        """How long each danger limit has been exceeded whose delay is not over, ns."""
        return {a.name: a.over_ns for a in self._state.alarms.values()
                if a.latching and not a.standing and a.over_ns != QUIET_NS}

    def resume(self, timers: dict[str, int]) -> None:
        """Go on counting delays that ran when the guard last ended; names of another version are left out."""
        for name, over_ns in timers.items():
            if (alarm := self._state.alarms.get(name)) is not None and alarm.latching:
                alarm.over_ns = over_ns

    @property
    def displacement_ok(self) -> bool:
        """Whether both shaft displacements are OK."""
        return not any(self._state.not_ok[CHANNELS[i]].standing for i in DISPLACEMENTS)

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        s = self._state
        return [a.record() for a in [*s.alarms.values(), *s.not_ok.values()] if a.standing]

    def reset(self) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        reasons = [f"{a.name} still exceeded: {a.value:.4g} above {a.limit:.4g}; stop the machine or remove the cause"
                   for a in self._state.alarms.values() if a.latching and not a.reset()]
        self.tripped = self._latched()
        return reasons

    def set_points_um(self, clearance_um: float) -> tuple[float, float]:
        """Displacement alert and danger (um peak-to-peak) at a radial clearance."""
        lim = self._limits
        danger = min(lim.displacement_danger_um, lim.clearance_share * clearance_um)
        return lim.displacement_alert_um * (danger / lim.displacement_danger_um), danger

    # ------------------------------------------------------------------ one block

    def _judge_channels(self, mask: int, t_ns: int, notices: list[Notice]) -> None:
        for i, name in enumerate(CHANNELS):
            alarm = self._state.not_ok[name]
            bad = not mask >> i & 1
            if bad and not alarm.standing:
                alarm.since_ns = t_ns
                notices.append(Notice(Severity.FAULT, alarm.name, (
                    f"channel {name} is not OK (rail or stuck); its trip is defeated: check sensor and cable")))
            elif alarm.standing and not bad:
                notices.append(Notice(Severity.INFO, f"{name}_ok", f"channel {name} is OK again"))
            alarm.standing = bad

    def _judge_vibration(self, block: Block, clearance_um: float, t_ns: int, notices: list[Notice]) -> None:
        """Judge the time of ``block`` alone: what lies between two blocks is a gap, in which the timers hold."""
        motion, lim = self._state.motion, self._limits
        values = motion.peak_to_peak_um + motion.rms_m_s2
        displacement = self.set_points_um(clearance_um)
        acceleration = (lim.acceleration_alert_m_s2, lim.acceleration_danger_m_s2)
        for i, value in zip(WATCHED, values, strict=True):
            limits = displacement if i in DISPLACEMENTS else acceleration
            for kind, limit, delay_ns in zip(("alert", "danger"), limits, self._delays_ns, strict=True):
                alarm = self._state.alarms[f"{CHANNELS[i]}_{kind}"]
                alarm.hold(block.t_acq_ns)
                if not block.channel_ok >> i & 1:
                    alarm.hold(t_ns)
                elif alarm.judge(value, limit, t_ns, delay_ns=delay_ns, hysteresis=lim.hysteresis_share,
                                 complete=motion.complete):
                    unit = "um peak-to-peak" if i in DISPLACEMENTS else "m/s2 rms"
                    notices.append(Notice(Severity(alarm.severity), alarm.name, (
                        f"{CHANNELS[i]} {value:.4g} {unit} above {limit:.4g} for {delay_ns * 1e-9:g} s"), value, limit))
