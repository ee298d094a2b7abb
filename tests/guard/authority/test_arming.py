"""Modes, arming, recovery and set points by themselves: a situation in, a state out."""

import msgspec
import pytest

from firmware_py.guard.authority.arming import CHECK_PATIENCE_NS, RECOVERY_MAX_NS, Arming
from firmware_py.guard.authority.failsafe import Situation, node_reasons
from firmware_py.guard.envelope.target import Target
from firmware_py.records import Advice, ArmState, CommandRequest, Mode, NodeFigures, NodeInfo
from firmware_py.wire.layout import WireLayout

from ..scripted_node import MS, bench

S = 1_000_000_000
CONFIG = bench()
GOOD = Situation(
    now_ns=S,
    link_up=True,
    samples_fresh=True,
    clock_settled=True,
    node_heard=True,
    node_reasons=[],
    foreign_command=False,
    foreign_heartbeat=False,
    cycle_gap=False,
    mark_lost=False,
    displacement_ok=True,
    vibration_high=False,
    speed_declared=True,
    interval_m=(45e-6, 100e-6),
    tripped=[],
    brain_connected=True,
)
SAFE = Target(
    CONFIG.machine.actuator.safe_radial_clearance_um, CONFIG.machine.actuator.safe_pressure_bar
)


class Device:
    """An arming stage in steps of 10 ms; ``wrong`` are the facts that are not good."""

    def __init__(self) -> None:
        self.arming = Arming(CONFIG)
        self.now_ns = S
        self.target = SAFE
        self.events: list[tuple[str, str]] = []
        self.advise_um: float | None = None

    def situation(self, wrong: dict[str, object]) -> Situation:
        return msgspec.structs.replace(GOOD, now_ns=self.now_ns, **wrong)

    def run(self, seconds: float, **wrong: object) -> list[str]:
        """Names of what is told."""
        seen = len(self.events)
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            advice = None
            if self.advise_um is not None:
                seq = self.now_ns // (100 * MS)
                advice = Advice(
                    seq, self.now_ns, self.now_ns, 300 * MS, self.advise_um, None, True, [], None
                )
            self.target, notices = self.arming.step(self.situation(wrong), advice)
            self.events += [(notice.name, notice.text) for notice in notices]
        return [name for name, _ in self.events[seen:]]

    def ask(self, verb: str, value: float | None = None, mode: int | None = None) -> list[str]:
        """One request; the reasons against it."""
        reply, notices = self.arming.request(
            CommandRequest(1, verb, value, mode), self.situation({})
        )
        assert reply.accepted != bool(reply.reasons)
        assert bool(notices) == reply.accepted
        return reply.reasons

    @property
    def state(self) -> ArmState:
        return self.arming.state.arm_state


def armed(mode: Mode = Mode.MANUAL) -> Device:
    device = Device()
    device.run(0.1)
    assert device.state == ArmState.DISARMED
    assert device.ask("mode", mode=mode) == []
    assert device.ask("arm") == []
    device.run(0.1)
    assert device.state == ArmState.ARMED
    return device


# ------------------------------------------------------------------ states


def test_checking_ends_when_nothing_speaks_against_and_is_told_after_its_patience() -> None:
    device = Device()
    patience_s = CHECK_PATIENCE_NS / S
    assert device.run(patience_s - 0.1, samples_fresh=False) == []
    assert device.state == ArmState.CHECK
    assert device.run(0.2, samples_fresh=False) == ["samples_stale"]
    assert [alarm.name for alarm in device.arming.standing()] == ["samples_stale"]
    device.run(0.1)
    assert device.state == ArmState.DISARMED
    assert device.arming.standing() == []


@pytest.mark.parametrize("doubt", ["foreign_command", "node_reasons", "node_elsewhere"])
def test_who_may_not_command_is_disarmed_at_once(doubt: str) -> None:
    wrong: dict[str, object] = {doubt: True}
    if doubt == "node_reasons":
        wrong = {doubt: ["node: another rate"]}
    if doubt == "node_elsewhere":
        wrong = {"doubts": {doubt: "node follows session 9"}}
    device = armed()
    assert "disarmed" in device.run(0.01, **wrong)
    assert (device.state, device.arming.state.commanding) == (ArmState.DISARMED, False)
    device.run(5.0)
    assert device.state == ArmState.DISARMED, "it does not come back by itself"


def test_recovery_retreats_and_comes_back_after_a_time_without_trouble() -> None:
    device = armed()
    device.ask("set_clearance", 60.0)
    device.run(1.0)
    assert device.target.clearance_um == 60.0
    assert device.run(0.1, samples_fresh=False) == ["samples_stale", "recovery"]
    assert (device.state, device.target) == (ArmState.RECOVERY, SAFE)
    wait_s = CONFIG.authority.regain_after_s
    assert device.run(wait_s - 0.05) == []
    assert device.run(0.1) == ["recovered"]
    assert device.state == ArmState.ARMED


@pytest.mark.parametrize("over", [False, True])
def test_a_recovery_that_takes_too_long_ends_disarmed(over: bool) -> None:
    device = armed()
    device.run(0.01, samples_fresh=False)
    began_ns = device.now_ns
    while device.now_ns - began_ns < RECOVERY_MAX_NS - S:
        device.run(0.5, link_up=False)
        device.run(0.5)
    device.run(1.0 + (0.02 if over else -0.02), link_up=False)
    assert device.state == (ArmState.DISARMED if over else ArmState.RECOVERY)
    assert ("disarmed" in [name for name, _ in device.events]) == over


def test_a_trip_latches_until_a_reset_with_nothing_left() -> None:
    device = armed()
    assert device.run(0.1, tripped=["disp_x_danger"]) == ["tripped"]
    assert device.events[-1][1] == "disp_x_danger"
    assert device.state == ArmState.TRIPPED
    device.run(1.0)
    assert device.state == ArmState.TRIPPED
    device.arming.reset(["disp_x_danger"])
    assert device.state == ArmState.TRIPPED
    device.arming.reset([])
    device.run(0.1)
    assert (device.state, device.arming.state.commanding) == (ArmState.DISARMED, False)


def test_a_reset_of_what_is_not_tripped_leaves_the_device_armed() -> None:
    device = armed()
    device.arming.reset([])
    assert (device.state, device.arming.state.commanding) == (ArmState.ARMED, True)


# ------------------------------------------------------------------ requests


def test_monitor_disarms_and_never_arms() -> None:
    device = armed()
    assert device.ask("mode", mode=Mode.MONITOR) == []
    assert (device.state, device.arming.state.commanding) == (ArmState.DISARMED, False)
    assert "mode is monitor" in device.ask("arm")[0]
    device.run(1.0)
    assert device.state == ArmState.DISARMED


def test_arming_again_changes_nothing() -> None:
    device = armed()
    device.run(0.1, samples_fresh=False)
    assert device.ask("arm") == []
    assert device.state == ArmState.RECOVERY


@pytest.mark.parametrize("state", [ArmState.CHECK, ArmState.DISARMED, ArmState.TRIPPED])
def test_disarm_is_never_refused(state: ArmState) -> None:
    device = Device()
    wrong: dict[ArmState, dict[str, object]] = {
        ArmState.CHECK: {"link_up": False},
        ArmState.TRIPPED: {"tripped": ["speed_high"]},
    }
    device.run(0.1, **wrong.get(state, {}))
    assert device.state == state
    assert device.ask("disarm") == []
    assert device.state == state


def test_a_set_point_of_the_pressure_is_taken_and_leaves_the_clearance() -> None:
    device = armed()
    assert device.ask("set_clearance", 60.0) == []
    assert device.ask("set_pressure", 2.5) == []
    device.run(3.0)
    assert device.target == Target(60.0, 2.5)


@pytest.mark.parametrize("verb", ["set_clearance", "set_pressure"])
def test_a_set_point_needs_manual_and_a_number_inside(verb: str) -> None:
    device = armed(Mode.AUTO)
    assert "mode is auto" in device.ask(verb, 1e9)[0]
    device.ask("mode", mode=Mode.MANUAL)
    assert "outside" in device.ask(verb, 1e9)[0]
    assert "finite" in device.ask(verb, float("inf"))[0]
    assert "finite" in device.ask(verb)[0]
    device.run(3.0)
    assert device.target == SAFE


@pytest.mark.parametrize("mode", [None, 3, -1])
def test_an_unknown_mode_or_verb_is_refused(mode: int | None) -> None:
    device = armed()
    assert "not one of 0 monitor" in device.ask("mode", mode=mode)[0]
    assert "unknown verb" in device.ask("fly", mode=mode)[0]
    assert device.arming.state.mode == Mode.MANUAL


# ------------------------------------------------------------------ what is followed


def test_auto_follows_advice_with_authority_and_retreats_without() -> None:
    device = armed(Mode.AUTO)
    device.advise_um = 70.0
    device.run(0.5)
    assert device.target == SAFE, "authority is not there yet"
    device.run(5.0)
    assert device.target == Target(70.0, SAFE.pressure_bar)
    assert "authority_lost" in device.run(0.1, mark_lost=True)
    assert device.target == SAFE
    assert "authority_lost" in [alarm.name for alarm in device.arming.standing()]


def test_without_an_admissible_clearance_the_target_retreats() -> None:
    device = armed()
    device.ask("set_clearance", 60.0)
    device.run(1.0)
    device.run(0.01, interval_m=None)
    assert device.target == SAFE


def test_a_node_that_has_not_said_what_it_is_has_nothing_against_it() -> None:
    assert node_reasons(CONFIG, None) == []


def figures(**changed: float | bool) -> NodeFigures:
    """Of a node that is what the bench under wire schema 2 wants."""
    has = NodeFigures(
        0, 0, 3000, True, False, 40.0, 160.0, 0.5, 3.0, 50, 100, 0, 0.0, 0.0, 0.0, 0.0
    )
    return msgspec.structs.replace(has, **changed)


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (figures(), ""),
        (None, "says nothing of its figures (NODE_FIGURES)"),
        (figures(clearance_max_um=150.0), "its clearance is 40 .. 150 um"),
        (figures(pressure_min_bar=1.0), "its pressure is 1 .. 3 bar"),
        (figures(heartbeat_limit_ms=100), "heartbeat limit 100 ms is outside"),
        (figures(heartbeat_limit_ms=60_000), "heartbeat limit 60000 ms is outside"),
        (figures(coasts_on_silence=False), "its drive runs on when the heartbeat is lost"),
    ],
)
def test_what_a_node_of_schema_2_was_built_with_is_compared(
    told: NodeFigures | None, words: str
) -> None:
    config = CONFIG.replaced(bus=msgspec.structs.replace(CONFIG.bus, schema=2))
    a = config.machine.actuator
    info = NodeInfo(
        0, 0, 2, config.sampling.period_us, a.safe_radial_clearance_um, a.safe_pressure_bar,
        a.time_to_live_ms, a.rate_um_s, WireLayout.of(config).hash,
    )  # fmt: skip
    reasons = node_reasons(config, info, told)
    assert len(reasons) == (1 if words else 0), reasons
    assert all(words in reason for reason in reasons)
