"""Groups of measures whose danger votes: what trips, what a missing channel does to the vote, and
the loss of authority by the first danger.

A measure that is not OK leaves the vote: 2oo2 becomes 1oo1, 2oo3 becomes 2oo2.  The strict vote
keeps its number, and says so while it cannot be reached.  While every measure of a group is not OK,
the configured reaction holds.  A danger that is latched votes until it is reset, as in a rack.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.config.measure_types import VOTES, Effect, Group
from firmware_py.config.measures import groups
from firmware_py.guard.alarms.alarm import AlarmState, Notice
from firmware_py.guard.alarms.condition import Condition, ConditionState
from firmware_py.guard.protection.set_points import Ballot
from firmware_py.records import Alarm, Severity

NEVER_NS: Final = -1
LOST_NS: Final = 1_000_000_000
"""So long every measure is not OK before ``all_not_ok = "trip"`` trips."""

FIRST_NS: Final = 3_000_000_000
"""The same, of measures that have not been OK since the guard started."""


class GroupState(msgspec.Struct):
    """The latched trip of a group, whether all of it is not OK and since when, whether one was ever
    OK, and whether its vote cannot be reached."""

    trip: AlarmState
    not_ok: ConditionState = msgspec.field(default_factory=ConditionState)
    defeated: ConditionState = msgspec.field(default_factory=ConditionState)
    lost_ns: int = NEVER_NS
    seen: bool = False


class GroupVote:
    """The vote of one group.

    Parameters
    ----------
    group
        Its measures and its vote.
    latched
        Names of trips that stood latched when the guard last ended.
    """

    def __init__(self, group: Group, latched: list[str]) -> None:
        self.group, self._vote = group, VOTES[group.vote]
        self._not_ok = Condition(f"{group.name}_not_ok", f"{group.name}_ok")
        self._defeated = Condition(f"{group.name}_defeated", f"{group.name}_votes")
        trip = AlarmState(group.trip, int(Severity.DANGER), latching=True)
        trip.standing = group.trip in latched
        self.state = GroupState(trip, self._not_ok.state, self._defeated.state)

    def restore(self, state: GroupState) -> None:
        """Go on from a snapshot."""
        self.state = state
        self._not_ok.state, self._defeated.state = state.not_ok, state.defeated

    def step(self, ballots: list[Ballot], now_ns: int, *, bypassed: bool = False) -> list[Notice]:
        """Count the votes of the group's measures, in its order; ``bypassed``: there is no vote."""
        counted = [ballot for ballot in ballots if ballot.ok]
        dangers = [ballot.said for ballot in counted if ballot.danger]
        vote, here, trip = self._vote, len(counted), self.state.trip
        needed = vote.needed if vote.strict else min(vote.needed, here)
        names = ", ".join(self.group.measures)
        notices = self._not_ok.step(
            not here and not bypassed,
            f"every measure of {self.group.name} is not OK ({names}): its trip is defeated, and "
            f"all_not_ok = {self.group.all_not_ok.name.lower()} holds; repair the sensors",
            now_ns,
        )
        notices += self._defeated.step(
            0 < here < needed and not bypassed,
            f"{self.group.name} needs {needed} of {names} and {here} is OK: a strict vote does not "
            f"follow, its trip is defeated; repair the sensor",
            now_ns,
        )
        lost = self._lost(bool(here), now_ns)
        blind_trip = lost and self.group.all_not_ok is Effect.TRIP
        voted = blind_trip or (here > 0 and len(dangers) >= needed)
        if bypassed or not voted or trip.standing:
            return notices
        trip.standing, trip.since_ns = True, now_ns
        trip.value, trip.limit = float(len(dangers)), float(needed)
        said = "; ".join(dangers) if dangers else f"none of {names} is OK"
        text = (
            f"{self.group.vote} of {self.group.name}: {len(dangers)} of {here} in danger, {needed} "
            f"needed: {said}; find the cause, then `reset`"
        )
        return [*notices, Notice(Severity.DANGER, trip.name, text, trip.value, trip.limit)]

    def _lost(self, here: bool, now_ns: int) -> bool:
        """Whether every measure has been not OK for longer than a start, or a hitch, takes."""
        s = self.state
        s.seen = s.seen or here
        s.lost_ns = NEVER_NS if here else now_ns if s.lost_ns == NEVER_NS else s.lost_ns
        return not here and now_ns - s.lost_ns >= (LOST_NS if s.seen else FIRST_NS)

    @property
    def acting(self) -> list[tuple[str, Effect, str]]:
        """Alarms of the group that do something now: name, effect, text."""
        s = self.state
        found = []
        if s.not_ok.standing:
            found.append((f"{self.group.name}_not_ok", self.group.all_not_ok, s.not_ok.text))
        if s.defeated.standing:
            found.append((f"{self.group.name}_defeated", Effect.AUTHORITY, s.defeated.text))
        return found

    def standing(self) -> list[Alarm]:
        """Alarms that stand now."""
        trip = self.state.trip
        text = (
            f"{self.group.vote} of {', '.join(self.group.measures)} tripped; find the cause, then "
            f"`reset`"
        )
        latched = [msgspec.structs.replace(trip.record(), text=text)] if trip.standing else []
        return [*latched, *self._not_ok.standing(), *self._defeated.standing()]

    def reset(self, ballots: list[Ballot]) -> list[str]:
        """Clear the latch, or the reason why it stays: a danger of one of its measures, or the loss
        of all that trips."""
        trip = self.state.trip
        stands = [ballot.said for ballot in ballots if ballot.danger]
        if self.group.all_not_ok is Effect.TRIP and self._not_ok.state.standing:
            stands.append(self._not_ok.state.text)
        trip.standing = trip.standing and bool(stands)
        return [f"{trip.name} stands: {'; '.join(stands)}"] if trip.standing else []


class Voting:
    """Every declared group.

    Parameters
    ----------
    config
        The table of measures and its groups.
    latched
        Names of trips that stood latched when the guard last ended.
    """

    def __init__(self, config: Config, latched: list[str]) -> None:
        self._groups = [GroupVote(each, latched) for each in groups(config) if each.declared]

    @property
    def state(self) -> dict[str, GroupState]:
        """The memory of each group, by name (for snapshots)."""
        return {each.group.name: each.state for each in self._groups}

    @state.setter
    def state(self, state: dict[str, GroupState]) -> None:
        for each in self._groups:
            if each.group.name in state:
                each.restore(state[each.group.name])

    @property
    def owned(self) -> frozenset[str]:
        """Names of the trips that are its own."""
        return frozenset(each.group.trip for each in self._groups)

    def step(
        self, ballot: Callable[[str], Ballot], now_ns: int, bypassed: frozenset[str] = frozenset()
    ) -> list[Notice]:
        """Count the votes; ``ballot`` says what a measure says, ``bypassed`` are groups that do not
        vote."""
        notices = list[Notice]()
        for each in self._groups:
            ballots = [ballot(name) for name in each.group.measures]
            notices += each.step(ballots, now_ns, bypassed=each.group.name in bypassed)
        return notices

    @property
    def tripped(self) -> list[str]:
        """Names of latched trips."""
        return [each.group.trip for each in self._groups if each.state.trip.standing]

    @property
    def since_ns(self) -> dict[str, int]:
        """When each trip began."""
        return {each.group.trip: each.state.trip.since_ns for each in self._groups}

    def dangers(self, trip: str) -> tuple[str, ...]:
        """Danger alarms of the measures that vote for a trip."""
        found = (each.group.measures for each in self._groups if each.group.trip == trip)
        return tuple(f"{name}_danger" for names in found for name in names)

    def acting(self) -> Iterable[tuple[str, Effect, str]]:
        """Alarms of groups that do something now."""
        return [found for each in self._groups for found in each.acting]

    def standing(self) -> list[Alarm]:
        """Alarms that stand now."""
        return [alarm for each in self._groups for alarm in each.standing()]

    def reset(self, ballot: Callable[[str], Ballot]) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        return [
            reason
            for each in self._groups
            for reason in each.reset([ballot(name) for name in each.group.measures])
        ]
