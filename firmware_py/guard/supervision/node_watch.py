"""Does the node do what it is told, and nothing else?  Judged on each NODE_STATE, confirmed by
several."""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.envelope.target import Target
from firmware_py.guard.supervision.recent import ENTRIES, Span, extremes, note
from firmware_py.guard.supervision.standing import Confirmation, Supervised
from firmware_py.records import NodeMode, NodeState

LATENCY_NS: Final = 250_000_000
"""Longest honest time from sending a command to hearing of it: bus, the node's cycle of 10 ms,
NODE_STATE every 50 ms, and three of those lost."""

CONFIRM_REPORTS: Final = 3
CONFIRM_NS: Final = 150_000_000
"""A doubt is confirmed by so many reports over this time, and by more where good ones come
between."""

DISMISS_NS: Final = 500_000_000
"""A confirmed doubt is dismissed by reports without it over this time: what comes and goes
stands."""

REFUSALS: Final = 3
REFUSALS_NS: Final = 5_000_000_000
"""So many refused commands within this time: two may be lost to one disturbance of the bus."""

TICK_AGE_MAX_US: Final = 500_000
"""A NODE_STATE may speak of an instant this far from the newest sample: ten of its periods."""

CLEARANCE_STEP_UM: Final = 0.02
PRESSURE_STEP_BAR: Final = 0.002
"""Two steps of the wire: targets that differ by no more are equal."""

_TICKS: Final = 1 << 32
_COUNTERS: Final = 1 << 16
_REFUSED: Final = ("stale", "check", "session", "range")

CONDITIONS: Final = (
    "node_elsewhere",
    "node_not_expired",
    "node_not_following",
    "node_target_differs",
    "node_counter_frozen",
    "node_refuses",
    "node_state_frozen",
)
"""What is judged, by the name of its alarm."""


class Refusals(msgspec.Struct, array_like=True):
    """The node's four refusal counters as they stood at ``t_ns``."""

    t_ns: int
    counts: tuple[int, int, int, int]


class Sent(msgspec.Struct, array_like=True, gc=False):
    """A command's counter, and when it was sent."""

    t_ns: int
    counter: int


class NodeWatchState(msgspec.Struct):
    """What was sent lately, and the conditions with their confirmations."""

    conditions: dict[str, Supervised]
    doubted: dict[str, Confirmation]
    cleared: dict[str, Confirmation]
    clearances: list[Span] = []
    pressures: list[Span] = []
    sent_ns: int = -1
    since_ns: int = -1
    counter: int = 0
    count: int = 0
    target: Target | None = None
    refusals: list[Refusals] = []
    marks: list[Sent] = []


class Surroundings(NamedTuple):
    """What else a NODE_STATE is judged by: the node's boot values, and the newest sample's tick
    where it is fresh."""

    boot: Target
    tick_us: int | None


class NodeWatch:
    """Supervises the node's own account of itself.

    Parameters
    ----------
    config
        Time to live and retreat value.
    session
        Nonce of this run of the device.
    """

    def __init__(self, config: Config, session: int) -> None:
        self._session = session
        self._ttl_ns = config.machine.actuator.time_to_live_ms * 1_000_000
        self._window_ns = self._ttl_ns + LATENCY_NS
        self.state = NodeWatchState(
            {name: Supervised(name) for name in CONDITIONS},
            {name: Confirmation() for name in CONDITIONS},
            {name: Confirmation() for name in CONDITIONS},
        )

    def restore(self, state: NodeWatchState) -> None:
        """Go on from a snapshot; conditions that an earlier version did not judge begin anew."""
        fresh, self.state = self.state, state
        state.conditions = fresh.conditions | state.conditions
        state.doubted, state.cleared = fresh.doubted | state.doubted, fresh.cleared | state.cleared

    def sent(self, counter: int, target: Target, now_ns: int) -> None:
        """This device has just sent a command."""
        s = self.state
        if s.sent_ns < 0 or now_ns - s.sent_ns > self._ttl_ns:
            s.since_ns, s.refusals = now_ns, []
        s.sent_ns, s.counter, s.target = now_ns, counter, target
        s.count += 1
        note(s.clearances, now_ns, target.clearance_um, self._window_ns)
        note(s.pressures, now_ns, target.pressure_bar, self._window_ns)
        while len(s.marks) > 1 and s.marks[1].t_ns <= now_ns - self._window_ns:
            del s.marks[0]
        if not s.marks or now_ns - s.marks[-1].t_ns >= self._window_ns // ENTRIES:
            s.marks.append(Sent(now_ns, counter))

    def commanded(self, now_ns: int, boot: Target) -> Target:
        """Where a node that does its duty is going now."""
        s = self.state
        return boot if s.target is None or now_ns - s.sent_ns > self._ttl_ns else s.target

    def restarted(self) -> None:
        """The node has started again: its counters begin anew."""
        self.state.refusals = []

    def step(self, node: NodeState, around: Surroundings, now_ns: int) -> list[Notice]:
        """Judge one report."""
        notices = []
        doubts = self._doubts(node, around, now_ns)
        for name, condition in self.state.conditions.items():
            notices += self._judge(condition, doubts.get(name), now_ns)
        return notices

    # ------------------------------------------------------------------ one report

    def _judge(self, condition: Supervised, doubt: str | None, now_ns: int) -> list[Notice]:
        """Begin ``condition`` once enough reports say so, end it after a while without."""
        s, name = self.state, condition.name
        if doubt is None:
            s.doubted[name].against(CONFIRM_REPORTS)
            if condition.standing and s.cleared[name].again(now_ns, CONFIRM_REPORTS, DISMISS_NS):
                s.doubted[name].clear()
                return [condition.end(now_ns)]
            return []
        s.cleared[name].clear()
        if not condition.standing and s.doubted[name].again(now_ns, CONFIRM_REPORTS, CONFIRM_NS):
            return [condition.begin(now_ns, doubt)]
        return []

    def _doubts(self, node: NodeState, around: Surroundings, now_ns: int) -> dict[str, str]:
        """What this report says that it should not, by condition."""
        s = self.state
        doubts: dict[str, str] = {}
        active = s.sent_ns >= 0 and now_ns - s.sent_ns <= self._window_ns
        commanding = (
            active and now_ns - s.sent_ns < self._ttl_ns // 2
        )  # later its time to live may be over
        following = node.mode == NodeMode.FOLLOWING
        if following and (strange := self._never_sent(node)):
            doubts["node_elsewhere"] = strange
        elif following and not active:
            doubts["node_not_expired"] = (
                f"node follows this device's last command for more than "
                f"{self._window_ns * 1e-6:.0f} ms after it: "
                f"its time to live ({self._ttl_ns * 1e-6:.0f} ms) does not work; repair the node "
                f"before arming"
            )
        elif not following and commanding and now_ns - s.since_ns > self._window_ns:
            doubts["node_not_following"] = (
                f"node stays SAFE while this device has commanded for "
                f"{(now_ns - s.since_ns) * 1e-9:.1f} s; refused: "
                f"{_counts(node)}; look at the node and its clock"
            )
        else:
            self._hold_against(node, around.boot, doubts)
        if following and "node_elsewhere" not in doubts and (old := self._too_old(node, now_ns)):
            doubts["node_counter_frozen"] = old
        if active and (grown := self._grown(node, now_ns)):
            doubts["node_refuses"] = (
                f"node refused {grown} commands of this device within {REFUSALS_NS * 1e-9:g} s "
                f"(limit "
                f"{REFUSALS - 1}); stale: clock or link delay, check: bus errors, session: another "
                f"device, "
                "range: the actuator's own range"
            )
        if around.tick_us is not None:
            age_us = (around.tick_us - node.tick_us + _TICKS // 2) % _TICKS - _TICKS // 2
            if abs(age_us) > TICK_AGE_MAX_US:
                doubts["node_state_frozen"] = (
                    f"NODE_STATE speaks of an instant {age_us * 1e-6:.3f} s before the newest "
                    f"sample (limit "
                    f"{TICK_AGE_MAX_US * 1e-6:g}); restart the node"
                )
        return doubts

    def _never_sent(self, node: NodeState) -> str:
        """Why the node cannot follow this device's commands; empty when it may.

        A command counter of 0 is taken for none: a node that has just begun to follow may not
        report it yet.
        """
        if node.session != self._session:
            return (
                f"node follows session {node.session:#010x}, not this device's "
                f"{self._session:#010x}; wait until "
                "it lets go or disconnect the other device"
            )
        s, counter = self.state, node.command_counter
        if counter and (s.counter - counter) % _COUNTERS >= min(s.count, _COUNTERS // 2):
            return (
                f"node follows command {counter} of this device's session; the newest that was "
                f"sent is "
                f"{s.counter}; somebody else commands in its name: disconnect the other sender"
            )
        return ""

    def _too_old(self, node: NodeState, now_ns: int) -> str:
        """Why the command that the node says it follows is too old to be in force; empty when it is
        not.

        A node that has just begun to follow may not report a counter yet.
        """
        s, counter = self.state, node.command_counter
        begins = not counter and now_ns - s.since_ns <= self._window_ns
        if not s.marks or begins:
            return ""
        behind = (s.counter - counter) % _COUNTERS
        if behind <= (s.counter - s.marks[0].counter) % _COUNTERS:
            return ""
        return (
            f"node follows command {counter}, the newest that was sent is {s.counter}: "
            f"{behind} behind, more than {self._window_ns * 1e-6:.0f} ms, while it says that it "
            f"obeys; its command counter stands still: restart or repair the node"
        )

    def _hold_against(self, node: NodeState, boot: Target, doubts: dict[str, str]) -> None:
        """Compare the reported target with what was sent, or with the boot value in mode SAFE."""
        s = self.state
        clearances, pressures = (
            (boot.clearance_um, boot.clearance_um),
            (boot.pressure_bar, boot.pressure_bar),
        )
        if node.mode == NodeMode.FOLLOWING:
            clearances, pressures = extremes(s.clearances), extremes(s.pressures)
        for what, unit, told, (low, high), step in (
            ("clearance", "um", node.target_clearance_um, clearances, CLEARANCE_STEP_UM),
            ("pressure", "bar", node.target_pressure_bar, pressures, PRESSURE_STEP_BAR),
        ):
            if not low - step <= told <= high + step:
                wanted = f"{low:.4g}" if low == high else f"{low:.4g} .. {high:.4g}"
                doubts["node_target_differs"] = (
                    f"node reports a target {what} of {told:.4g} {unit}, commanded {wanted}"
                    f"{'' if node.mode else ' (boot value, mode SAFE)'}; compare the node's own "
                    f"range with "
                    "the configuration"
                )

    def _grown(self, node: NodeState, now_ns: int) -> str:
        """Refusal counters that have grown too much lately, in words; empty when none has."""
        s = self.state
        counts = (node.refused_stale, node.refused_check, node.refused_session, node.refused_range)
        while len(s.refusals) > 1 and s.refusals[1].t_ns <= now_ns - REFUSALS_NS:
            del s.refusals[0]
        if not s.refusals:
            s.refusals.append(Refusals(now_ns, counts))
        growth = [
            (new - old) % _COUNTERS for new, old in zip(counts, s.refusals[0].counts, strict=True)
        ]
        if (
            max(growth) >= _COUNTERS // 2
        ):  # counters that fell: another node, or the same after a restart
            s.refusals = [Refusals(now_ns, counts)]
            return ""
        if now_ns - s.refusals[-1].t_ns >= REFUSALS_NS // 8:
            s.refusals.append(Refusals(now_ns, counts))
        if sum(growth) < REFUSALS:
            return ""
        return ", ".join(
            f"{count} {name}" for name, count in zip(_REFUSED, growth, strict=True) if count
        )


def _counts(node: NodeState) -> str:
    return (
        f"{node.refused_stale} stale, {node.refused_check} check, {node.refused_session} session, "
        f"{node.refused_range} range"
    )
