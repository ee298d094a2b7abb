"""The story is drawn from the seed, keeps to the declared range, and leaves out acts only as it
says."""

from __future__ import annotations

import itertools

import msgspec
import pytest

from firmware_py.config import SHIPPED, load
from sim_hil.demo.play import lacking
from sim_hil.demo.report import CLASSIFIER, COMMAND, NEEDS, TERMS
from sim_hil.demo.story import (
    BOLT_PRELOADS_PERCENT,
    FAULT_VERDICTS,
    UNBALANCE_GRADES_G,
    Story,
    draw,
)

OPERATING = load(SHIPPED / "bench")[0].machine.operating


def story(seconds: float = 120.0, seed: int = 1, fault: str | None = None) -> Story:
    return draw(seconds, seed, OPERATING, fault)


def test_same_seed_same_story() -> None:
    assert story(seed=5) == story(seed=5)
    assert story(seed=5).beats != story(seed=6).beats


@pytest.mark.parametrize("seed", range(20))
def test_operating_points_keep_the_declared_range_and_ramps(seed: int) -> None:
    points = [beat for beat in story(seed=seed).beats if beat.verb == "operating"]
    for before, after in itertools.pairwise(points):
        assert OPERATING.speed_min_rpm <= after.speed_rpm <= OPERATING.speed_max_rpm
        assert OPERATING.load_min_N <= after.load_N <= OPERATING.load_max_N
        assert (
            abs(after.speed_rpm - before.speed_rpm)
            <= OPERATING.speed_ramp_unannounced_rpm_s * after.ramp_s
        )
        assert (
            abs(after.load_N - before.load_N) <= OPERATING.load_ramp_unannounced_N_s * after.ramp_s
        )
        assert after.t_s >= before.t_s + before.ramp_s


@pytest.mark.parametrize(
    ("seconds", "acts"),
    [
        (120.0, ["healthy", "duty", "fault", "fault", "kill"]),
        (50.0, ["healthy", "duty", "fault", "kill"]),
        (30.0, ["healthy", "duty", "fault"]),
    ],
)
def test_short_stories_leave_out_the_last_acts(seconds: float, acts: list[str]) -> None:
    told = story(seconds)
    assert [act.name for act in told.acts] == acts
    assert told.acts[-1].end_s == pytest.approx(seconds)
    assert all(0 <= beat.t_s < seconds for beat in told.beats)


@pytest.mark.parametrize("fault", sorted(FAULT_VERDICTS))
def test_second_fault_can_be_chosen_and_has_a_required_severity(fault: str) -> None:
    injected = [beat for beat in story(fault=fault).beats if beat.verb == "inject"]
    assert [beat.fault for beat in injected] == ["unbalance", fault]
    for beat in injected:
        assert beat.severity in (
            UNBALANCE_GRADES_G if beat.fault == "unbalance" else BOLT_PRELOADS_PERCENT
        )


def test_every_fault_is_cleared_before_the_next_act() -> None:
    beats = story().beats
    for index, beat in enumerate(beats):
        if beat.verb == "inject":
            following = next(later for later in beats[index + 1 :] if later.verb != "operating")
            assert (following.verb, following.fault) == ("clear", beat.fault)


def test_acts_follow_one_another() -> None:
    told = story()
    assert told.acts[0].start_s == 0.0
    for before, after in zip(told.acts, told.acts[1:], strict=False):
        assert after.start_s == pytest.approx(before.end_s)
        assert told.act_at(after.start_s + 0.01) is after
    assert told.act_at(1e9) is told.acts[-1]


def test_a_machine_of_another_range_is_told_a_story_of_its_own() -> None:
    slow = msgspec.structs.replace(
        OPERATING,
        speed_min_rpm=200.0,
        speed_max_rpm=900.0,
        load_min_N=2000.0,
        load_max_N=9000.0,
        load_ramp_unannounced_N_s=2000.0,
    )
    points = [beat for beat in draw(120.0, 3, slow).beats if beat.verb == "operating"]
    assert all(200.0 <= beat.speed_rpm <= 900.0 for beat in points)
    assert all(2000.0 <= beat.load_N <= 9000.0 for beat in points)
    assert len({beat.load_N for beat in points}) > 2


def test_a_machine_whose_range_is_narrow_is_told_one_too() -> None:
    narrow = load(SHIPPED / "seed")[0].machine.operating
    for seed in range(20):
        speeds = [b.speed_rpm for b in draw(120.0, seed, narrow).beats if b.verb == "operating"]
        assert narrow.speed_min_rpm <= min(speeds) <= max(speeds) <= narrow.speed_max_rpm


def test_what_a_device_cannot_do_on_a_machine_is_named_and_not_judged() -> None:
    assert lacking(load(SHIPPED / "bench")[0]) == {}
    told = lacking(load(SHIPPED / "seed")[0])
    assert told[COMMAND].startswith("monitor only: feed_port: 4 orifices")
    assert "made for 'bench'" in told[CLASSIFIER]
    assert set(NEEDS) < set(TERMS)
