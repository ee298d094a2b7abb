"""Protection of the oil: low supply pressure, high outlet temperature; alert, danger that trips,
and a permissive.

The pressure is the lower of what RIG_STATUS and the channel ``supply_pressure`` show, where they
are OK: a bearing without oil is lost in seconds.  A reading that is not OK holds the timers: it
neither trips nor resets one.  While a source is missing or doubted, what is seen low still counts,
and what is not does not end it; times beyond a limit add up where the value comes back between.
Danger of low pressure is judged while the shaft turns; a machine at rest may have its pump off.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.config.measure_types import Effect, JudgedWhile, Measure, SetPoint
from firmware_py.config.measures import OUTLET_HIGH, OUTLET_LOW, PRESSURE_LOW, oil, voted
from firmware_py.guard.alarms.alarm import AlarmState, Notice
from firmware_py.guard.plausibility.reading_state import OilEvidence
from firmware_py.guard.protection.set_points import Ballot, SetPointAlarms
from firmware_py.records import Alarm, Severity

GAP_NS: Final = 250_000_000
"""Longer steps are a gap: nothing is known of that time, and the timers hold."""

STEPS: Final = {
    PRESSURE_LOW: "check pump, filter and valve",
    OUTLET_HIGH: "check cooler and flow",
    OUTLET_LOW: "let the oil warm up, or lower the key",
}
"""What a person does, by the measure."""


class OilProtectionState(msgspec.Struct):
    """Alarms by name (for snapshots)."""

    alarms: dict[str, AlarmState]
    turning: bool = True


class OilProtection:
    """Alarms of the oil.

    Parameters
    ----------
    config
        Table ``[limits]``, feed and oil.
    latched
        Names of danger alarms that stood latched when the guard last ended; what is not the oil's
        is left alone.
    """

    def __init__(self, config: Config, latched: list[str]) -> None:
        self._set = SetPointAlarms(oil(config), voted(config.group))
        self._set.latch(latched)
        self._known = dict.fromkeys((each.name for each in self._set.measures.values()), False)
        self._state = OilProtectionState(self._set.states)

    @property
    def state(self) -> OilProtectionState:
        """The stage's memory (for snapshots)."""
        return self._state

    @state.setter
    def state(self, state: OilProtectionState) -> None:
        self._state, self._set.states = state, state.alarms

    @property
    def set_points(self) -> SetPointAlarms:
        """Its set points, and their alarms."""
        return self._set

    def step(
        self, pressure_bar: OilEvidence, outlet_C: OilEvidence, turning: bool, now_ns: int
    ) -> list[Notice]:
        """Judge the lower credible supply pressure and the outlet; None where nothing is credible.

        What is not whole counts where it passes a limit, and ends nothing.
        """
        notices = []
        self._state.turning = turning
        for name, point in self._set.points.items():
            measure, alarm = self._set.measures[name], self._set.states[name]
            value, whole = pressure_bar if measure.name == PRESSURE_LOW else outlet_C
            self._known[measure.name] = value is not None
            if value is None or now_ns - alarm.judged_ns > GAP_NS:
                alarm.hold(now_ns)
            if value is None:
                continue
            if point.judged is JudgedWhile.TURNING and not turning:
                alarm.hold(now_ns)
                alarm.forget()  # a machine at rest needs no oil
                continue
            stood = alarm.standing
            began = self._set.judge(measure, point, value, now_ns, complete=whole, adds_up=True)
            if began:
                notices.append(
                    Notice(point.severity, name, self._text(measure, point), value, point.limit)
                )
            elif stood and not alarm.standing:
                notices.append(
                    Notice(
                        Severity.INFO,
                        f"{name}_ended",
                        (
                            f"{measure.quantity} {value:.4g} {measure.unit}: back within "
                            f"{point.limit:.4g}"
                        ),
                        value,
                        point.limit,
                    )
                )
        return notices

    # ------------------------------------------------------------------ what stands now

    @property
    def tripped(self) -> list[str]:
        """Names of latched danger alarms that trip."""
        return self._set.tripped()

    def ballot(self, measure: str) -> Ballot:
        """The vote of a measure: one of which nothing is known is not OK."""
        return self._set.ballot(measure, self._known[measure])

    @property
    def beyond(self) -> dict[str, str]:
        """Alarms whose limit is passed now, delay or not, with their text: what bars arming and
        takes authority."""
        return {
            name: self._text(self._set.measures[name], point)
            for name, point in self._set.points.items()
            if point.effect >= Effect.AUTHORITY and self._set.passed(name)
        }

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        return [
            msgspec.structs.replace(alarm.record(), text=self._said(alarm.name))
            for alarm in self._set.shown()
        ]

    def reset(self) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        return [f"still beyond its limit: {self._said(alarm.name)}" for alarm in self._set.reset()]

    def _said(self, name: str) -> str:
        return self._text(self._set.measures[name], self._set.points[name])

    def _text(self, measure: Measure, point: SetPoint) -> str:
        """Cause, value, limit, place and next step."""
        side = "above" if measure.sign > 0.0 else "below"
        step = STEPS[measure.name]
        alert = point.severity is Severity.ALERT
        if measure.name == PRESSURE_LOW and alert and not self._state.turning:
            step = (
                "the shaft stands, where a pump that is off is no fault; switch it on before the "
                "machine starts"
            )
        return (
            f"{measure.quantity} {self._set.states[point.alarm].value:.4g} {measure.unit} {side} "
            f"{point.limit:.4g} "
            f"({point.key}); {step}"
        )
