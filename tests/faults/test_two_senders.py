"""Two nodes, or a node and a recording, on one bus: named, distrusted, and over soon after the
second one ends."""

import msgspec
import pytest

from firmware_py.records import (
    ArmState,
    GuardState,
    NodeInfo,
    NodeState,
    Quality,
    RawFrame,
    RigStatus,
    SampleFrame,
)
from firmware_py.wire.codec import CanCodec

from ..guard.scripted_node import Bench, working

CODEC = CanCodec()
NAMES = {
    SampleFrame: "SAMPLES",
    RigStatus: "RIG_STATUS",
    NodeState: "NODE_STATE",
    NodeInfo: "NODE_INFO",
}


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def forging(b: Bench, kind: type, ahead: int, **changed: object) -> None:
    """A second sender beside each message of ``kind``, so far ahead in its counter."""

    def both(frames: list[RawFrame]) -> list[RawFrame]:
        out = []
        for frame in frames:
            message = CODEC.decode(frame)
            if type(message) is kind:
                forged = msgspec.structs.replace(
                    message, counter=(message.counter + ahead) & 0xFFFF, **changed
                )
                out.append(CODEC.encode(forged, frame.arrival_ns))
            out.append(frame)
        return out

    b.tamper = both


FORGED = [
    (SampleFrame, {"samples": bytes(48)}, 0.1),
    (RigStatus, {"oil_outlet_C": 38.0}, 0.5),
    (NodeState, {"refused_range": 1}, 0.5),
    (NodeInfo, {"rate_um_s": 80.0}, 6.0),
]
"""What a second sender may say, and how soon it is told, s."""
AHEAD = (0, 1, 30, 1000, 40_000)
IN_DEFAULT_RUN = (1,)
"""Of `AHEAD`: how each ends; `make test-slow` takes all, and the zeros for half a minute."""


def with_two_senders(kind: type, changed: dict[str, object], within_s: float, ahead: int) -> Bench:
    """A bench that has told of the second sender in time."""
    b = working()
    forging(b, kind, ahead, **changed)
    b.run(within_s)
    found = state(b)
    alarm = next(a for a in found.alarms if a.name == "two_senders")
    assert NAMES[kind] in alarm.text
    assert not found.authority
    assert found.arm_state == ArmState.RECOVERY
    assert found.target_clearance_um == 50.0
    return b


@pytest.mark.parametrize(("kind", "changed", "within_s"), FORGED)
@pytest.mark.parametrize("ahead", AHEAD)
def test_two_senders_are_an_alarm_and_cost_authority(
    kind: type, changed: dict[str, object], within_s: float, ahead: int
) -> None:
    b = with_two_senders(kind, changed, within_s, ahead)
    assert "two_senders" in b.names()


@pytest.mark.parametrize(("kind", "changed", "within_s"), FORGED)
@pytest.mark.parametrize(
    "ahead",
    [a if a in IN_DEFAULT_RUN else pytest.param(a, marks=pytest.mark.slow) for a in AHEAD],
)
def test_authority_comes_back_when_one_of_two_senders_ends(
    kind: type, changed: dict[str, object], within_s: float, ahead: int
) -> None:
    b = with_two_senders(kind, changed, within_s, ahead)
    b.tamper = list
    b.run(6.5)
    found = state(b)
    assert "two_senders" not in [a.name for a in found.alarms]
    assert "two_senders_ended" in b.names()
    b.run(
        32.0 if kind is SampleFrame and ahead == 0 else 6.0
    )  # the zeros among the samples are a bad contact
    assert state(b).arm_state == ArmState.ARMED
    assert state(b).authority


@pytest.mark.parametrize("ahead", [2, 30, 1000, 40_000])
def test_forged_calm_frames_do_not_replace_the_true_ones(ahead: int) -> None:
    b = working()
    b.node.amplitude_um = 30.0
    forging(b, SampleFrame, ahead, samples=bytes(48))
    b.run(0.5)
    found = state(b)
    assert max(found.peak_to_peak_um) > 55.0
    blocks = [block for d in b.run(0.1) for block in d.blocks]
    assert blocks
    assert all(block.quality & Quality.TWO_SENDERS for block in blocks)


@pytest.mark.parametrize("every", [1, 4])
def test_an_old_log_played_back_onto_the_bus_is_told(every: int) -> None:
    b = working()
    recorded: list[list[RawFrame]] = []
    b.tamper = lambda frames: recorded.append(frames) or frames
    b.run(2.0)
    b.tamper = list
    played = iter(recorded)
    for k in range(1200):
        b.extra = next(played) if k % every == 0 else []
        b.cycle()
    found = state(b)
    assert "two_senders" in [a.name for a in found.alarms]
    assert not found.authority
    assert found.speed_rad_s == pytest.approx(6000 * 0.104719755, rel=1e-3)
    b.until(lambda: b.authority, 9.0)


def test_a_second_node_with_its_own_counters_is_told() -> None:
    b, other = working(), Bench()
    other.now_ns = b.now_ns
    count = other.node.counter
    other.node.counter = lambda kind: (count(kind) + 9_000) & 0xFFFF  # type: ignore[method-assign]
    for _ in range(1000):
        other.now_ns += 1_000_000
        b.extra = other.node.step(other.now_ns)
        b.cycle()
    found = state(b)
    assert "two_senders" in [a.name for a in found.alarms]
    assert found.arm_state != ArmState.ARMED


@pytest.mark.parametrize("lost", [1, 10, 63, 100, 1600])
def test_a_burst_of_lost_frames_is_no_second_sender(lost: int) -> None:
    b = working()
    left = [lost]

    def losing(frames: list[RawFrame]) -> list[RawFrame]:
        kept = []
        for frame in frames:
            if frame.frame_id == 0x0C0 and left[0]:
                left[0] -= 1
            else:
                kept.append(frame)
        return kept

    b.tamper = losing
    b.run(3.0)
    assert "two_senders" not in b.names()


def test_a_restart_is_no_second_sender() -> None:
    b = working()
    b.node.restart()
    b.run(2.0)
    b.node.restart()
    b.run(2.0)
    assert "two_senders" not in b.names()
    assert "node_restarted" in b.names()
