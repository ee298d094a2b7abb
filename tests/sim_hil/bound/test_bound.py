"""The bound: limits are judged as written, the dynamic program finds the cheapest path, causality holds."""

import dataclasses
import itertools
import json

import numpy as np
import pytest

from sim_hil import bound
from sim_hil.bound.fixed import Case, Map, profile, stages
from sim_hil.bound.limits import Limits, duty_of, judge, orbit_share
from sim_hil.bound.schedules import NoSchedule, best_causal, causal, narrowed, preview, viable
from sim_hil.bound.study import study
from sim_hil.duty import Duty
from sim_hil.response import Trajectory
from sim_hil.rigs import load_rig, read_json
from sim_hil.rotor.rigid import COLUMNS

LIMITS = Limits(10e-6, 50e-6)
RATE = 20e-6  # two cells of 1 um in a bin of 0.1 s


def made_map(cells=6, bins=6, seed=3, blocked=0.2):
    rng = np.random.default_rng(seed)
    open_ = np.where(rng.random((cells, bins)) < blocked, -1.0, 1.0)
    open_[0] = 1.0
    power = rng.uniform(50, 100, (cells, bins))
    return Map((40 + np.arange(cells)) * 1e-6, np.arange(bins) // 4, power, open_, np.ones((cells, bins)))


def circling(radius_m, turns=60.0, centre_m=0.0, rate_hz=10000.0, speed_hz=100.0):
    n = round(turns / speed_hz * rate_hz)
    time_s = np.arange(1, n + 1) / rate_hz
    rows = np.zeros((n, len(COLUMNS)))
    angle = 2 * np.pi * speed_hz * time_s
    rows[:, COLUMNS.index("x_m")] = centre_m + radius_m * np.cos(angle)
    rows[:, COLUMNS.index("y_m")] = 0.5 * radius_m * np.sin(angle)
    rows[:, COLUMNS.index("min_film_m")] = 20e-6
    rows[:, COLUMNS.index("clearance_m")] = 50e-6
    rows[:, COLUMNS.index("power_W")] = 80.0
    rows[:, COLUMNS.index("angle_rad")] = angle
    return Trajectory(time_s, rows, ())


@pytest.mark.parametrize(("radius_um", "feasible"), [(12.4, True), (12.6, False)])
def test_the_larger_axis_is_held_to_half_the_clearance(radius_um, feasible):
    verdict = judge(circling(radius_um * 1e-6), LIMITS)
    assert verdict.orbit_share == pytest.approx(2 * radius_um / 50, rel=1e-3)
    assert verdict.feasible is feasible


def test_thin_film_breaks_the_limit():
    run = circling(1e-6)
    run.rows[300, COLUMNS.index("min_film_m")] = 9.9e-6
    assert not judge(run, LIMITS).feasible


def test_a_window_sees_twenty_turns_back_and_none_ahead():
    run = circling(1e-6)
    run.rows[3050, 0] += 20e-6  # turn 30
    share = orbit_share(run)
    seen = np.unique(np.floor((run.column("angle_rad")[share > 0.3] - run.column("angle_rad")[0]) / (2 * np.pi)))
    assert (seen.min(), seen.max()) == (30, 49)


def test_present_clearance_counts():
    run = circling(12e-6)
    run.rows[:, COLUMNS.index("clearance_m")] = 40e-6
    assert not judge(run, LIMITS).feasible


def test_the_published_duty_file_is_the_published_duty():
    assert duty_of(read_json("duty_bench.json")) == Duty.published()
    limits = Limits.of(read_json("duty_bench.json"))
    assert (limits.min_film_m, limits.rate_m_s) == pytest.approx((LIMITS.min_film_m, LIMITS.rate_m_s))


@pytest.mark.parametrize("seed", range(4))
def test_preview_is_the_cheapest_of_all_paths(seed):
    found = made_map(5, 5, seed)
    cells, bins = found.power_W.shape
    allowed = narrowed(found.admissible, 0, 1)
    paths = [
        np.mean([found.power_W[c, k] for k, c in enumerate(path)])
        for path in itertools.product(range(cells), repeat=bins)
        if all(allowed[c, k] for k, c in enumerate(path)) and all(abs(b - a) <= 2 for a, b in itertools.pairwise(path))
    ]
    if not paths:
        with pytest.raises(NoSchedule):
            preview(found, 0, 1, RATE, 0.0)
        return
    plan = preview(found, 0, 1, RATE, 0.0)
    assert plan.power_W == pytest.approx(min(paths))
    assert np.abs(np.diff(plan.clearance_m)).max() <= 2.01e-6


def test_causal_uses_nothing_of_the_future():
    found = made_map(8, 12, blocked=0.0)
    later = dataclasses.replace(found, power_W=found.power_W.copy(), film_margin_m=found.film_margin_m.copy())
    later.power_W[:, 8:] = np.random.default_rng(9).uniform(50, 100, (8, 4))
    later.film_margin_m[4:, 9:] = -1  # the stage of bins 4 to 7 ends before
    paths = [causal(m, 0, 2, 3, RATE).clearance_m for m in (found, later)]
    np.testing.assert_array_equal(paths[0][:8], paths[1][:8])


def test_a_ramp_is_seen_to_its_end():
    allowed = np.ones((9, 6), dtype=bool)
    allowed[3:, 5] = False
    kept = viable(allowed, 2)
    assert [column.sum() for column in kept.T] == [9, 9, 9, 7, 5, 3]


def test_a_stage_is_a_ramp_and_the_hold_after_it():
    duty = Duty((0.0, 0.4, 0.6, 1.0, 1.2), (3000, 3000, 6000, 6000, 3000), (100, 100, 100, 100, 100))
    assert stages(duty, 12).tolist() == [0] * 4 + [1] * 6 + [2] * 2


def test_no_preview_is_never_cheaper_than_preview():
    found = made_map(8, 40, blocked=0.02)
    plans = best_causal(found, 0, 1, RATE)
    assert plans
    assert plans[0].power_W >= preview(found, 0, 1, RATE, 0.0).power_W - 1e-9


def test_margins_keep_away_from_what_is_not_admissible():
    margin = np.ones((9, 9))
    margin[8, 4] = -1
    found = Map(np.arange(9) * 1e-6, np.zeros(9), np.ones((9, 9)), margin, np.ones((9, 9)))
    kept = narrowed(found.admissible, 2, 1)
    assert not kept[6:, 3:6].any()
    assert kept[:6].all()
    assert kept[:, :3].all()


def test_a_plan_is_read_ahead_by_the_lag():
    plan = preview(made_map(6, 6, blocked=0.0), 0, 1, RATE, 0.05)
    assert plan(0.05) == pytest.approx(plan.clearance_m[1])


@pytest.mark.parametrize("text", ["{", "[]", '{"start": {"rpm": 1}}'])
def test_a_wrong_duty_file_is_refused(text, tmp_path):
    path = tmp_path / "duty.json"
    path.write_text(text)
    with pytest.raises(bound.DutyFileError):
        bound.main(["--duty", str(path)])


def test_power_falls_and_film_shrinks_with_clearance_on_a_short_duty():
    case = Case(load_rig("bench"), Duty.hold(1500, 300, 1.0), LIMITS, False)
    narrow, wide = profile(case, 50e-6), profile(case, 90e-6)
    assert narrow.power_W.size == 10
    assert narrow.power_W.mean() > wide.power_W.mean()
    assert narrow.min_film_m.min() > 10e-6 > wide.min_film_m.min()


@pytest.mark.slow
def test_a_short_duty_is_bounded_in_order(tmp_path):
    segments = [(1500, 300, 2), (1500, 300, 3), (6000, 100, 2), (6000, 100, 3)]
    table = read_json("duty_bench.json") | {
        "start": {"rpm": 6000, "load_N": 100},
        "segments": [{"to_rpm": r, "to_load_N": load, "seconds": s} for r, load, s in segments],
    }
    path = tmp_path / "duty.json"
    path.write_text(json.dumps(table))
    case = Case(load_rig("bench"), duty_of(bound.read_duty(path)), Limits.of(table), False)
    entries = {e.name: e.verdict for e in study(case, 10)}
    assert all(v.feasible for name, v in entries.items() if name != "nominal fixed")
    powers = [entries[n].mean_power_W for n in ("preview schedule", "causal schedule", "best feasible fixed")]
    assert powers == sorted(powers)
