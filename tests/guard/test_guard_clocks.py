"""Stamps from the future, and gaps that only one of the two clocks has seen."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from firmware_py.records import (
    Advice,
    ArmState,
    Command,
    GuardState,
    NodeState,
    RawFrame,
    RigStatus,
    SampleFrame,
)
from firmware_py.wire.codec import CanCodec

from .scripted_node import MS, Bench, working

CODEC = CanCodec()
HOUR_NS = 3_600_000 * MS


def state(b: Bench) -> GuardState:
    return next(d.state for d in iter(b.cycle, None) if d.state)


def shifted(kind: type, by_us: int) -> Callable[[list[RawFrame]], list[RawFrame]]:
    """Every message of ``kind`` with its tick moved."""

    def tamper(frames: list[RawFrame]) -> list[RawFrame]:
        moved = []
        for frame in frames:
            message = CODEC.decode(frame)
            if isinstance(message, kind):
                message = msgspec.structs.replace(
                    message, tick_us=(message.tick_us + by_us) & 0xFFFFFFFF
                )
                frame = CODEC.encode(message, frame.arrival_ns)
            moved.append(frame)
        return moved

    return tamper


# ------------------------------------------------------------------ the future


@pytest.mark.parametrize("field", ["t_ns", "t_acq_ns"])
@pytest.mark.parametrize("ahead_ns", [100 * MS, HOUR_NS, 2**61])
def test_an_advice_from_the_future_ends_authority_and_is_counted(field: str, ahead_ns: int) -> None:
    b = working()
    good = b.advice

    def early() -> Advice | None:
        advice = good()
        return advice and msgspec.structs.replace(advice, **{field: b.now_ns + ahead_ns})

    b.advice = early  # type: ignore[method-assign]
    b.run(0.3)
    found = state(b)
    assert not found.authority
    assert any("later than now" in reason for reason in found.authority_reasons)
    assert found.counters["advices_ahead"] >= 3
    assert found.target_clearance_um == 50.0


def test_one_advice_from_the_future_does_not_live_on_when_the_brain_falls_silent() -> None:
    b = working()
    for_ever = Advice(
        9999, b.now_ns + HOUR_NS, b.now_ns + HOUR_NS, 2**62, 70.0, None, True, [], None
    )
    sent_ns = b.now_ns + MS
    b.advice = lambda: for_ever if b.now_ns == sent_ns else None  # type: ignore[method-assign]
    b.run(5.0)
    assert not state(b).authority


@pytest.mark.parametrize("ahead_ns", [5 * MS, HOUR_NS])
def test_frames_stamped_in_the_future_are_taken_as_arriving_now(ahead_ns: int) -> None:
    b = working()
    b.tamper = lambda frames: [
        RawFrame(f.arrival_ns + ahead_ns, f.frame_id, f.data) for f in frames
    ]
    b.run(0.5)
    found = state(b)
    assert found.authority
    assert found.counters["stamps_ahead"] > 500
    b.tamper = list
    b.run(0.5)
    assert state(b).authority


@pytest.mark.parametrize("behind_ns", [50 * MS, HOUR_NS])
def test_one_frame_stamped_in_the_past_costs_nothing(behind_ns: int) -> None:
    b = working()
    b.tamper = lambda frames: [
        RawFrame(f.arrival_ns - behind_ns, f.frame_id, f.data) for f in frames
    ]
    b.cycle()
    b.cycle()
    b.tamper = list
    b.run(0.5)
    found = state(b)
    assert found.authority
    assert found.counters["stamps_behind"] > 0


@pytest.mark.parametrize("kind", [NodeState, RigStatus])
@pytest.mark.parametrize("ahead_us", [10_000, 60_000_000, 2**31 - 1_000_000])
def test_a_node_message_with_a_tick_from_the_future_is_no_account(
    kind: type, ahead_us: int
) -> None:
    b = working()
    b.tamper = shifted(kind, ahead_us)
    b.run(0.7)
    found = state(b)
    assert found.counters["reject_ahead"] >= 10
    assert found.arm_state == ArmState.RECOVERY
    assert "node_silent" in b.names()
    b.tamper = list
    b.until(lambda: b.authority, 5.0)


# ------------------------------------------------------------------ a gap on either clock


def leap(b: Bench, ms: int) -> list[RawFrame]:
    """What the node says while its clock alone goes on."""
    b.node.lead_us += ms * 1000
    return [RawFrame(b.now_ns, f.frame_id, f.data) for f in b.node.step(b.now_ns)]


@pytest.mark.parametrize(
    ("gone_ms", "delivered"),
    [
        (150, "none"),
        (150, "all"),
        (2000, "none"),
        (2000, "first"),
        (2000, "all"),
        (60_000, "none"),
        (60_000, "first"),
    ],
)
def test_a_suspended_host_is_a_gap_although_its_own_clock_saw_none(
    gone_ms: int, delivered: str
) -> None:
    b = working()
    waiting = leap(b, gone_ms)
    b.extra = {"none": [], "first": waiting[:100], "all": waiting}[delivered]
    b.cycle()
    b.run(0.05)
    found = state(b)
    name = (
        "clock_leap" if gone_ms < 60_000 else "node_restarted"
    )  # beyond 32768 frames the counter runs backward
    assert name in b.names()
    assert not found.authority
    assert found.arm_state == ArmState.RECOVERY
    assert found.counters["cycle_gaps"] == 1
    b.until(lambda: b.authority, 6.0)


def test_a_suspension_whose_frames_come_in_small_portions_is_seen() -> None:
    """A serial buffer is read bit by bit: no single portion spans the time to live."""
    b = working()
    queue = leap(b, 400)

    def portion(frames: list[RawFrame]) -> list[RawFrame]:
        queue.extend(frames)
        out, queue[:] = queue[:30], queue[30:]
        return [RawFrame(b.now_ns, f.frame_id, f.data) for f in out]

    b.tamper = portion
    b.run(0.2)
    assert "clock_leap" in b.names()
    assert not state(b).authority


def test_a_host_clock_that_alone_went_on_is_a_gap_and_comes_back() -> None:
    b = working()
    b.now_ns += 2000 * MS
    b.node.lead_us -= 2_000_000
    b.cycle()
    found = state(b)
    assert not found.authority
    assert found.arm_state == ArmState.RECOVERY
    b.until(lambda: b.authority, 6.0)  # the clocks are compared anew after a gap


def test_nothing_is_commanded_from_before_a_suspension() -> None:
    b = working()
    leap(b, 2000)
    out = [m for d in b.run(0.3) for m in map(CODEC.decode, d.frames_out) if isinstance(m, Command)]
    late = [m.clearance_um for m in out[1:]]
    assert set(late) <= {50.0}


def test_lost_frames_on_both_clocks_are_no_leap() -> None:
    b = working()
    b.tamper = lambda frames: [f for f in frames if not isinstance(CODEC.decode(f), SampleFrame)]
    b.run(0.5)
    b.tamper = list
    b.run(6.0)
    found = state(b)
    assert found.counters["clock_leaps"] == 0
    assert found.authority
