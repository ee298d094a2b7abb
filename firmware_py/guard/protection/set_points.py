"""The alarms of the set points of some measures: the one way in which a value is held against a
limit, latches, trips, and is kept over a restart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import inf
from typing import NamedTuple

from firmware_py.config.added_measures import SMAX_SHARE
from firmware_py.config.measure_types import Effect, Measure, SetPoint
from firmware_py.guard.alarms.alarm import QUIET_NS, AlarmState
from firmware_py.records import Severity


class Ballot(NamedTuple):
    """What a measure says to its group: whether it is OK, whether its danger stands, and that in
    words."""

    ok: bool
    danger: bool
    said: str


def in_force(measure: Measure, *, factor: float = 1.0, cap: float = inf) -> list[float]:
    """Set points as they hold now: multiplied, and where they are capped the highest at most
    ``cap``, the others with it."""
    limits = [point.limit * factor for point in measure.points]
    if not measure.capped:
        return limits
    capped = min(limits[-1], cap)
    return [*(each * (capped / limits[-1]) for each in limits[:-1]), capped]


def cap_um(measure: Measure, share: float, clearance_um: float) -> float:
    """What the highest set point of a capped measure is at most in a radial clearance, with
    ``limits.clearance_share``."""
    return (SMAX_SHARE if measure.kind == "smax" else 1.0) * share * clearance_um


class SetPointAlarms:
    """Alarms by name; their states are the stage's (for snapshots).

    Parameters
    ----------
    measures
        Whose set points these are.
    voted
        Names of measures whose danger trips by the vote of a group alone.
    """

    def __init__(self, measures: Sequence[Measure], voted: frozenset[str] = frozenset()) -> None:
        self.points = {point.alarm: point for each in measures for point in each.points}
        self.measures = {point.alarm: each for each in measures for point in each.points}
        self._voted = voted
        self._dangers = {
            self.measures[name].name: name
            for name, point in self.points.items()
            if point.severity is Severity.DANGER
        }
        self._bound = frozenset(
            name
            for name, point in self.points.items()
            if point.effect is not Effect.TRIP or self.measures[name].name in voted
        )
        self.bypassed: frozenset[str] = frozenset()
        self.factors: dict[str, float] = {}
        self._acting = tuple(
            name
            for name, point in self.points.items()
            if self._votes(name) or Effect.AUTHORITY <= point.effect < Effect.TRIP
        )
        self._told_only = frozenset(
            name for name, point in self.points.items() if point.effect is Effect.EVENT
        )
        self.states = {
            name: AlarmState(name, int(point.severity), point.latching)
            for name, point in self.points.items()
        }

    def latch(self, names: Iterable[str], *, unknown: bool = False) -> None:
        """Dangers that stood latched when the guard last ended stand again; ``unknown``: one that
        this version does not judge as well, until somebody resets it."""
        for name in names:
            if unknown:
                self.states.setdefault(name, AlarmState(name, int(Severity.DANGER), latching=True))
            if name in self.states:
                self.states[name].standing = True

    def judge(
        self,
        measure: Measure,
        point: SetPoint,
        value: float,
        t_ns: int,
        *,
        limit: float | None = None,
        complete: bool = True,
        adds_up: bool = False,
    ) -> bool:
        """Hold ``value`` against a set point at ``t_ns``; True when its alarm begins to stand.

        ``limit`` is the set point in force, where it is not the configured one.
        """
        limit = point.limit if limit is None else limit
        alarm = self.states[point.alarm]
        if measure.name in self.bypassed and point.severity is Severity.DANGER:
            self.leave(alarm, t_ns)
            return False
        bad, most = measure.sign * (value - measure.reference), limit - measure.reference
        most = measure.sign * most
        if point.low is not None:  # a window: how far from its middle
            middle = 0.5 * (limit + point.low)
            bad, most = abs(value - middle), limit - middle
            limit = limit if value >= middle else point.low
        began = alarm.judge(
            bad,
            most,
            t_ns,
            delay_ns=point.delay_ns,
            hysteresis=measure.hysteresis,
            complete=complete,
            adds_up=adds_up,
        )
        alarm.value, alarm.limit = value, limit
        return began

    def bypass(self, measures: frozenset[str]) -> None:
        """The danger of ``measures`` is not judged now: its timers begin anew, and a latched alarm
        stays until it is reset."""
        self.bypassed = measures
        for name in measures:
            alarm = self.states.get(self._dangers.get(name, ""))
            if alarm is not None:
                alarm.forget()

    def factor(self, measure: Measure) -> float:
        """By what its set points are multiplied now."""
        return self.factors.get(measure.name, 1.0)

    def leave(self, alarm: AlarmState, t_ns: int) -> None:
        """A set point is not to be judged now: its timer begins anew, and its alarm ends unless it
        is latched."""
        alarm.hold(t_ns)
        alarm.forget()
        alarm.standing = alarm.standing and alarm.latching

    # ------------------------------------------------------------------ what stands now

    def shown(self) -> list[AlarmState]:
        """Alarms that stand and are more than an event."""
        return [a for a in self.states.values() if a.standing and a.name not in self._told_only]

    def latched(self) -> list[str]:
        """Names of all latched alarms, whatever they do: kept over a restart."""
        return [a.name for a in self.states.values() if a.latching and a.standing]

    def tripped(self) -> list[str]:
        """Names of latched alarms that trip by themselves."""
        return [name for name in self.latched() if name not in self._bound]

    def passed(self, name: str) -> bool:
        """Whether a limit is passed now, delay or not, or its alarm stands."""
        alarm = self.states[name]
        return alarm.standing or alarm.over_ns != QUIET_NS

    def acting(self) -> Iterator[tuple[str, Effect]]:
        """Alarms that do something before, or without, a trip of their own: those that stand and
        take authority or retreat, and dangers that vote, from the first moment on."""
        for name in self._acting:
            if self.passed(name) if self._votes(name) else self.states[name].standing:
                yield name, self.points[name].effect

    def ballot(self, measure: str, ok: bool) -> Ballot:
        """The vote of ``measure``, which is OK or not."""
        name = self._dangers[measure]
        danger = self.states[name].standing
        return Ballot(
            ok and measure not in self.bypassed, danger, self.said(name) if danger else ""
        )

    def may_vote(self, measure: str) -> bool:
        """Whether ``measure`` is one of its own, and has a danger."""
        return measure in self._dangers

    def said(self, name: str) -> str:
        """What is passed, for people: value, set point, and the place of the key."""
        measure, point, alarm = self.measures[name], self.points[name], self.states[name]
        side = "above" if measure.sign > 0.0 else "below"
        side = side if point.low is None else "outside"
        word = point.severity.name.lower()
        return (
            f"{measure.name} ({measure.quantity}) {alarm.value:.4g} {measure.unit}, {word} {side} "
            f"{alarm.limit:.4g} ({point.key})"
        )

    def _votes(self, name: str) -> bool:
        measure = self.measures[name].name
        return measure in self._voted and self.points[name].severity is Severity.DANGER

    # ------------------------------------------------------------------ over a restart, and resets

    def timers(self) -> dict[str, int]:
        """How long each danger limit has been exceeded whose delay is not over, ns."""
        return {
            a.name: a.over_ns
            for a in self.states.values()
            if a.severity == Severity.DANGER and not a.standing and a.over_ns != QUIET_NS
        }

    def resume(self, timers: dict[str, int]) -> None:
        """Go on counting delays that ran when the guard last ended; what is not its own is left
        alone."""
        for name, over_ns in timers.items():
            alarm = self.states.get(name)
            if alarm is not None and alarm.severity == Severity.DANGER:
                alarm.over_ns = over_ns

    def reset(self) -> list[AlarmState]:
        """Clear the latches; the alarms that stay, for their limit is still passed."""
        return [a for a in self.states.values() if a.latching and not a.reset()]
