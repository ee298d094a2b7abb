import pytest

from firmware_py.acquire.counting import CONFIRM, NEAR, REORDERED, REPEATED, RESTARTED, CounterTrack, advance


def track(last: int) -> CounterTrack:
    return CounterTrack(last=last)


@pytest.mark.parametrize("last", [0, 1, 100, 65533, 65534, 65535])
@pytest.mark.parametrize("jump", range(1, NEAR + 1))
def test_a_near_jump_forward_is_a_loss_across_the_wrap(last: int, jump: int) -> None:
    t = track(last)
    assert advance(t, (last + jump) & 0xFFFF) == jump - 1
    assert advance(t, (last + jump + 1) & 0xFFFF) == 0


@pytest.mark.parametrize("last", [0, 30, 65535])
@pytest.mark.parametrize("back", [1, 2, NEAR - 1, NEAR])
def test_a_near_jump_backward_is_a_late_frame_and_never_moves_the_track(last: int, back: int) -> None:
    t = track(last)
    for _ in range(5):
        assert advance(t, (last - back) & 0xFFFF) == REORDERED
    assert advance(t, (last + 1) & 0xFFFF) == 0


def test_the_same_counter_again_is_a_repeat() -> None:
    t = track(-1)
    assert advance(t, 7) == 0
    assert advance(t, 7) == REPEATED
    assert advance(t, 8) == 0


@pytest.mark.parametrize("jump", [NEAR + 1, 1000, 0x7FFF, 0x8000, 0xFFFF - NEAR])
def test_one_forged_far_jump_does_not_push_the_true_frames_out(jump: int) -> None:
    t = track(500)
    assert advance(t, (500 + jump) & 0xFFFF) == REORDERED
    assert advance(t, 501) == 0
    assert advance(t, 502) == 0


def test_a_far_jump_that_continues_is_believed_and_counts_what_was_lost() -> None:
    t = track(500)
    verdicts = [advance(t, 2000 + i) for i in range(CONFIRM + 1)]
    assert verdicts == [REORDERED] * (CONFIRM - 1) + [2000 + CONFIRM - 1 - 501, 0]


def test_a_counter_that_begins_anew_is_a_restart() -> None:
    t = track(5000)
    verdicts = [advance(t, i) for i in range(CONFIRM + 1)]
    assert verdicts == [REORDERED] * (CONFIRM - 1) + [RESTARTED, 0]


def test_far_frames_that_do_not_continue_each_other_are_never_believed() -> None:
    t = track(500)
    for counter in (3000, 4000, 5000, 3001, 4001, 5001) * 3:
        assert advance(t, counter) == REORDERED
