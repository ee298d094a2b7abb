"""The measures that ``[[measure]]`` adds: each value held against its set points.

A channel that is open or stuck, a reading that is not OK and an unknown speed hold the timers: they
neither trip nor end anything.  Outside its speeds, or while it is not to be judged, a measure
forgets its timers and its alarm ends, unless it is latched.  Values are as measured: no runout is
taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Final

import msgspec

from firmware_py import signals
from firmware_py.acquire.slow_pages import doubt_of
from firmware_py.config import Config
from firmware_py.config.added_measures import added
from firmware_py.config.instances import slow_signals
from firmware_py.config.measure_types import JudgedWhile, Measure, SetPoint
from firmware_py.config.measures import probes_at, voted
from firmware_py.guard.alarms.alarm import AlarmState, Notice
from firmware_py.guard.measurement.channel_meters import (
    ChannelMeter,
    MeterState,
    OrbitMeter,
    OrderMeter,
    SumsMeter,
    VelocityMeter,
)
from firmware_py.guard.measurement.motion import ShaftMotion
from firmware_py.guard.protection.set_points import Ballot, SetPointAlarms, cap_um, in_force
from firmware_py.records import Alarm, Block, ChannelCause, RigReading, Severity, cause_of

READING_AGE_NS: Final = 250_000_000
"""An older reading says nothing."""

NOT_JUDGED: Final = frozenset({ChannelCause.OPEN, ChannelCause.STUCK})
LOOK: Final = "look at the machine"


class HeldReading(msgspec.Struct):
    """The newest value of a slow reading; None where it was not OK."""

    value: float | None = None
    t_ns: int = -READING_AGE_NS


class AddedState(msgspec.Struct):
    """Alarms and meters by name, the newest readings, and which measures are not OK."""

    alarms: dict[str, AlarmState] = {}
    meters: dict[str, MeterState] = {}
    readings: dict[str, HeldReading] = {}
    not_ok: list[str] = []


class BearingNow(msgspec.Struct, frozen=True):
    """Where the shaft is in one bearing: its motion, whether both probes are OK, the clearance."""

    motion: ShaftMotion
    ok: bool
    clearance_um: float


class AddedFacts(msgspec.Struct, frozen=True):
    """What other stages know: the speed (None: unknown), whether the shaft turns, whether the
    device commands, the bearings by name, and standard readings by name (None: not OK)."""

    speed_rpm: float | None
    turning: bool
    commanding: bool
    bearings: dict[str, BearingNow]
    standard: Callable[[str], float | None]


class AddedMeasures:
    """Judges the added rows of the table.

    Parameters
    ----------
    config
        The table, channels and readings.
    latched
        Names of danger alarms that stood latched when the guard last ended.
    """

    def __init__(self, config: Config, latched: list[str]) -> None:
        self.rows = added(config)
        self._share = config.limits.clearance_share
        self._set = SetPointAlarms(self.rows, voted(config.group))
        self._set.latch(latched)
        self._meters = {row.name: meter for row in self.rows if (meter := _meter(config, row))}
        seated = {channel.name: channel.bearing for channel in config.machine.channel}
        first = config.machine.bearing.name
        self._at = {row.name: seated.get(row.source, row.source) or first for row in self.rows}
        names = {row.source for row in self.rows if row.kind == "reading"}
        self._slow = [row for row in slow_signals(config) if row.name in names]
        self._state = AddedState(
            self._set.states,
            {name: meter.state for name, meter in self._meters.items()},
            {row.name: HeldReading() for row in self._slow},
            [],
        )

    @property
    def state(self) -> AddedState:
        """The stage's memory (for snapshots)."""
        self._state.meters = {name: meter.state for name, meter in self._meters.items()}
        return self._state

    @state.setter
    def state(self, state: AddedState) -> None:
        self._state = state
        self._set.states = state.alarms = self._set.states | state.alarms
        for name, meter in self._meters.items():
            meter.state = state.meters.get(name, meter.state)
        state.readings = {row.name: HeldReading() for row in self._slow} | state.readings

    @property
    def set_points(self) -> SetPointAlarms:
        """Its set points, and their alarms."""
        return self._set

    def ballot(self, measure: str) -> Ballot:
        """The vote of a measure."""
        return self._set.ballot(measure, measure not in self._state.not_ok)

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        return [
            msgspec.structs.replace(alarm.record(), text=f"{self._set.said(alarm.name)}; {LOOK}")
            for alarm in self._set.shown()
        ]

    def reset(self) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        return [f"still beyond: {self._set.said(alarm.name)}" for alarm in self._set.reset()]

    def step(
        self, blocks: list[Block], readings: list[RigReading], facts: AddedFacts, now_ns: int
    ) -> list[Notice]:
        """Judge new blocks, the newest readings and the speed."""
        notices = list[Notice]()
        if readings:
            self._hold(readings[-1], facts, now_ns)
        for row in self.rows:
            if row.name in self._meters:
                for block in blocks:
                    notices += self._block(row, self._meters[row.name], block, facts)
            elif row.kind == "position":
                for block in blocks[-1:]:
                    notices += self._position(row, block, facts)
            elif row.kind == "speed":
                rpm = facts.speed_rpm
                notices += self._judge(row, rpm, facts, now_ns, ok=rpm is not None)
            else:
                held = self._state.readings[row.source]
                value = held.value if now_ns - held.t_ns <= READING_AGE_NS else None
                notices += self._judge(row, value, facts, now_ns, ok=value is not None)
        return notices

    # ------------------------------------------------------------------ values

    def _hold(self, reading: RigReading, facts: AddedFacts, now_ns: int) -> None:
        """The readings that have just come."""
        for row in self._slow:
            if row.name in signals.STANDARD_READING:
                value = facts.standard(row.name)
            else:
                told = reading.values.get(row.name)
                value = None if told is None or doubt_of(row, told) else told.value
            self._state.readings[row.name] = HeldReading(value, now_ns)

    def _block(
        self, row: Measure, meter: ChannelMeter, block: Block, facts: AddedFacts
    ) -> list[Notice]:
        found, silent, saturated, ok = meter.step(block), False, False, True
        for i in meter.channels:
            cause = cause_of(block.causes, i)
            unknown = cause == ChannelCause.OK and not block.channel_ok >> i & 1
            silent = silent or cause in NOT_JUDGED or unknown
            saturated = saturated or cause == ChannelCause.SATURATED
            ok = ok and cause in (ChannelCause.OK, ChannelCause.SATURATED) and not unknown
        t_ns = block.t_acq_ns + block.instants * block.period_ns
        self._hold_until(row, block.t_acq_ns)
        ok = ok and (facts.speed_rpm is not None or not isinstance(meter, OrderMeter))
        if silent or found is None:  # a meter that has just begun says nothing, and is OK
            return self._judge(row, None, facts, t_ns, ok=ok and not silent)
        whole = found.whole and not saturated
        return self._judge(row, found.value, facts, t_ns, whole=whole, ok=ok)

    def _position(self, row: Measure, block: Block, facts: AddedFacts) -> list[Notice]:
        now = facts.bearings[row.source]
        t_ns = block.t_acq_ns + block.instants * block.period_ns
        if not now.ok:
            return self._judge(row, None, facts, t_ns, ok=False)
        x, y = now.motion.mean_x_m, now.motion.mean_y_m
        share = sqrt(x * x + y * y) * 1e6 / now.clearance_um
        return self._judge(row, share, facts, t_ns, whole=now.motion.complete)

    # ------------------------------------------------------------------ judging

    def _hold_until(self, row: Measure, t_ns: int) -> None:
        """What lies between two blocks is a gap, in which the timers hold."""
        for point in row.points:
            self._set.states[point.alarm].hold(t_ns)

    def _judge(
        self,
        row: Measure,
        value: float | None,
        facts: AddedFacts,
        t_ns: int,
        *,
        whole: bool = True,
        ok: bool = True,
    ) -> list[Notice]:
        self._note(row.name, ok)
        low, high = row.speeds_rpm
        inside = facts.speed_rpm is None or low <= facts.speed_rpm <= high
        notices = list[Notice]()
        for point, limit in zip(row.points, self._limits(row, facts), strict=True):
            alarm = self._set.states[point.alarm]
            stood = alarm.standing
            if not inside or not _applies(point, facts):
                self._set.leave(alarm, t_ns)
            elif value is None:
                alarm.hold(t_ns)
            elif self._set.judge(row, point, value, t_ns, limit=limit, complete=whole):
                text = f"{self._set.said(alarm.name)} for {point.delay_ns * 1e-9:g} s; {LOOK}"
                notices.append(Notice(point.severity, alarm.name, text, value, limit))
            if stood and not alarm.standing:
                text = f"{self._set.said(alarm.name)}: over"
                notices.append(
                    Notice(Severity.INFO, f"{alarm.name}_ended", text, alarm.value, limit)
                )
        return notices

    def _limits(self, row: Measure, facts: AddedFacts) -> list[float]:
        """The set points in force, alert first."""
        factor = self._set.factor(row)
        if not row.capped:
            return in_force(row, factor=factor)
        clearance_um = facts.bearings[self._at[row.name]].clearance_um
        return in_force(row, factor=factor, cap=cap_um(row, self._share, clearance_um))

    def _note(self, name: str, ok: bool) -> None:
        found = self._state.not_ok
        if ok and name in found:
            found.remove(name)
        elif not ok and name not in found:
            found.append(name)


def _applies(point: SetPoint, facts: AddedFacts) -> bool:
    """Whether a set point is to be judged now."""
    if point.judged is JudgedWhile.ARMED:
        return facts.commanding
    return facts.turning or point.judged is JudgedWhile.ALWAYS


def _meter(config: Config, row: Measure) -> ChannelMeter | None:
    """What measures a row from blocks; None of one that other stages measure."""
    channels = config.machine.channel
    places = {channel.name: i for i, channel in enumerate(channels)}
    if row.kind == "smax":
        return OrbitMeter(config, probes_at(config, row.source))
    if row.source not in places or row.kind in ("reading", "speed", "position"):
        return None
    place = places[row.source]
    channel = channels[place]
    if row.kind in ("amplitude_1x", "amplitude_not_1x"):
        return OrderMeter(config, place, channel, row.kind == "amplitude_1x")
    if row.kind == "velocity_rms":
        return VelocityMeter(config, place, channel, row.band_low_hz)
    kind = signals.fast_kind(channel.name, channel.kind)
    return SumsMeter(config, place, channel, row.kind, kind.wire_per_si if kind else 1.0)
