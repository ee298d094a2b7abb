"""Slow readings that no law rests on: an alarm for each that is not OK, by its name and range.

What the standard readings can be, and what their loss does, is
:mod:`firmware_py.guard.plausibility.readings`.
"""

from __future__ import annotations

from firmware_py import signals
from firmware_py.acquire.slow_pages import doubt_of
from firmware_py.config import Config
from firmware_py.config.instances import slow_signals
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.condition import Condition, ConditionState
from firmware_py.records import Alarm, RigReading, Severity


class MoreReadings:
    """Judges the readings beside the standard ones.

    Parameters
    ----------
    config
        Which there are, and their ranges.
    """

    def __init__(self, config: Config) -> None:
        self._rows = [
            row for row in slow_signals(config) if row.name not in signals.STANDARD_READING
        ]
        self._conditions = {
            row.name: Condition(f"{row.name}_not_ok", f"{row.name}_ok", Severity.ALERT)
            for row in self._rows
        }

    @property
    def state(self) -> dict[str, ConditionState]:
        """Where each alarm stands (for snapshots)."""
        return {name: condition.state for name, condition in self._conditions.items()}

    @state.setter
    def state(self, state: dict[str, ConditionState]) -> None:
        for name, condition in self._conditions.items():
            condition.state = state.get(name, condition.state)

    def step(self, readings: list[RigReading], now_ns: int) -> list[Notice]:
        """Judge the newest of ``readings``, if any."""
        notices: list[Notice] = []
        for row in self._rows if readings else ():
            doubt = doubt_of(row, readings[-1].values.get(row.name))
            text = f"{row.name} {doubt}; check its sensor and cable"
            notices += self._conditions[row.name].step(bool(doubt), text, now_ns)
        return notices

    def standing(self) -> list[Alarm]:
        """Alarms that stand now."""
        return [alarm for each in self._conditions.values() for alarm in each.standing()]
