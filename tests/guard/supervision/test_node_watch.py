"""The node's own account of itself, report by report."""

from collections.abc import Callable

import pytest

from firmware_py.guard.envelope.target import Target
from firmware_py.guard.supervision.node_watch import NodeWatch, Surroundings
from firmware_py.records import NodeMode, NodeState

from ..scripted_node import MS, SESSION, bench

PERIOD_NS = 50 * MS
CONFIG = bench()
BOOT = Target(
    CONFIG.machine.actuator.safe_radial_clearance_um, CONFIG.machine.actuator.safe_pressure_bar
)
SENT = Target(70.0, 1.5)
TTL_NS = CONFIG.machine.actuator.time_to_live_ms * MS


class Watched:
    """A device that commands every period, and a node that reports as often."""

    def __init__(self) -> None:
        self.watch = NodeWatch(CONFIG, SESSION)
        self.now_ns = 10_000 * MS
        self.counter = 0
        self.commanding = True
        self.refused = [0, 0, 0, 0]
        self.period_ns = PERIOD_NS

    def report(self, **changed: object) -> list[str]:
        """One period; ``changed`` is what the report says otherwise than a good node's."""
        self.now_ns += self.period_ns
        if self.commanding:
            self.counter += 1
            self.watch.sent(self.counter, SENT, self.now_ns)
        tick_us = self.now_ns // 1000
        good: dict[str, object] = {
            "counter": 0,
            "tick_us": tick_us % 2**32,
            "mode": NodeMode.FOLLOWING if self.commanding else NodeMode.SAFE,
            "session": SESSION if self.commanding else 0,
            "command_counter": self.counter,
            "target_clearance_um": SENT.clearance_um if self.commanding else BOOT.clearance_um,
            "target_pressure_bar": SENT.pressure_bar if self.commanding else BOOT.pressure_bar,
            "at_target": True,
            "refused_stale": self.refused[0],
            "refused_check": self.refused[1],
            "refused_session": self.refused[2],
            "refused_range": self.refused[3],
        }
        node = NodeState(**(good | changed))  # type: ignore[arg-type]
        told = self.watch.step(node, Surroundings(BOOT, tick_us), self.now_ns)
        return [notice.name for notice in told]

    def reports(self, count: int, **changed: object) -> list[str]:
        return [name for _ in range(count) for name in self.report(**changed)]

    @property
    def standing(self) -> dict[str, str]:
        return {c.name: c.text for c in self.watch.state.conditions.values() if c.standing}


def commanding() -> Watched:
    """A second of commands, all well."""
    watched = Watched()
    assert watched.reports(20) == []
    return watched


def quiet() -> Watched:
    """A second after the last command, all well."""
    watched = commanding()
    watched.commanding = False
    assert watched.reports(20) == []
    return watched


STRANGE: dict[str, tuple[str, Callable[[], Watched], dict[str, object], str]] = {
    "another session": ("node_elsewhere", commanding, {"session": 9}, "session 0x00000009"),
    "never sent": ("node_elsewhere", commanding, {"command_counter": 900}, "command 900"),
    "another session, nothing sent": (
        "node_elsewhere",
        Watched,
        {"session": 9, "mode": NodeMode.FOLLOWING},
        "session 0x00000009",
    ),
    "goes on": (
        "node_not_expired",
        quiet,
        {"mode": NodeMode.FOLLOWING, "session": SESSION},
        "its time to live",
    ),
    "stays safe": ("node_not_following", commanding, {"mode": NodeMode.SAFE}, "stays SAFE"),
    "clearance": (
        "node_target_differs",
        commanding,
        {"target_clearance_um": 71.0},
        "clearance of 71 um, commanded 70;",
    ),
    "pressure": (
        "node_target_differs",
        commanding,
        {"target_pressure_bar": 1.4},
        "pressure of 1.4 bar, commanded 1.5;",
    ),
    "boot value": (
        "node_target_differs",
        quiet,
        {"target_clearance_um": 71.0},
        "(boot value, mode SAFE)",
    ),
    "counter stands still": (
        "node_counter_frozen",
        commanding,
        {"command_counter": 2},
        "its command counter stands still",
    ),
    "the past": ("node_state_frozen", commanding, {"tick_us": 5}, "before the newest sample"),
}


@pytest.mark.parametrize("case", STRANGE)
def test_a_doubt_stands_after_three_reports_over_a_time_and_ends_after_a_longer_one(
    case: str,
) -> None:
    name, before, changed, text = STRANGE[case]
    watched = before()
    if before is Watched:
        watched.commanding = False
    assert watched.reports(3, **changed) == []
    assert watched.reports(20, **changed) == [name]
    assert text in watched.standing[name]
    assert watched.reports(10) == []
    assert watched.reports(20) == [f"{name}_ended"]


@pytest.mark.parametrize("case", STRANGE)
def test_one_report_of_three_is_no_news_two_of_three_add_up_and_what_comes_and_goes_stands(
    case: str,
) -> None:
    name, before, changed, _ = STRANGE[case]
    watched = before()
    if before is Watched:
        watched.commanding = False
    for _ in range(20):
        assert watched.report(**changed) == []
        assert watched.reports(2) == []
    told = [n for _ in range(20) for n in watched.reports(2, **changed) + watched.report()]
    assert told == [name]
    for _ in range(10):
        assert watched.reports(8) == []
        assert watched.report(**changed) == []


def test_two_reports_are_too_few_however_far_apart() -> None:
    watched = commanding()
    watched.period_ns = 160 * MS
    assert watched.reports(2, session=9) == []
    assert watched.report(session=9) == ["node_elsewhere"]


def test_a_node_that_reports_no_command_counter_yet_is_believed_for_as_long_as_it_may_begin() -> (
    None
):
    watched = quiet()
    watched.commanding = True
    begins = (TTL_NS + 250 * MS) // PERIOD_NS
    assert watched.reports(begins, command_counter=0) == []
    assert watched.reports(20, command_counter=0) == ["node_counter_frozen"]
    assert "follows command 0, the newest" in watched.standing["node_counter_frozen"]


def test_any_target_that_was_sent_within_the_latency_is_admissible() -> None:
    watched = commanding()
    watched.watch.sent(watched.counter, Target(90.0, 2.0), watched.now_ns)
    assert watched.reports(4, target_clearance_um=80.0, target_pressure_bar=1.7) == []
    assert watched.reports(20, target_clearance_um=80.0) == ["node_target_differs"]
    assert "commanded 70;" in watched.standing["node_target_differs"]


def test_a_node_may_stay_safe_until_the_first_command_can_have_come() -> None:
    watched = quiet()
    watched.commanding = True
    safe = {"mode": NodeMode.SAFE, "target_clearance_um": BOOT.clearance_um,
            "target_pressure_bar": BOOT.pressure_bar}  # fmt: skip
    late = (TTL_NS + 250 * MS) // PERIOD_NS + 1
    assert watched.reports(late, **safe) == []
    assert watched.reports(5, **safe) == ["node_not_following"]


def test_where_a_node_that_does_its_duty_goes() -> None:
    watched = Watched()
    assert watched.watch.commanded(watched.now_ns, BOOT) is BOOT
    watched.report()
    assert watched.watch.commanded(watched.now_ns + TTL_NS, BOOT) == SENT
    assert watched.watch.commanded(watched.now_ns + TTL_NS + 1, BOOT) is BOOT


def test_no_fresh_sample_says_nothing_of_the_instant() -> None:
    watched = commanding()
    node = NodeState(0, 5, NodeMode.FOLLOWING, SESSION, watched.counter, SENT.clearance_um,
                     SENT.pressure_bar, True, 0, 0, 0, 0)  # fmt: skip
    for _ in range(20):
        watched.now_ns += PERIOD_NS
        watched.watch.sent(watched.counter, SENT, watched.now_ns)
        assert watched.watch.step(node, Surroundings(BOOT, None), watched.now_ns) == []


# ------------------------------------------------------------------ refusals


@pytest.mark.parametrize("which", range(4))
def test_refusals_of_each_kind_are_an_alarm_from_the_third_within_five_seconds(which: int) -> None:
    watched = commanding()
    watched.refused[which] += 2
    assert watched.reports(120) == [], "two may be lost to one disturbance"
    watched.refused[which] = (watched.refused[which] + 3) & 0xFFFF
    assert watched.reports(20) == ["node_refuses"]
    word = ("stale", "check", "session", "range")[which]
    assert f"node refused 3 {word} commands" in watched.standing["node_refuses"]
    assert watched.reports(120) == ["node_refuses_ended"]


def test_refusals_more_than_five_seconds_apart_are_none() -> None:
    watched = commanding()
    for _ in range(4):
        watched.refused[0] += 2
        assert watched.reports(125) == []


def test_refusals_are_of_this_device_only_while_it_commands() -> None:
    watched = quiet()
    watched.refused[2] += 100
    assert watched.reports(60) == []
    watched.commanding = True
    assert watched.reports(60) == []


def test_counters_that_begin_anew_are_no_refusals() -> None:
    watched = Watched()
    watched.refused[0] = 500
    assert watched.reports(20) == []
    watched.refused[0] = 0
    assert watched.reports(20) == [], "they fell"
    watched.refused[0] = 40
    watched.watch.restarted()
    assert watched.reports(20) == [], "the node has started again"
    watched.refused[0] += 3
    assert watched.reports(20) == ["node_refuses"]
