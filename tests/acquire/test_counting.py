"""Counters of one sender, of one that starts again, and of two."""

from itertools import count

import pytest

from firmware_py.acquire.counting import (
    CONFIRM,
    CONFIRM_BACK,
    NEAR,
    PATIENCE,
    CounterTrack,
    doubled,
    take,
)
from firmware_py.records import (
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    ReadingsFrame,
    RigStatus,
    SampleFrame,
)

PERIODS_NS = {
    SampleFrame: 600_000,
    RigStatus: 50_000_000,
    NodeState: 50_000_000,
    NodeInfo: 1_000_000_000,
    ReadingsFrame: 50_000_000,
    NodeFigures: 1_000_000_000,
    DriveState: 50_000_000,
}


def message(kind: type, counter: int, who: int = 0):
    """A message of ``kind``; ``who`` makes its content its sender's."""
    counter &= 0xFFFF
    if kind is SampleFrame:
        return SampleFrame(counter, who, 0, 0, 0, bytes(48))
    if kind is RigStatus:
        return RigStatus(counter, who, 1.0, 1.0, 1.0, 1.0)
    if kind is NodeState:
        return NodeState(counter, who, 0, 0, 0, 1.0, 1.0, True, 0, 0, 0, 0)
    if kind is ReadingsFrame:
        return ReadingsFrame(counter, who, 0, (1.0,), (0,), (0,))
    if kind is NodeFigures:
        return NodeFigures(
            counter, who, 3000, True, False, 1.0, 2.0, 1.0, 2.0, 50, 100, 0, 0.0, 0.0, 0.0, 0.0
        )
    if kind is DriveState:
        return DriveState(counter, who, 0, 0, 0, 1.0, 1.0, 1.0, 1.0, 0, 0, 0, 0)
    return NodeInfo(counter, who, 1, 200, 1.0, 1.0, 100, 1.0)


class Line:
    """One stream into one track; ``who`` of the frames that were taken is kept."""

    def __init__(self, kind: type = SampleFrame, last: int = -1) -> None:
        self.kind, self.track = kind, CounterTrack()
        self.now_ns = 10**12
        self.counters = {f"reject_{name}": 0 for name in ("repeated", "conflicting", "reordered")}
        self.lost, self.restarts, self.who, self.taken = 0, 0, [], []
        if last >= 0:
            self.send(last)

    def send(self, *counters: int, who: int = 0, after_ns: int | None = None) -> None:
        for counter in counters:
            self.now_ns += PERIODS_NS[self.kind] if after_ns is None else after_ns
            for taken in take(
                self.track, message(self.kind, counter, who), self.now_ns, self.counters
            ):
                self.lost += taken.lost
                self.restarts += taken.restarted
                self.taken.append(taken.message.counter)
                self.who.append(taken.message.tick_us)

    @property
    def doubled(self) -> bool:
        return doubled(self.track, self.kind, self.now_ns)


# ------------------------------------------------------------------ one sender


@pytest.mark.parametrize("last", [0, 1, 100, 65533, 65534, 65535])
@pytest.mark.parametrize("jump", [2, 3, NEAR - 1, NEAR])
def test_a_near_jump_forward_is_a_loss_across_the_wrap_once_the_next_frame_continues_it(
    last: int, jump: int
) -> None:
    line = Line(last=last)
    line.send(last + jump)
    assert line.lost == 0
    line.send(last + jump + 1, last + jump + 2)
    assert (line.lost, len(line.taken), line.doubled) == (jump - 1, 4, False)


def test_every_second_frame_lost_is_a_loss() -> None:
    line = Line(last=0)
    line.send(*range(2, 200, 2))
    line.send(199)
    assert (line.lost, line.counters["reject_reordered"], line.doubled) == (99, 0, False)


@pytest.mark.parametrize("back", [1, 2, NEAR - 1, NEAR])
def test_late_frames_are_dropped_and_never_move_the_track(back: int) -> None:
    line = Line(last=200)
    for _ in range(CONFIRM_BACK):
        line.send(200 - back)
    line.send(201)
    assert line.taken == [200, 201]
    assert line.counters["reject_reordered"] == CONFIRM_BACK
    assert not line.doubled


def test_two_frames_in_exchanged_order_cost_one_of_them() -> None:
    line = Line(last=1)
    line.send(3, 2, 4, 5)
    assert line.taken == [1, 2, 4, 5]
    assert (line.lost, line.doubled) == (1, False)


def test_the_same_frame_again_is_a_repeat_however_often() -> None:
    line = Line(last=7)
    for counter in range(8, 400):
        line.send(counter, counter)
    assert line.counters["reject_repeated"] == 392
    assert (line.lost, line.doubled) == (0, False)


def test_a_frame_that_waits_may_be_repeated_too() -> None:
    line = Line(last=1)
    line.send(5, 5, 6)
    assert (line.counters["reject_repeated"], line.lost) == (1, 3)


@pytest.mark.parametrize("kind", PATIENCE)
@pytest.mark.parametrize("jump", [NEAR + 1, 1000, 0x7000])
def test_a_long_loss_is_believed_when_three_frames_continue_it(kind: type, jump: int) -> None:
    line = Line(kind, last=500)
    line.send(*range(500 + jump, 500 + jump + CONFIRM + 1))
    assert line.lost == jump + CONFIRM - 2
    assert (line.restarts, line.doubled) == (0, False)


@pytest.mark.parametrize("kind", PATIENCE)
@pytest.mark.parametrize(("last", "needed"), [(5000, CONFIRM), (40, CONFIRM_BACK)])
def test_a_sender_that_starts_again_is_one_sender(kind: type, last: int, needed: int) -> None:
    line = Line(kind, last=last)
    line.send(*range(needed + 3))
    assert (line.restarts, line.lost, line.doubled) == (1, 0, False)
    assert line.taken == [last, *range(needed - 1, needed + 3)]


def test_one_forged_far_jump_does_not_push_the_true_frames_out() -> None:
    line = Line(last=500)
    line.send(20_000)
    line.send(501, 502)
    assert line.taken == [500, 501, 502]


def test_far_frames_that_do_not_continue_each_other_are_never_believed() -> None:
    line = Line(last=500)
    line.send(*(3000, 4000, 5000, 3001, 4001, 5001) * 3)
    assert line.taken == [500]


def test_a_stray_frame_does_not_drop_the_one_that_waits() -> None:
    line = Line(last=500)
    line.send(510, 20_000, 511)
    assert line.taken == [500, 510, 511]
    assert (line.lost, line.counters["reject_reordered"], line.doubled) == (9, 1, False)


# ------------------------------------------------------------------ two senders


@pytest.mark.parametrize("kind", PATIENCE)
@pytest.mark.parametrize("ahead", [0, 1, 2, 30, NEAR, 1000, 30_000, 40_000, -1, -30, -1000])
def test_two_interleaved_senders_are_told_soon_and_the_true_one_is_taken_up_again(
    kind: type, ahead: int
) -> None:
    line = Line(kind, last=65_500)
    true = count(65_501)
    for _ in range(30):
        line.send(next(true))
    assert not line.doubled
    told_after = next(
        (k for k in range(40) if _pair(line, next(true), ahead) or line.doubled), None
    )
    assert told_after is not None
    assert told_after <= PATIENCE[kind].frames * 1.3 + 2
    for _ in range(40):
        _pair(line, next(true), ahead)
    assert line.doubled
    line.who.clear()
    for _ in range(20):
        line.send(next(true))
    assert line.who[-10:] == [0] * 10
    line.now_ns += PATIENCE[kind].hold_ns
    assert not line.doubled


def _pair(line: Line, true: int, ahead: int) -> None:
    """A true frame and a forged one beside it."""
    half_ns = PERIODS_NS[line.kind] // 2
    line.send(true + ahead, who=1, after_ns=half_ns)
    line.send(true, after_ns=half_ns)


@pytest.mark.parametrize("ahead", [2, 30, NEAR, 1000, 30_000, -1000])
def test_a_second_sender_at_the_same_rate_never_replaces_the_first(ahead: int) -> None:
    line = Line(last=100)
    for true in range(101, 2000):
        _pair(line, true, ahead)
    assert line.who.count(1) == 0
    assert line.who.count(0) == 1900


@pytest.mark.parametrize("every", [3, 10, 50])
def test_a_slow_playback_beside_the_stream_is_told(every: int) -> None:
    line = Line(last=100)
    old = count(40_000)
    for true in range(101, 4000):
        line.send(true)
        if not true % every:
            line.send(next(old), who=1)
    assert line.doubled
    assert line.who.count(1) == 0


def test_bursts_of_forged_frames_that_get_through_are_told_too() -> None:
    line = Line(last=100)
    true, forged = count(101), count(131)
    for _ in range(40):
        line.send(next(true))
        line.send(next(forged), next(forged), who=1, after_ns=1000)
    assert line.who.count(1) > 10
    assert line.doubled
    line.who.clear()
    line.send(*(next(true) for _ in range(60)))
    assert line.who[-10:] == [0] * 10
