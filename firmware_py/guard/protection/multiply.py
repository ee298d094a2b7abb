"""Set-point multiply: in a declared window of speed, for a limited time, set points are higher.

A rotor passes its critical speed with more vibration than it may have in service.  The time is
counted while the speed is inside; once it is used up, the set points hold as configured until the
shaft has fallen below ``reset_rpm``.  An unknown speed multiplies nothing, and the cap by the
clearance stays.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.config.measure_schema import MultiplyConfig
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.alarms.condition import Condition, ConditionState
from firmware_py.records import Alarm, Severity

NEVER_NS: Final = -1


class MultiplyState(msgspec.Struct):
    """Time used in the window, when it was last judged, and what is told."""

    used_ns: int = 0
    step_ns: int = NEVER_NS
    active: ConditionState = msgspec.field(default_factory=ConditionState)
    spent: ConditionState = msgspec.field(default_factory=ConditionState)


class MultiplyWindow:
    """One window.

    Parameters
    ----------
    row
        A row of ``[[multiply]]``, checked.
    """

    def __init__(self, row: MultiplyConfig) -> None:
        self.row = row
        self._most_ns = round((row.max_s or 0.0) * 1e9)
        self._active = Condition(f"{row.name}_active", f"{row.name}_over", Severity.INFO)
        self._spent = Condition(f"{row.name}_spent", f"{row.name}_again", Severity.ALERT)
        self.state = MultiplyState(0, NEVER_NS, self._active.state, self._spent.state)

    def restore(self, state: MultiplyState) -> None:
        """Go on from a snapshot."""
        self.state = state
        self._active.state, self._spent.state = state.active, state.spent

    def step(self, speed_rpm: float | None, now_ns: int) -> list[Notice]:
        """Judge one cycle; None: the speed is not known."""
        s, row = self.state, self.row
        passed_ns = 0 if s.step_ns == NEVER_NS else now_ns - s.step_ns
        s.step_ns = now_ns
        if speed_rpm is not None and speed_rpm < (row.reset_rpm or 0.0):
            s.used_ns = 0
        inside = speed_rpm is not None and row.from_rpm <= speed_rpm <= row.to_rpm
        if inside:
            s.used_ns = min(s.used_ns + passed_ns, self._most_ns)
        spent = s.used_ns >= self._most_ns
        names, window = ", ".join(row.measures), f"{row.from_rpm:g} .. {row.to_rpm:g} rpm"
        notices = self._active.step(
            inside and not spent,
            f"set points of {names} are multiplied by {row.factor:g} in {window} for at most "
            f"{row.max_s:g} s; the cap by the clearance holds",
            now_ns,
        )
        return notices + self._spent.step(
            inside and spent,
            f"{row.max_s:g} s in {window} are used up: set points of {names} hold as configured "
            f"until the shaft is below {row.reset_rpm:g} rpm",
            now_ns,
        )

    @property
    def factor(self) -> float:
        """By what its set points are multiplied now."""
        return self.row.factor if self.state.active.standing else 1.0

    def standing(self) -> list[Alarm]:
        """What is told now."""
        return [*self._active.standing(), *self._spent.standing()]


class Multiply:
    """Every window.

    Parameters
    ----------
    config
        Table ``[[multiply]]``.
    """

    def __init__(self, config: Config) -> None:
        self._windows = [MultiplyWindow(row) for row in config.multiply]

    @property
    def state(self) -> dict[str, MultiplyState]:
        """The memory of each window, by name (for snapshots)."""
        return {each.row.name: each.state for each in self._windows}

    @state.setter
    def state(self, state: dict[str, MultiplyState]) -> None:
        for each in self._windows:
            if each.row.name in state:
                each.restore(state[each.row.name])

    def step(self, speed_rpm: float | None, now_ns: int) -> list[Notice]:
        """Judge one cycle; None: the speed is not known."""
        return [notice for each in self._windows for notice in each.step(speed_rpm, now_ns)]

    @property
    def factors(self) -> dict[str, float]:
        """By what the set points of each measure are multiplied now; a measure in two windows at
        once has the lower factor."""
        found: dict[str, float] = {}
        for each in self._windows:
            if each.factor != 1.0:
                for name in each.row.measures:
                    found[name] = min(found.get(name, each.factor), each.factor)
        return found

    def standing(self) -> list[Alarm]:
        """What is told now."""
        return [alarm for each in self._windows for alarm in each.standing()]
