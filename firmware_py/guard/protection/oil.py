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
from firmware_py.guard.alarms.alarm import QUIET_NS, AlarmState, Notice
from firmware_py.guard.plausibility.reading_state import OilEvidence
from firmware_py.machine.lubricant import coldest_outlet_C
from firmware_py.machine.parts import FEED, LUBRICANT, has
from firmware_py.records import Alarm, Severity

GAP_NS: Final = 250_000_000
"""Longer steps are a gap: nothing is known of that time, and the timers hold."""


class Watch(msgspec.Struct, frozen=True):
    """One limit: of what, in which direction it is bad (+1 above, -1 below), and from where
    hysteresis is counted."""

    name: str
    severity: Severity
    quantity: str
    unit: str
    key: str
    sign: float
    limit: float
    reference: float


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
        lim = config.limits
        self._delays_ns = {
            Severity.ALERT: round(lim.alert_delay_s * 1e9),
            Severity.DANGER: round(lim.danger_delay_s * 1e9),
        }
        self._hysteresis = lim.hysteresis_share
        self._watches = _watches(config)
        self.state = OilProtectionState(
            {
                w.name: AlarmState(w.name, int(w.severity), w.severity is Severity.DANGER)
                for w in self._watches
            }
        )
        for name in latched:
            if name in self.state.alarms:
                self.state.alarms[name].standing = True

    def step(
        self, pressure_bar: OilEvidence, outlet_C: OilEvidence, turning: bool, now_ns: int
    ) -> list[Notice]:
        """Judge the lower credible supply pressure and the outlet; None where nothing is credible.

        What is not whole counts where it passes a limit, and ends nothing.
        """
        notices = []
        self.state.turning = turning
        for watch in self._watches:
            alarm = self.state.alarms[watch.name]
            value, whole = pressure_bar if watch.unit == "bar" else outlet_C
            if value is None or now_ns - alarm.judged_ns > GAP_NS:
                alarm.hold(now_ns)
            if value is None:
                continue
            if watch.unit == "bar" and watch.severity is Severity.DANGER and not turning:
                alarm.hold(now_ns)
                alarm.forget()  # a machine at rest needs no oil
                continue
            stood = alarm.standing
            began = alarm.judge(
                watch.sign * (value - watch.reference),
                watch.sign * (watch.limit - watch.reference),
                now_ns,
                delay_ns=self._delays_ns[watch.severity],
                hysteresis=self._hysteresis,
                complete=whole,
                adds_up=True,
            )
            alarm.value, alarm.limit = value, watch.limit
            if began:
                notices.append(
                    Notice(watch.severity, watch.name, self._text(watch), value, watch.limit)
                )
            elif stood and not alarm.standing:
                notices.append(
                    Notice(
                        Severity.INFO,
                        f"{watch.name}_ended",
                        (
                            f"{watch.quantity} {value:.4g} {watch.unit}: back within "
                            f"{watch.limit:.4g}"
                        ),
                        value,
                        watch.limit,
                    )
                )
        return notices

    # ------------------------------------------------------------------ what stands now

    @property
    def tripped(self) -> list[str]:
        """Names of latched danger alarms."""
        return [a.name for a in self.state.alarms.values() if a.latching and a.standing]

    @property
    def beyond(self) -> dict[str, str]:
        """Alarms whose limit is passed now, delay or not, with their text: what bars arming and
        takes authority."""
        return {
            watch.name: self._text(watch)
            for watch in self._watches
            if self.state.alarms[watch.name].over_ns != QUIET_NS
            or self.state.alarms[watch.name].standing
        }

    def timers(self) -> dict[str, int]:
        """How long each danger limit has been exceeded whose delay is not over, ns."""
        return {
            a.name: a.over_ns
            for a in self.state.alarms.values()
            if a.latching and not a.standing and a.over_ns != QUIET_NS
        }

    def resume(self, timers: dict[str, int]) -> None:
        """Go on counting delays that ran when the guard last ended; what is not the oil's is left
        alone."""
        for name, over_ns in timers.items():
            if (alarm := self.state.alarms.get(name)) is not None and alarm.latching:
                alarm.over_ns = over_ns

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        return [
            msgspec.structs.replace(self.state.alarms[watch.name].record(), text=self._text(watch))
            for watch in self._watches
            if self.state.alarms[watch.name].standing
        ]

    def reset(self) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        return [
            f"still beyond its limit: {self._text(watch)}"
            for watch in self._watches
            if self.state.alarms[watch.name].latching and not self.state.alarms[watch.name].reset()
        ]

    def _text(self, watch: Watch) -> str:
        """Cause, value, limit, place and next step."""
        side = "above" if watch.sign > 0.0 else "below"
        step = (
            "check pump, filter and valve"
            if watch.unit == "bar"
            else "check cooler and flow"
            if watch.sign > 0.0
            else "let the oil warm up, or lower the key"
        )
        if watch.unit == "bar" and watch.severity is Severity.ALERT and not self.state.turning:
            step = (
                "the shaft stands, where a pump that is off is no fault; switch it on before the "
                "machine starts"
            )
        return (
            f"{watch.quantity} {self.state.alarms[watch.name].value:.4g} {watch.unit} {side} "
            f"{watch.limit:.4g} "
            f"({watch.key}); {step}"
        )


def _watches(config: Config) -> list[Watch]:
    """Every limit of the oil, in the order in which it is judged.

    Where feed or lubricant are not described, the limits that are written; hysteresis then counts
    from twice the pressure, and from 0 degC.
    """
    machine, lim = config.machine, config.limits
    feed, oil = has(machine, FEED), has(machine, LUBRICANT)
    low_bar, hot_C = config.oil_pressure_limits_bar, config.oil_outlet_limits_C
    most_bar = machine.feed.pressure_max_bar if feed else 2.0 * max(low_bar)
    cold_C = machine.lubricant.inlet_min_C if oil else 0.0
    alert, danger, coldest_C = Severity.ALERT, Severity.DANGER, coldest_outlet_C(machine)
    written = {
        "limits.oil_pressure_low_alert_bar": feed or lim.oil_pressure_low_alert_bar,
        "limits.oil_pressure_low_danger_bar": feed or lim.oil_pressure_low_danger_bar,
        "limits.oil_outlet_high_alert_C": oil or lim.oil_outlet_high_alert_C,
        "limits.oil_outlet_high_danger_C": oil or lim.oil_outlet_high_danger_C,
        "oil.inlet_min_C": oil,
    }
    watches = [
        Watch(
            "oil_pressure_low_alert",
            alert,
            "supply pressure",
            "bar",
            "limits.oil_pressure_low_alert_bar",
            -1.0,
            low_bar[0],
            most_bar,
        ),
        Watch(
            "oil_pressure_low_danger",
            danger,
            "supply pressure",
            "bar",
            "limits.oil_pressure_low_danger_bar",
            -1.0,
            low_bar[1],
            most_bar,
        ),
        Watch(
            "oil_outlet_high_alert",
            alert,
            "oil outlet",
            "degC",
            "limits.oil_outlet_high_alert_C",
            1.0,
            hot_C[0],
            cold_C,
        ),
        Watch(
            "oil_outlet_high_danger",
            danger,
            "oil outlet",
            "degC",
            "limits.oil_outlet_high_danger_C",
            1.0,
            hot_C[1],
            cold_C,
        ),
        Watch(
            "oil_outlet_low_alert",
            alert,
            "oil outlet",
            "degC",
            "oil.inlet_min_C",
            -1.0,
            coldest_C,
            machine.lubricant.film_max_C,
        ),
    ]
    return [watch for watch in watches if written[watch.key]]
