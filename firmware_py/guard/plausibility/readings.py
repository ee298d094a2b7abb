"""Slow readings (RIG_STATUS): which of them may be believed, and what is wrong with the others.

Every reading has a row with its range, its greatest rate, and what it is held against.  A reading
outside its range, faster than its rate, or frozen while what drives it moves, is *not OK*; it is
believed again after it has been plausible for ``readings.clean_s``.  A message that is older than
``readings.age_max_ms`` says nothing at all.  What the loss of a reading does stands in
:mod:`firmware_py.guard.authority.failsafe`.

The rows are those of :mod:`firmware_py.guard.plausibility.reading_rows`.

Where reading and channel of the pressure are both not OK, that is an alarm of its own
(``pressure_unknown``), and what they still show counts where it is low.
"""

from __future__ import annotations

from math import inf
from typing import Final

import msgspec
import numpy as np

from firmware_py.config import Config
from firmware_py.config.instances import places
from firmware_py.guard.alarms.alarm import AlarmState, Notice
from firmware_py.guard.envelope.admissible import Known
from firmware_py.guard.plausibility.reading_rows import (
    CLEARANCE,
    OIL,
    POWER,
    PRESSURE,
    implausible,
    reading_rows,
)
from firmware_py.guard.plausibility.reading_state import (
    NEVER_NS,
    OilEvidence,
    ReadingsState,
    ReadingState,
)
from firmware_py.machine.lubricant import coldest_outlet_C
from firmware_py.machine.parts import ACTUATOR, LUBRICANT, has, has_reading
from firmware_py.machine.parts import CLEARANCE as DRAWN_CLEARANCE
from firmware_py.records import (
    Alarm,
    Block,
    ChannelCause,
    NodeState,
    RigStatus,
    Severity,
    cause_of,
)

FROZEN_NS: Final = 60_000_000_000
FROZEN_SPEED_SHARE: Final = 0.2
FROZEN_HEAT_C: Final = 2.0
"""A reading that repeats itself exactly for so long, while the speed moved by that share (power,
which goes with its square), or the friction by what warms the oil by so much, no longer
measures."""

MISMATCH_NS: Final = 2_000_000_000
"""Two readings of the pressure may differ for so long: one is filtered, and the other 50 ms old.
Where they agree between, the time adds up (:mod:`firmware_py.guard.alarms.tally`)."""

BLIND_NS: Final = 500_000_000
"""Reading and channel of the pressure may be without a value together for so long."""

ALONE_NS: Final = 60_000_000_000
"""A source of the pressure that comes and goes is not gone: until the other has been alone for so
long, it neither ends a mismatch nor says that low pressure is over.  Twice the time after which a
channel with a bad contact is believed again."""

SUPPLY: Final = "supply_pressure"
"""The channel that the reading of the pressure is held against, where the rig has it."""
SUPPLY_PERIOD_NS: Final = 50_000_000
"""The channel is averaged over one block this often, as often as the status comes."""

TICKS: Final = 1 << 32


class Readings:
    """Judges each slow reading, and the mean of the channel ``supply_pressure`` beside it.

    Parameters
    ----------
    config
        Table ``[readings]``, and the declared ranges of bearing, oil, feed and speed.
    """

    def __init__(self, config: Config) -> None:
        b, r = config.machine.bearing, config.machine.readings
        self._mismatch_bar = r.pressure_mismatch_bar
        self._age_max_ns, self._clean_ns = round(r.age_max_ms * 1e6), round(r.clean_s * 1e9)
        self._clearances_um = b.radial_clearance_min_um, b.radial_clearance_max_um
        self._safe_um = config.machine.actuator.safe_radial_clearance_um
        self._coldest_C = (
            coldest_outlet_C(config.machine) if has(config.machine, LUBRICANT) else -inf
        )
        self._supply = places(config.machine.channel).of(SUPPLY)
        channel = config.machine.channel[self._supply]
        self._supply_scale, self._supply_offset = channel.scale, channel.offset
        self._moves = has(config.machine, ACTUATOR)
        self._clearance_known = has(config.machine, DRAWN_CLEARANCE)
        self._heat_W = FROZEN_HEAT_C * config.machine.lubricant.cooling_W_K or inf
        self.rows = reading_rows(config)
        self._sent = {
            name: row for name, row in self.rows.items() if has_reading(config.machine, name)
        }
        alarms = {
            name: AlarmState(f"{name}_not_ok", int(Severity.FAULT), latching=False)
            for name in self.rows
        }
        alarms["stale"] = AlarmState("readings_stale", int(Severity.FAULT), latching=False)
        alarms["blind"] = AlarmState("pressure_unknown", int(Severity.FAULT), latching=False)
        alarms["mismatch"] = AlarmState("pressure_mismatch", int(Severity.FAULT), latching=False)
        self.state = ReadingsState({name: ReadingState() for name in self.rows}, alarms)

    def restore(self, state: ReadingsState) -> None:
        """Go on from a snapshot; alarms that an earlier version did not have begin anew."""
        state.alarms = self.state.alarms | state.alarms
        self.state = state

    # ------------------------------------------------------------------ one cycle

    def step(
        self,
        blocks: list[Block],
        status: RigStatus | None,
        heard_ns: int,
        node: NodeState | None,
        speed_rad_s: float,
        now_ns: int,
    ) -> list[Notice]:
        """Judge ``status``, which was heard at ``heard_ns`` (None: not yet, or the node has just
        started again)."""
        s, notices = self.state, list[Notice]()
        if blocks and now_ns - s.supply_ns >= SUPPLY_PERIOD_NS:
            self._average(blocks[-1], now_ns)
        if status is None or not self._sent:
            s.tick_us, s.heard_ns, s.fresh = -1, NEVER_NS, False
            s.readings[CLEARANCE].believed = None
            return notices
        age_ns = now_ns - heard_ns
        s.fresh = abs(age_ns) <= self._age_max_ns
        self._tell(
            "stale",
            ""
            if s.fresh
            else (
                f"the rig's slow readings are {age_ns * 1e-6:.0f} ms old (limit readings.age_max_ms"
                f" = {self._age_max_ns * 1e-6:.0f}); check that the node sends RIG_STATUS"
            ),
            age_ns * 1e-6,
            self._age_max_ns * 1e-6,
            now_ns,
            notices,
        )
        if heard_ns != s.heard_ns or status.tick_us != s.tick_us:
            passed_s = (status.tick_us - s.tick_us) % TICKS * 1e-6 if s.tick_us >= 0 else None
            s.tick_us, s.heard_ns = status.tick_us, heard_ns
            self._judge(status, passed_s, node, speed_rad_s, now_ns, notices)
        self._see_pressure(now_ns, notices)
        return notices

    def _judge(
        self,
        status: RigStatus,
        passed_s: float | None,
        node: NodeState | None,
        speed_rad_s: float,
        now_ns: int,
        notices: list[Notice],
    ) -> None:
        """Each reading of a new message, and the pressure beside its channel."""
        target_um = node.target_clearance_um if node else None
        for name, row in self._sent.items():
            state, value = self.state.readings[name], float(getattr(status, row.field))
            cause, limit = implausible(
                row, state.value, value, passed_s, target_um if name == CLEARANCE else None
            )
            driver = speed_rad_s if name == POWER else status.shaft_power_W
            if not cause and self._frozen(name, value, driver, now_ns):
                cause, limit = (
                    f"has stood still for {FROZEN_NS * 1e-9:g} s while what drives it moved",
                    value,
                )
            state.value, state.plausible = value, not cause
            if cause:
                state.doubted_ns = now_ns
                text = f"{row.field} = {value:.6g} {row.unit} {cause}; check its sensor and cable"
                self._tell(name, text, value, limit, now_ns, notices)
            elif now_ns - state.doubted_ns >= self._clean_ns:
                state.believed, state.believed_ns = value, now_ns
                self._tell(name, "", value, limit, now_ns, notices)
        self._compare(now_ns, notices)

    def _frozen(self, name: str, value: float, driver: float, now_ns: int) -> bool:
        """Whether the value repeats itself exactly though its driver moved."""
        s = self.state.readings[name]
        if name not in (POWER, OIL) or value != s.value or s.same_ns == NEVER_NS:
            s.same_ns, s.driver_low, s.driver_high = now_ns, driver, driver
            return False
        s.driver_low, s.driver_high = min(s.driver_low, driver), max(s.driver_high, driver)
        needed = FROZEN_SPEED_SHARE * s.driver_high if name == POWER else self._heat_W
        return now_ns - s.same_ns >= FROZEN_NS and s.driver_high - s.driver_low > needed

    def _compare(self, now_ns: int, notices: list[Notice]) -> None:
        """The reading of the pressure beside its channel, where both are OK by themselves."""
        s, limit_bar = self.state, self._mismatch_bar
        slow_bar, fast_bar = self.value(PRESSURE), self.supply_bar(now_ns)
        if slow_bar is None or fast_bar is None:
            if now_ns - s.compared_ns >= ALONE_NS:
                s.apart.clear()
                self._tell("mismatch", "", 0.0, limit_bar, now_ns, notices)
            return
        passed_ns, s.compared_ns = min(now_ns - s.compared_ns, self._age_max_ns), now_ns
        apart_bar = abs(slow_bar - fast_bar)
        apart = apart_bar > limit_bar
        s.apart.add(apart, passed_ns, MISMATCH_NS + self._age_max_ns)
        if apart and s.apart.amount - passed_ns >= MISMATCH_NS:
            self._tell(
                "mismatch",
                (
                    f"{PRESSURE} = {slow_bar:.3f} bar, but the channel supply_pressure shows "
                    f"{fast_bar:.3f} (limit "
                    f"readings.pressure_mismatch_bar = {limit_bar:g} for {MISMATCH_NS * 1e-9:g} "
                    f"s); check both sensors"
                ),
                apart_bar,
                limit_bar,
                now_ns,
                notices,
            )
        elif not apart and not s.apart.amount:
            self._tell("mismatch", "", apart_bar, limit_bar, now_ns, notices)

    def _see_pressure(self, now_ns: int, notices: list[Notice]) -> None:
        """Whether anything shows the supply pressure.

        Where neither samples nor readings come at all, the node is silent, which says more.
        """
        s = self.state
        slow, fast = self.value(PRESSURE), self.supply_bar(now_ns)
        passed_ns = min(now_ns - s.blind_ns, self._age_max_ns) if s.blind_ns != NEVER_NS else 0
        s.blind_ns = now_ns
        if slow is not None and fast is not None:
            s.both_ns = now_ns
        if not s.fresh and now_ns - s.supply_ns > self._age_max_ns:
            return
        if PRESSURE not in self._sent and self._supply < 0:
            return
        if s.blind.add(slow is None and fast is None, passed_ns, BLIND_NS):
            self._tell(
                "blind",
                "neither the reading pressure_actual nor the channel supply_pressure is OK: low "
                "supply pressure trips only where it is still seen; repair one of the two",
                0.0,
                0.0,
                now_ns,
                notices,
            )
        elif not s.blind.amount:
            self._tell("blind", "", 0.0, 0.0, now_ns, notices)

    def _average(self, block: Block, now_ns: int) -> None:
        """Mean of the channel ``supply_pressure`` over ``block``; None while it is not OK.

        A clean block of a channel with a bad contact is kept apart.
        """
        s, i = self.state, self._supply
        s.supply_ns, s.supply_bar, s.supply_doubted_bar = now_ns, None, None
        if i < 0:
            return
        counts = np.frombuffer(block.samples, "<i2")[i :: block.channels]
        mean = int(counts.sum(dtype=np.int64)) / len(counts)
        mean_bar = mean * self._supply_scale + self._supply_offset
        if block.channel_ok >> i & 1:
            s.supply_bar = mean_bar
        elif cause_of(block.causes, i) == ChannelCause.INTERMITTENT and not block.unusable >> i & 1:
            s.supply_doubted_bar = mean_bar

    def _tell(
        self, name: str, cause: str, value: float, limit: float, now_ns: int, notices: list[Notice]
    ) -> None:
        """Begin or end the alarm of ``name``; ``cause`` empty means OK."""
        alarm = self.state.alarms[name]
        if cause:
            alarm.value, alarm.limit = value, limit
            self.state.causes[alarm.name] = cause
            if not alarm.standing:
                alarm.standing, alarm.since_ns = True, now_ns
                notices.append(Notice(Severity.FAULT, alarm.name, cause, value, limit))
        elif alarm.standing:
            alarm.standing = False
            self.state.causes.pop(alarm.name, None)
            notices.append(
                Notice(
                    Severity.INFO, f"{alarm.name}_ended", f"{name} is plausible again", value, limit
                )
            )

    # ------------------------------------------------------------------ what may be believed

    def value(self, name: str) -> float | None:
        """The reading where it is OK and fresh; None otherwise."""
        s = self.state
        known = s.fresh and name in self._sent and not s.alarms[name].standing
        return s.readings[name].value if known else None

    def supply_bar(self, now_ns: int) -> float | None:
        """Mean of the channel ``supply_pressure``; None while it is not OK or old."""
        s = self.state
        return s.supply_bar if now_ns - s.supply_ns <= self._age_max_ns else None

    def smaller_clearance_um(self, node: NodeState | None) -> float:
        """The smaller of measured and commanded radial clearance, for the caps of protection.

        A measured one that is not OK neither lifts the cap nor closes it: the last that was
        believed counts instead.  Where the bearing's clearance is not known at all, nothing is
        capped.
        """
        if not self._clearance_known:
            return inf
        low_um, high_um = self._clearances_um
        measured_um = self.state.readings[CLEARANCE].believed
        target_um = node.target_clearance_um if node and self._moves else self._safe_um
        smaller_um = min(self._safe_um if measured_um is None else measured_um, target_um)
        return min(max(smaller_um, low_um), high_um)

    def narrowest_um(self, smaller_um: float) -> float:
        """The clearance in which vibration was measured: :meth:`smaller_clearance_um`, or the
        narrowest there is."""
        return self._clearances_um[0] if self.value(CLEARANCE) is None else smaller_um

    @property
    def drawn(self) -> bool:
        """Whether the clearance is fixed and not measured, so that the drawing's counts."""
        return not self._moves and CLEARANCE not in self._sent

    @property
    def doubts(self) -> dict[str, str]:
        """Alarms that stand, with what a person is told of them."""
        return self.state.causes

    def known(self) -> Known | None:
        """All that an estimate of the load rests on; None while a part is not OK, or the oil colder
        than declared."""
        oil_C, pressure_bar = self.value(OIL), self.value(PRESSURE)
        clearance_um = self.value(CLEARANCE)
        if (
            oil_C is None
            or clearance_um is None
            or pressure_bar is None
            or oil_C < self._coldest_C
            or self.state.alarms["mismatch"].standing
        ):
            return None
        return Known(oil_C, clearance_um, pressure_bar, self.value(POWER))

    def pressure(self, now_ns: int) -> OilEvidence:
        """The lower of reading and channel where they are OK.

        Where neither is, the lower of what each shows that is plausible by itself: it may still
        show low pressure, which counts, and says nothing where it shows none.
        """
        s, doubted_bar = self.state, self._doubted(PRESSURE, now_ns)
        found = [bar for bar in (self.value(PRESSURE), self.supply_bar(now_ns)) if bar is not None]
        if found:
            return OilEvidence(min(found), len(found) == 2 or now_ns - s.both_ns >= ALONE_NS)
        doubted = [] if doubted_bar is None else [doubted_bar]
        if s.supply_doubted_bar is not None and now_ns - s.supply_ns <= self._age_max_ns:
            doubted.append(s.supply_doubted_bar)
        return OilEvidence(min(doubted, default=None), whole=False)

    def outlet(self, now_ns: int) -> OilEvidence:
        """The oil outlet where it is OK, else what it shows that it may have come to since then."""
        value = self.value(OIL)
        if value is None:
            return OilEvidence(self._doubted(OIL, now_ns), False)
        return OilEvidence(value, True)

    def _doubted(self, name: str, now_ns: int) -> float | None:
        """A reading that is not OK, but plausible by itself and within reach of the last one that
        was."""
        reading, row = self.state.readings[name], self.rows[name]
        if not self.state.fresh or not reading.plausible:
            return None
        passed_s = (now_ns - reading.believed_ns) * 1e-9
        from_value = reading.value if reading.believed is None else reading.believed
        within = abs(reading.value - from_value) <= row.noise + row.rate * passed_s
        return reading.value if within else None

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        s = self.state
        return [
            msgspec.structs.replace(alarm.record(), text=s.causes.get(alarm.name, ""))
            for alarm in s.alarms.values()
            if alarm.standing
        ]
