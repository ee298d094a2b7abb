"""The speed meter, mark by mark: what it tells, when it calls the mark lost, when it doubts it."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, pi

import pytest

from firmware_py.acquire.speed import AHEAD_MAX_US, SpeedMeter, Turn

RAMP_RAD_S2 = 4000 * pi / 30
FRAME_US = 600
RANGE_US = 2**32
MINUTE_US = 60_000_000


class Marks:
    """Frames every 600 us whose newest mark a test sets, with ticks that do not wrap."""

    def __init__(
        self,
        start_us: int = 5 * RANGE_US,
        mark_us: int | None = None,
        turn: int = 65_530,
        quiet: bool = False,
    ) -> None:
        self.meter = SpeedMeter(RAMP_RAD_S2)
        self.seen(quiet)
        self.now_us = start_us
        self.mark_us = start_us - 1000 if mark_us is None else mark_us
        self.turn = turn
        self.said: list[Turn] = []
        self.frame()

    def seen(self, quiet: bool) -> Marks:
        """What the probes have shown for long."""
        self.meter.hear_motion(*((60.0, 0.0) if quiet else (0.0, 60.0)))
        return self

    def frame(self) -> None:
        turn = self.meter.mark(self.mark_us & 0xFFFFFFFF, self.turn & 0xFFFF, self.now_us)
        self.said += [] if turn is None else [turn]
        self.meter.idle(self.now_us)

    def wait(self, us: int, step_us: int = FRAME_US) -> Marks:
        until_us = self.now_us + us
        while self.now_us + step_us <= until_us:
            self.now_us += step_us
            self.frame()
        return self

    def edge(self, after_us: float, turns: int = 1) -> Marks:
        """The next mark comes ``after_us`` after the last one."""
        at_us = round(self.mark_us + after_us)
        self.wait(at_us - self.now_us)
        self.now_us = max(self.now_us, at_us) + 100
        self.mark_us, self.turn = at_us, self.turn + turns
        self.frame()
        return self

    def turning(self, rpm: float, turns: int) -> Marks:
        for _ in range(turns):
            self.edge(60e6 / rpm)
        return self

    @property
    def rpm(self) -> float:
        return self.meter.state.speed_rad_s * 30 / pi

    def doubts(self) -> list[str]:
        return [turn.doubt for turn in self.said if turn.doubt]


def running(rpm: float = 6000.0, turns: int = 5) -> Marks:
    """Two marks are awaited, then the speed is known."""
    marks = Marks()
    marks.edge(5000).turning(rpm, turns)
    assert marks.rpm == pytest.approx(rpm, rel=1e-3)
    assert marks.meter.state.known
    assert not marks.doubts()
    return marks


# ------------------------------------------------------------------ standing


@pytest.mark.parametrize("minutes", [1, 35, 36, 37, 71, 72, 80, 150])
def test_a_shaft_that_stood_for_longer_than_the_ticks_range_starts_rightly(minutes: int) -> None:
    marks = running(60.0, 3).seen(quiet=True)
    marks.wait(minutes * MINUTE_US, step_us=36_600)
    assert (marks.rpm, marks.meter.state.lost) == (0.0, False)
    marks.edge(marks.now_us - marks.mark_us + 50_000)
    assert marks.rpm < 2.0
    marks.turning(3000.0, 3)
    assert marks.rpm == pytest.approx(3000.0, rel=1e-3)
    assert marks.meter.state.known
    assert not marks.doubts()


@pytest.mark.parametrize("minutes", [0.2, 1, 35, 36, 71, 71.6, 72, 150, 10_000])
def test_a_guard_that_starts_beside_a_standing_shaft_tells_0_and_then_the_right_speed(
    minutes: float,
) -> None:
    start_us = 200_000 * MINUTE_US
    marks = Marks(start_us, start_us - round(minutes * MINUTE_US), quiet=True)
    marks.wait(6_400_000)
    assert (marks.rpm, marks.meter.state.lost) == (0.0, False)
    marks.edge(marks.now_us - marks.mark_us + 20_000)
    assert marks.rpm == 0.0, "how long the shaft stood is not known"
    marks.turning(3000.0, 2)
    assert marks.rpm == pytest.approx(3000.0, rel=1e-3)
    assert marks.meter.state.known


def test_a_mark_that_is_old_at_the_start_is_standing_at_once_and_a_young_one_is_unknown() -> None:
    old, young = (
        Marks(mark_us=5 * RANGE_US - age_us, quiet=True) for age_us in (7_000_000, 5_000_000)
    )
    assert (old.rpm, old.meter.state.lost) == (0.0, False)
    assert young.meter.state.lost


def test_the_first_mark_after_the_start_is_not_paired_with_one_of_unknown_age() -> None:
    marks = Marks(mark_us=5 * RANGE_US - 10_000)  # or 71.6 minutes and 10 ms ago
    marks.edge(20_000)
    assert marks.meter.state.lost
    assert not marks.said


def test_a_shaft_that_slows_within_its_ramp_comes_to_rest() -> None:
    marks = running(30.0, 3).seen(quiet=True)
    marks.wait(9_000_000)
    assert (marks.rpm, marks.meter.state.known) == (0.0, True)


def slowing(rpm_at: Callable[[float], float], until_rpm: float = 60.0) -> list[float]:
    """Times (s) of the marks of a shaft whose speed falls so."""
    at_s, turned, found, step_s = 0.0, 0.0, [], 1e-4
    while rpm_at(at_s) > until_rpm:
        before, turned, at_s = turned, turned + rpm_at(at_s) / 60 * step_s, at_s + step_s
        if int(turned) != int(before):
            found.append(at_s - step_s * (turned - int(turned)) / (turned - before))
    return found


RUN_DOWNS: dict[str, Callable[[float], float]] = {
    "declared ramp": lambda t: 3000.0 - 4000.0 * t,
    "half of it": lambda t: 3000.0 - 2000.0 * t,
    "exponential": lambda t: 3000.0 * exp(-t / 0.8),
}


@pytest.mark.parametrize("name", RUN_DOWNS)
def test_a_run_down_is_told_as_it_is_between_the_marks_too(name: str) -> None:
    rpm_at, marks = RUN_DOWNS[name], running(3000.0)
    start_us = marks.mark_us
    for at_s in slowing(rpm_at):
        turn_us = round(start_us + at_s * 1e6) - marks.mark_us
        while marks.now_us + FRAME_US < marks.mark_us + turn_us:
            marks.wait(FRAME_US)
            true_rpm = rpm_at((marks.now_us - start_us) * 1e-6)
            wait_us = marks.now_us - marks.mark_us
            assert marks.meter.state.known
            assert marks.rpm <= 60e6 / wait_us * 1.0001, "never above what the wait allows"
            assert marks.rpm >= true_rpm * 0.999, "nor below the shaft"
        marks.edge(turn_us)
    last_rpm = marks.rpm
    marks.wait(3_000_000)
    assert marks.rpm == pytest.approx(60e6 / (marks.now_us - marks.mark_us), rel=1e-3)
    assert marks.rpm < last_rpm
    marks.seen(quiet=True).wait(4_000_000)
    assert (marks.rpm, marks.meter.state.known) == (0.0, True)
    assert not marks.doubts()


def test_a_slow_run_down_of_a_shaft_that_is_not_quiet_is_no_standing_shaft() -> None:
    """At 1000 rpm the marks alone cannot tell a stop from a cut cable."""
    marks = running(1000.0).wait(6_000_000)
    assert marks.meter.state.known
    assert marks.rpm < 11.0
    marks.wait(1_000_000)
    assert marks.meter.state.lost
    marks.wait(60_000_000, step_us=6000)
    assert marks.meter.state.lost
    marks.seen(quiet=True).wait(6000)
    assert (marks.rpm, marks.meter.state.known) == (0.0, True)


def test_below_is_sure_by_marks_or_by_a_quiet_shaft_and_not_by_a_wait_alone() -> None:
    marks = running(1000.0)
    slow = 300 * pi / 30
    marks.wait(1_000_000)
    assert not marks.meter.state.surely_below(slow), "the cable may be cut"
    marks.seen(quiet=True)
    assert marks.meter.state.surely_below(slow)
    torn = running(6000.0).seen(quiet=True).wait(1_000_000)
    assert not torn.meter.state.surely_below(slow)
    assert running(200.0).meter.state.surely_below(slow)


def test_a_shaft_that_stood_and_moves_for_long_is_not_known_to_stand() -> None:
    marks = running(30.0, 3).seen(quiet=True).wait(9_000_000)
    marks.meter.hear_motion(0.0, 2.9)
    assert marks.wait(FRAME_US).meter.state.known
    marks.meter.hear_motion(0.0, 3.0)
    assert marks.wait(FRAME_US).meter.state.lost
    marks.meter.hear_motion(1.4, 0.0)
    assert marks.wait(FRAME_US).meter.state.lost
    marks.meter.hear_motion(1.5, 0.0)
    assert marks.wait(FRAME_US).meter.state.known


def test_a_turning_gear_slower_than_standstill_keeps_its_speed() -> None:
    marks = running(9.0, 3)
    for _ in range(4):
        marks.edge(60e6 / 9.0)
        assert marks.meter.state.known
        assert marks.rpm == pytest.approx(9.0, rel=1e-3)


# ------------------------------------------------------------------ lost


@pytest.mark.parametrize("rpm", [1500.0, 6000.0, 12000.0])
def test_a_mark_that_stops_faster_than_any_ramp_is_lost_and_never_standing(rpm: float) -> None:
    marks = running(rpm)
    marks.wait(round(1.9 * 60e6 / rpm))
    assert not marks.meter.state.lost
    marks.wait(round(0.4 * 60e6 / rpm))
    assert marks.meter.state.lost
    marks.wait(20_000_000, step_us=6000)
    assert marks.meter.state.lost, "a cut cable is no standing shaft"
    assert marks.rpm == pytest.approx(rpm, rel=1e-3), "the last reading"
    assert marks.meter.state.torn


@pytest.mark.parametrize("rpm", [1500.0, 6000.0, 12000.0])
@pytest.mark.parametrize("invalid", [False, True])
def test_a_stop_faster_than_any_ramp_is_told_once_the_shaft_is_quiet_and_starts_anew(
    rpm: float, invalid: bool
) -> None:
    """Braked hard or seized; the node may call the mark not valid for a while."""
    marks = running(rpm)
    if invalid:
        marks.meter.lose()
    marks.seen(quiet=True).wait(5_000_000)
    assert marks.meter.state.lost
    assert marks.meter.state.torn
    marks.wait(1_500_000)
    assert (marks.rpm, marks.meter.state.known) == (0.0, True)
    assert not marks.meter.state.torn
    marks.seen(quiet=False)
    marks.edge(marks.now_us - marks.mark_us + 20_000).turning(300.0, 3)
    assert marks.rpm == pytest.approx(300.0, rel=1e-3)
    assert not marks.doubts()


def test_a_cable_that_makes_contact_again_brings_the_speed_back() -> None:
    marks = running().wait(20_000_000)
    assert marks.meter.state.lost
    marks.edge(marks.now_us - marks.mark_us + 5_000, turns=2000).turning(6000.0, 2)
    assert marks.meter.state.known
    assert marks.rpm == pytest.approx(6000.0, rel=1e-3)
    assert not marks.doubts()


def test_two_new_marks_bring_a_lost_speed_back() -> None:
    marks = running()
    marks.meter.lose()
    assert marks.meter.state.lost
    marks.wait(3000)
    marks.edge(10_000)
    assert marks.meter.state.lost
    marks.edge(10_000)
    assert marks.meter.state.known
    assert marks.rpm == pytest.approx(6000.0)


def test_a_mark_that_comes_back_twice_as_fast_is_doubted() -> None:
    marks = running()
    marks.meter.lose()
    marks.wait(3000)
    marks.turning(12_000.0, 3)
    assert marks.doubts() == ["ramp"]


def test_lost_frames_are_no_doubt() -> None:
    marks = running()
    marks.edge(40_000, turns=4)
    assert marks.rpm == pytest.approx(6000.0, rel=1e-3)
    assert not marks.doubts()


# ------------------------------------------------------------------ honest ramps


@pytest.mark.parametrize("rate", [-6000.0, -4000.0, -1000.0, 1000.0, 4000.0])
@pytest.mark.parametrize("coarse_us", [1, 5, 200])
def test_no_declared_ramp_is_doubted_however_coarse_the_marks(rate: float, coarse_us: int) -> None:
    marks, rpm, at_us = Marks(), 1500.0 if rate > 0 else 12_000.0, 0.0
    start_us = marks.mark_us
    for _ in range(400):
        if not 1450.0 < rpm < 12_100.0:
            break
        turn_us = 60e6 / (rpm + rate * 0.5 * 60 / rpm)
        at_us += turn_us
        rpm += rate * turn_us * 1e-6
        marks.edge(round(at_us / coarse_us) * coarse_us + start_us - marks.mark_us)
    assert not marks.doubts()


@pytest.mark.parametrize("rpm", [1500.0, 3500.0, 7000.0, 11_700.0])
@pytest.mark.parametrize("share", [0.0, 0.015])
def test_jitter_of_the_edge_is_no_doubt(rpm: float, share: float) -> None:
    marks, turn_us = running(rpm), 60e6 / rpm
    for k in range(200):
        marks.edge(turn_us * (1 + share * (-1) ** k) + 90 * (-1) ** (k // 3))
    assert not marks.doubts()


# ------------------------------------------------------------------ what no shaft does


SPEEDS = pytest.mark.parametrize("rpm", [1500.0, 3000.0, 6000.0, 12_000.0])


@SPEEDS
@pytest.mark.parametrize("edges", [(0.5, 0.5), (0.3, 0.7), (1 / 3, 1 / 3, 1 / 3), (0.05, 0.95)])
def test_edges_too_many_are_doubted_with_the_first_reading(
    rpm: float, edges: tuple[float, ...]
) -> None:
    marks = running(rpm)
    marks.edge(edges[0] * 60e6 / rpm)
    assert marks.doubts() == ["ramp"]
    assert not marks.meter.state.known
    assert marks.rpm == pytest.approx(rpm / edges[0], rel=0.05), "it is told as it is"
    for _ in range(30):
        for edge in (*edges[1:], edges[0]):
            marks.edge(edge * 60e6 / rpm)
    assert not marks.meter.state.known


@SPEEDS
@pytest.mark.parametrize("missing", [1, 2])
def test_missing_edges_are_doubted_with_the_first_late_mark(rpm: float, missing: int) -> None:
    marks = running(rpm)
    for _ in range(20):
        marks.edge((1 + missing) * 60e6 / rpm)
    assert not marks.meter.state.known or marks.rpm < 1000.0, (
        "where two turns without a mark may be a slow one"
    )


@SPEEDS
@pytest.mark.parametrize("false_us", [[0.4, 0.6], [2.0], [0.2, 0.3, 0.5], [0.98, 0.02]])
def test_a_false_edge_now_and_then_is_a_doubt_from_which_the_speed_returns(
    rpm: float, false_us: list[float]
) -> None:
    marks = running(rpm)
    for share in false_us:
        marks.edge(share * 60e6 / rpm)
    marks.turning(rpm, 3)
    assert any(turn.returned for turn in marks.said)
    assert marks.meter.state.doubted, "until somebody ends it"
    marks.meter.doubt(False)
    marks.turning(rpm, 10)
    assert marks.meter.state.known


@pytest.mark.parametrize("jump", [1.3, 1.5, 2.0, 3.0])
def test_a_speed_that_stays_elsewhere_never_returns(jump: float) -> None:
    marks = running(6000.0)
    marks.turning(6000.0 * jump, 500)
    assert marks.doubts() == ["ramp"]
    assert not any(turn.returned for turn in marks.said)


def test_a_fault_that_ends_after_its_time_does_not_bring_the_former_course_back() -> None:
    marks = running(6000.0)
    marks.turning(12_000.0, 400).turning(6000.0, 5)
    assert marks.doubts() == ["ramp", "ramp"]
    assert not any(turn.returned for turn in marks.said)


def test_many_small_steps_that_together_are_faster_than_the_ramp_are_doubted() -> None:
    marks, rpm = running(6000.0), 6000.0
    for _ in range(40):
        rpm *= 1.02
        marks.turning(rpm, 1)
    assert "ramp" in marks.doubts()


def contradictions() -> dict[str, tuple[int, int]]:
    """Turns and microseconds by which the next mark goes on."""
    return {
        "turn number without tick": (1, 0),
        "tick without turn number": (0, 9_000),
        "turn number backward": (-1, 9_000),
        "turn number far backward": (-1000, 9_000),
        "tick backward": (1, -10_000),
        "tick half an hour back": (1, -30 * MINUTE_US),
    }


@pytest.mark.parametrize("case", contradictions())
def test_a_tick_and_a_number_that_contradict_each_other_are_doubted(case: str) -> None:
    turns, ticks = contradictions()[case]
    marks = running()
    marks.wait(9_000)
    marks.mark_us, marks.turn = marks.mark_us + ticks, marks.turn + turns
    marks.wait(FRAME_US)
    assert marks.doubts() == ["count"]
    assert (marks.meter.state.lost, marks.meter.state.doubted) == (True, True)
    marks.edge(marks.now_us - marks.mark_us + 1000).turning(6000.0, 3)
    assert marks.rpm == pytest.approx(6000.0, rel=0.01)
    assert not marks.meter.state.lost
    assert any(turn.returned for turn in marks.said)


@pytest.mark.parametrize("ahead_us", [AHEAD_MAX_US + 1, 5_000, 1_000_000, 2**31 - 1])
def test_a_mark_later_than_its_frame_is_doubted(ahead_us: int) -> None:
    marks = running()
    marks.wait(9_000)
    marks.mark_us, marks.turn = marks.now_us + FRAME_US + ahead_us, marks.turn + 1
    marks.wait(FRAME_US)
    assert marks.doubts() == ["ahead"]
    for _ in range(5):
        marks.wait(9_600)
        marks.mark_us, marks.turn = marks.mark_us + 10_200, marks.turn + 1
        marks.wait(FRAME_US)
    assert marks.doubts() == ["ahead"] * 6
    assert marks.meter.state.lost


def test_a_mark_that_no_frame_told_when_it_came_is_doubted() -> None:
    marks = running(60.0, 3)
    marks.wait(1_100_000)
    marks.mark_us, marks.turn = marks.mark_us + 1_000_000, marks.turn + 1
    marks.wait(FRAME_US)
    assert marks.doubts() == ["count"]


def test_a_mark_within_the_wander_of_the_grid_is_good() -> None:
    marks = running()
    for _ in range(5):
        marks.wait(9_600)
        marks.mark_us, marks.turn = marks.now_us + FRAME_US + AHEAD_MAX_US, marks.turn + 1
        marks.wait(FRAME_US)
    assert not marks.doubts()


@pytest.mark.parametrize("step", [2, 3])
def test_a_turn_number_that_steps_too_far_is_doubted(step: int) -> None:
    marks = running()
    marks.edge(10_000, turns=step)
    assert marks.doubts() == ["ramp"]
    assert marks.rpm == pytest.approx(6000.0 * step, rel=1e-3)


def test_a_clock_that_jumped_leaves_nothing_to_compare_with() -> None:
    marks = running()
    marks.meter.forget()
    marks.wait(3000)
    marks.turning(12_000.0, 3)
    assert marks.meter.state.known
    assert marks.rpm == pytest.approx(12_000.0)
