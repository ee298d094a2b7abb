"""Supervision of node, actuator and bus: setpoint and feedback compared, and who speaks."""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

from firmware_py.config import Config
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.envelope.target import Target
from firmware_py.guard.supervision.following import Following, FollowingState, Quantity
from firmware_py.guard.supervision.node_watch import NodeWatch, NodeWatchState, Surroundings
from firmware_py.guard.supervision.standing import Supervised
from firmware_py.machine import ClearanceActuator
from firmware_py.machine.parts import ACTUATOR, has
from firmware_py.machine.supply import slowest_s, slowest_slew_bar_s
from firmware_py.records import Alarm, NodeInfo, NodeState

REPORTS_NS: Final = 100_000_000
"""NODE_STATE and RIG_STATUS come every 50 ms: a target is reported, and its effect measured, up to
so much later."""

LAGS: Final = 3
"""Time constants after which a first-order actuator has arrived within 5 %."""

LAG_LEFT: Final = 0.37
"""What one time constant leaves of a distance."""

UNLIMITED: Final = 1e6
"""Rate, bar/s, of a pressure that says no slew."""


class SupervisionState(msgspec.Struct):
    """The memory of every supervised part (for snapshots)."""

    node: NodeWatchState
    clearance: FollowingState
    pressure: FollowingState
    two_senders: Supervised


class ActuatorReadings(NamedTuple):
    """Readings of a new RIG_STATUS; None where one is not OK, which is an alarm of its own."""

    clearance_um: float | None
    pressure_bar: float | None


class NodeReports(NamedTuple):
    """What one cycle brought from the node, and what is known of it; ``measured`` is None without a
    RIG_STATUS.

    ``resting``: the shaft stands and nothing is commanded, so that the pump may be off.
    """

    states: list[NodeState]
    measured: ActuatorReadings | None
    restarted: bool
    node: NodeState | None
    info: NodeInfo | None
    tick_us: int | None
    two_senders: list[str]
    resting: bool = False


class Supervision:
    """Alarms on a node or an actuator that does not do what it is told.

    Parameters
    ----------
    config
        What the actuator declares, and how large and how long a following error may be.
    session
        Nonce of this run of the device.
    """

    def __init__(self, config: Config, session: int) -> None:
        a = config.machine.actuator
        self._moves = has(config.machine, ACTUATOR)
        self._boot = Target(a.safe_radial_clearance_um, a.safe_pressure_bar)
        self._watch = NodeWatch(config, session)
        lasting_ns = round(a.following_time_s * 1e9)
        self._clearance = Following(
            Quantity(
                "clearance_not_following",
                "um",
                "measured radial clearance",
                a.following_error_um,
                a.rate_um_s,
                REPORTS_NS + round(_lags(a) * a.time_constant_s * 1e9),
                lasting_ns,
            )
        )
        dead_s, lag_s = slowest_s(a)
        self._pressure = Following(
            Quantity(
                "pressure_not_following",
                "bar",
                "measured supply pressure",
                a.following_error_bar,
                slowest_slew_bar_s(a) or UNLIMITED,
                REPORTS_NS + round((dead_s + LAGS * lag_s) * 1e9),
                lasting_ns,
            )
        )
        self._two_senders = Supervised("two_senders")

    @property
    def state(self) -> SupervisionState:
        """The stage's memory."""
        return SupervisionState(
            self._watch.state, self._clearance.state, self._pressure.state, self._two_senders
        )

    @state.setter
    def state(self, state: SupervisionState) -> None:
        self._watch.restore(state.node)
        self._two_senders = state.two_senders
        self._clearance.state, self._pressure.state = state.clearance, state.pressure

    def sent(self, counter: int, target: Target, now_ns: int) -> None:
        """This device has just sent a command."""
        self._watch.sent(counter, target, now_ns)

    def step(self, heard: NodeReports, now_ns: int) -> list[Notice]:
        """Judge what one cycle brought: of a machine without an actuator who sends, and no
        more."""
        notices = self._senders(heard.two_senders, now_ns)
        if not self._moves:
            return notices
        if heard.restarted:
            self._watch.restarted()
        info = heard.info
        boot = Target(info.boot_clearance_um, info.boot_pressure_bar) if info else self._boot
        for state in heard.states:
            notices += self._watch.step(state, Surroundings(boot, heard.tick_us), now_ns)
        if heard.measured is not None:
            notices += self._follow(heard, heard.measured, boot, now_ns)
        return notices

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        return [c.record() for c in self._conditions() if c.standing]

    def _conditions(self) -> list[Supervised]:
        return [
            *self._watch.state.conditions.values(),
            self._clearance.state.alarm,
            self._pressure.state.alarm,
            self._two_senders,
        ]

    @property
    def doubts(self) -> dict[str, str]:
        """Alarms that stand, with what a person is told of them."""
        return {c.name: c.text for c in self._conditions() if c.standing}

    def reset(self) -> None:
        """A person has looked: alarms that stand until then may end."""
        self._clearance.reset()
        self._pressure.reset()

    def _follow(
        self, heard: NodeReports, measured: ActuatorReadings, boot: Target, now_ns: int
    ) -> list[Notice]:
        """Hold a reading against where the actuator may be; a node's own target counts beside the
        commanded one.

        Where those two differ, that is an alarm of its own, and the actuator is right to follow the
        node's.
        """
        node, commanded = heard.node, self._watch.commanded(now_ns, boot)
        told = (
            commanded
            if node is None
            else Target(node.target_clearance_um, node.target_pressure_bar)
        )
        remark = " (boot value: nothing is commanded)" if commanded is boot else ""
        remark += (
            " (the node says that it has arrived)" if node is not None and node.at_target else ""
        )
        notices = []
        for following, value, wanted, reported in (
            (self._clearance, measured.clearance_um, commanded.clearance_um, told.clearance_um),
            (self._pressure, measured.pressure_bar, commanded.pressure_bar, told.pressure_bar),
        ):
            following.target(wanted, now_ns)
            following.target(reported, now_ns)
            excused = heard.resting and following is self._pressure
            notices += (
                [] if value is None else following.step(value, wanted, now_ns, remark, excused)
            )
        return notices

    def _senders(self, streams: list[str], now_ns: int) -> list[Notice]:
        """Two senders of one stream."""
        two = self._two_senders
        if streams and not two.standing:
            return [
                two.begin(
                    now_ns,
                    (
                        f"two senders of {', '.join(streams)} on this bus (counters that do not "
                        f"continue each other); "
                        "disconnect the other node or stop the playback"
                    ),
                )
            ]
        return [two.end(now_ns)] if two.standing and not streams else []


def _lags(actuator: ClearanceActuator) -> int:
    """Time constants by which the clearance may come later than a ramp at the slowest rate.

    Behind a ramp the lag leaves a distance of rate times time constant; the tolerance takes half of
    itself of that.
    """
    count, left_um = 1, actuator.rate_um_s * actuator.time_constant_s
    while left_um > 0.5 * actuator.following_error_um:
        count, left_um = count + 1, left_um * LAG_LEFT
    return count
