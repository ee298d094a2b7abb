"""Bypass of a measure or a group by a person, and shelving of alarms.

A bypass has an owner, a reason and an end.  While one stands, the danger of its measures is not
judged and does not vote, authority is off, and the retreat value holds.  It refuses to take the
last vote of a group.  After a restart of the guard nothing is bypassed.  Shelving changes only what
is displayed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.config.measure_types import Group
from firmware_py.config.measures import groups, may_bypass
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.protection.set_points import Ballot
from firmware_py.records import Alarm, CommandRequest, Severity

LONGEST_S: Final = 12 * 3600.0
"""A bypass lasts a shift at most; who needs it longer says so again."""

SHELVED_MAX: Final = 64
"""Shelved alarms at once."""


class BypassState(msgspec.Struct):
    """One bypass: of what, by whom, why, since when and until when."""

    target: str
    owner: str
    reason: str
    since_ns: int
    until_ns: int


class BypassesState(msgspec.Struct):
    """Bypasses, and until when alarms are shelved."""

    bypasses: list[BypassState] = []
    shelved: dict[str, int] = {}


class Bypasses:
    """What people have bypassed and shelved.

    Parameters
    ----------
    config
        Which measures and groups may be bypassed.
    """

    def __init__(self, config: Config) -> None:
        self._groups = {each.name: each for each in groups(config) if each.declared}
        self._allowed = may_bypass(config)
        self.state = BypassesState([], {})

    def step(self, now_ns: int) -> list[Notice]:
        """End what is over."""
        s = self.state
        over = [each for each in s.bypasses if now_ns >= each.until_ns]
        s.bypasses = [each for each in s.bypasses if now_ns < each.until_ns] if over else s.bypasses
        if any(now_ns >= until_ns for until_ns in s.shelved.values()):
            s.shelved = {name: t_ns for name, t_ns in s.shelved.items() if now_ns < t_ns}
        return [
            Notice(
                Severity.ALERT, f"{each.target}_bypass_over",
                f"the bypass of {each.target} by {each.owner} has ended; it is judged again",
            )
            for each in over
        ]  # fmt: skip

    @property
    def measures(self) -> frozenset[str]:
        """Measures whose danger is not judged now."""
        return frozenset(
            name for each in self.state.bypasses for name in self._members(each.target)
        )

    @property
    def groups(self) -> frozenset[str]:
        """Groups that are bypassed as a whole."""
        return frozenset(each.target for each in self.state.bypasses if each.target in self._groups)

    @property
    def said(self) -> dict[str, str]:
        """Every bypass in words, by its alarm."""
        return {
            f"{each.target}_bypassed": f"{each.target} is bypassed by {each.owner}: {each.reason}"
            for each in self.state.bypasses
        }

    def standing(self) -> list[Alarm]:
        """An alarm for each bypass."""
        said = self.said
        return [
            Alarm(
                name, int(Severity.ALERT), each.since_ns, 0.0, 0.0, False,
                f"{said[name]}; it ends {(each.until_ns - each.since_ns) * 1e-9:g} s after its "
                f"beginning",
            )
            for each in self.state.bypasses
            for name in [f"{each.target}_bypassed"]
        ]  # fmt: skip

    # ------------------------------------------------------------------ requests

    def request(
        self, request: CommandRequest, now_ns: int, ballot: Callable[[str], Ballot]
    ) -> list[str]:
        """Begin, change or end (value 0) a bypass; the reasons why not."""
        s, target = self.state, request.target
        if request.value == 0.0:
            left = [each for each in s.bypasses if each.target != target]
            if len(left) == len(s.bypasses):
                return [f"bypass: {target} is not bypassed"]
            s.bypasses = left
            return []
        reasons = self._refused(request, ballot)
        if reasons:
            return reasons
        until_ns = now_ns + round((request.value or 0.0) * 1e9)
        own = BypassState(target, request.owner, request.reason, now_ns, until_ns)
        s.bypasses = [*(each for each in s.bypasses if each.target != target), own]
        return []

    def shelve(self, request: CommandRequest, now_ns: int) -> list[str]:
        """Shelve an alarm for so long, or not any more (value 0); the reasons why not."""
        s, seconds = self.state, request.value
        others = {name: t for name, t in s.shelved.items() if name != request.target}
        if seconds == 0.0:
            s.shelved = others
            return []
        if not request.target:
            return ["shelve: names no alarm; give its name"]
        if seconds is None or not 1.0 <= seconds <= LONGEST_S:
            return [f"shelve: {_shown(seconds)} s, allowed are 1 .. {LONGEST_S:g}"]
        if len(others) >= SHELVED_MAX:
            return [f"shelve: {SHELVED_MAX} alarms are shelved already; end one"]
        s.shelved = others | {request.target: now_ns + round(seconds * 1e9)}
        return []

    def _refused(self, request: CommandRequest, ballot: Callable[[str], Ballot]) -> list[str]:
        target, seconds, reasons = request.target, request.value, list[str]()
        if target not in self._allowed:
            known = ", ".join(self._allowed) or "none"
            reasons.append(
                f"bypass: {target or 'nothing'} may not be bypassed, may_bypass is set for: {known}"
            )
        for word, text in (("owner", request.owner), ("reason", request.reason)):
            if not text.strip():
                reasons.append(f"bypass: no {word}; a bypass has an owner, a reason and an end")
        if seconds is None or not 1.0 <= seconds <= LONGEST_S:
            reasons.append(f"bypass: an end in {_shown(seconds)} s, allowed are 1 .. {LONGEST_S:g}")
        group = next((g for g in self._groups.values() if target in g.measures), None)
        if group is not None and not self._left(group, target, ballot):
            reasons.append(
                f"bypass: {target} is the last of {group.name} that votes; bypass the group, "
                f"where it may be"
            )
        return reasons

    def _left(self, group: Group, target: str, ballot: Callable[[str], Ballot]) -> bool:
        """Whether a measure of the group still votes without ``target``."""
        out = self.measures | {target}
        return any(ballot(name).ok for name in group.measures if name not in out)

    def _members(self, target: str) -> tuple[str, ...]:
        group = self._groups.get(target)
        return group.measures if group else (target,)


def _shown(seconds: float | None) -> str:
    return "no" if seconds is None else f"{seconds:g}"
