"""The bound: limits are judged as written, the dynamic program finds the cheapest path, causality
holds."""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from sim_hil import bound
from sim_hil.bound.case import BoundCase, LimitVerdict, TargetPlan, gather
from sim_hil.bound.disturbances import AdmissibleRanges, RampLimits
from sim_hil.bound.kept import kept_profile
from sim_hil.bound.limits import BoundLimits, duty_of, orbit_share
from sim_hil.bound.maps import Map
from sim_hil.bound.reference import cut, references
from sim_hil.bound.schedules import NoSchedule, causal, foreseen, narrowed, preview, viable
from sim_hil.bound.study import study
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import Trajectory
from sim_hil.rigs import load_rig
from sim_hil.rotor.rigid import COLUMNS

LIMITS = BoundLimits(10e-6, 50e-6)
DUTY_FILE = Path(__file__).resolve().parents[4] / "shared/reference/duty_bench.json"
NO_MARGIN = np.zeros(1, dtype=int)
RATE = 20e-6  # two cells of 1 um in a bin of 0.1 s


def made_map(cells=6, bins=6, seed=3, blocked=0.2, pressures=1):
    rng = np.random.default_rng(seed)
    open_ = np.where(rng.random((pressures, cells, bins)) < blocked, -1.0, 1.0)
    open_[:, 0] = 1.0
    power = rng.uniform(50, 100, (pressures, cells, bins))
    return Map(
        1e5 * np.arange(pressures),
        (40 + np.arange(cells)) * 1e-6,
        power,
        open_,
        np.ones(open_.shape),
    )


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


def judge(run, limits):
    return LimitVerdict.of(gather(run, limits))


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
    seen = np.unique(
        np.floor((run.column("angle_rad")[share > 0.3] - run.column("angle_rad")[0]) / (2 * np.pi))
    )
    assert (seen.min(), seen.max()) == (30, 49)


def test_present_clearance_counts():
    run = circling(12e-6)
    run.rows[:, COLUMNS.index("clearance_m")] = 40e-6
    assert not judge(run, LIMITS).feasible


@pytest.mark.skipif(not DUTY_FILE.exists(), reason="no ../shared/reference beside the repository")
def test_the_published_duty_file_is_the_published_duty():
    table = json.loads(DUTY_FILE.read_text())
    rig = load_rig("bench")
    assert duty_of(table) == Duty.published(rig)
    for limits in (BoundLimits.of(table), BoundLimits.of_rig(rig)):
        assert (limits.min_film_m, limits.rate_m_s) == pytest.approx(
            (LIMITS.min_film_m, LIMITS.rate_m_s)
        )


@pytest.mark.parametrize(("seed", "pressures"), [(0, 1), (1, 1), (2, 2), (3, 2)])
def test_preview_is_the_cheapest_of_all_paths(seed, pressures):
    found = made_map(5, 5, seed, pressures=pressures)
    _, cells, bins = found.power_W.shape
    cost = np.where(found.admissible, found.power_W, np.inf).min(axis=0)
    paths = [
        np.mean([cost[c, k] for k, c in enumerate(path)])
        for path in itertools.product(range(cells), repeat=bins)
        if all(abs(b - a) <= 2 for a, b in itertools.pairwise(path))
    ]
    if not np.isfinite(min(paths)):
        with pytest.raises(NoSchedule):
            preview(found, NO_MARGIN, RATE, 0.0)
        return
    plan = preview(found, NO_MARGIN, RATE, 0.0)
    assert plan.expected_W == pytest.approx(min(paths))
    assert np.abs(np.diff(plan.clearance_m)).max() <= 2.01e-6


def test_a_given_start_is_kept():
    found = made_map(20, 12, blocked=0.0)
    ready = np.ones((20, 12), dtype=bool)
    for plan in (
        preview(found, NO_MARGIN, RATE, 0.0, 55e-6),
        causal(found, 0, ready, [], RATE, 55e-6),
    ):
        assert plan.clearance_m[0] == pytest.approx(55e-6)


def test_causal_uses_nothing_of_the_future():
    found = made_map(8, 12, blocked=0.0, pressures=2)
    later = dataclasses.replace(
        found, power_W=found.power_W.copy(), film_margin_m=found.film_margin_m.copy()
    )
    later.power_W[..., 8:] = np.random.default_rng(9).uniform(50, 100, (2, 8, 4))
    later.film_margin_m[:, 6:, 9:] = -1
    ready = np.ones((8, 12), dtype=bool)
    ready[5:] = False
    plans = [causal(m, 0, ready, [], RATE) for m in (found, later)]
    np.testing.assert_array_equal(plans[0].clearance_m[:9], plans[1].clearance_m[:9])
    np.testing.assert_array_equal(plans[0].pressure_Pa[:9], plans[1].pressure_Pa[:9])


def test_an_announced_ramp_is_weathered_to_its_end_and_met_in_time():
    allowed, ready = np.ones((9, 12), dtype=bool), np.ones((9, 12), dtype=bool)
    allowed[3:, 8] = False
    kept = foreseen(allowed, ready, [(2, 6, 8)], 2)
    assert [column.sum() for column in kept.T] == [9, 9, 9, 9, 7, 7, 7, 5, 3, 9, 9, 9]


def test_ready_for_any_ramp_that_nobody_announces():
    """Load may rise by 50 N/s from 100 to 200 N, where 20 cells are left, in 2 s; the actuator
    makes 5 um/s."""
    case = BoundCase(load_rig("bench"), Duty.hold(3000, 100, 1.0), LIMITS, False)
    around = AdmissibleRanges(
        np.array([3000.0, 3000.0]), np.array([100.0, 200.0]), np.zeros(2), np.array([100.0, 20.0])
    )
    ready = around.ready(case, RampLimits(), 5e-6, 121)
    assert np.flatnonzero(ready[:, 0])[-1] == int(20 + 5 * (2 - 0.25))
    slower = around.ready(case, RampLimits(load_ramp_N_s=10.0), 5e-6, 121)
    assert np.flatnonzero(slower[:, 0])[-1] == int(20 + 5 * (10 - 0.25))


def test_only_ramps_faster_than_declared_are_announced():
    duty = Duty(
        (0.0, 2.0, 4.0, 5.0, 6.0), (3000, 3000, 3000, 3000, 6000), (100, 100, 200, 300, 300)
    )
    assert RampLimits().announced(duty) == [(40, 50), (50, 60)]


def test_a_step_is_announced():
    assert RampLimits().announced(Duty((0.0, 1.0, 1.0), (3000, 3000, 3000), (100, 100, 101))) == [
        (10, 10)
    ]


def test_a_duty_is_cut():
    duty = cut(Duty((0.0, 2.0, 4.0), (3000, 3000, 6000), (100, 100, 200)), 3.0)
    assert duty == Duty((0.0, 2.0, 3.0), (3000, 3000, pytest.approx(4500)), (100, 100, 150))


def test_a_ramp_is_seen_to_its_end():
    allowed = np.ones((9, 6), dtype=bool)
    allowed[3:, 5] = False
    kept = viable(allowed, 2)
    assert [column.sum() for column in kept.T] == [9, 9, 9, 7, 5, 3]


def test_margins_keep_away_from_what_is_not_admissible_in_their_bins():
    allowed = np.ones((1, 9, 9), dtype=bool)
    allowed[0, 8] = False
    kept = narrowed(allowed, np.array([0, 0, 0, 2, 2, 1, 0, 0, 0]))[0]
    assert kept.sum(axis=0).tolist() == [8, 8, 8, 6, 6, 7, 8, 8, 8]


def test_a_plan_is_read_ahead_by_the_lag():
    plan = preview(made_map(6, 6, blocked=0.0), NO_MARGIN, RATE, 0.05)
    assert plan.clearance(0.05) == pytest.approx(plan.clearance_m[1])


def test_pressure_is_held_through_its_bin():
    plan = TargetPlan(np.full(3, 60e-6), np.array([1e5, 2e5, 3e5]))
    assert [plan.pressure(t) for t in (-1.0, 0.0, 0.15, 0.2, 9.0)] == [1e5, 1e5, 2e5, 3e5, 3e5]


@pytest.mark.parametrize("text", ["{", "[]", '{"start": {"rpm": 1}}'])
def test_a_wrong_duty_file_is_refused(text, tmp_path):
    path = tmp_path / "duty.json"
    path.write_text(text)
    with pytest.raises(bound.DutyFileError):
        bound.main(["--duty", str(path)])


def test_power_falls_and_film_shrinks_with_clearance_on_a_short_duty():
    case = BoundCase(load_rig("bench"), Duty.hold(1500, 300, 1.0), LIMITS, False)
    narrow, wide = (case.profile(TargetPlan.fixed(c, 1e5)) for c in (50e-6, 90e-6))
    assert narrow.power_W.size == 10
    assert narrow.power_W.mean() > wide.power_W.mean()
    assert narrow.min_film_m.min() > 10e-6 > wide.min_film_m.min()
    assert (LimitVerdict.of(narrow).violation_s, LimitVerdict.of(wide).violation_s) == (
        0.0,
        pytest.approx(1.0),
    )


def test_the_pump_counts_in_a_fed_film():
    case = BoundCase(load_rig("bench"), Duty.hold(12000, 30, 0.5), LIMITS, False, fed=True)
    low, high = (
        case.profile(TargetPlan.fixed(60e-6, pressure)).power_W.mean() for pressure in (0.5e5, 3e5)
    )
    assert 5 < high - low < 20  # of which friction takes about six watts


def test_supply_pressure_holds_off_whirl():
    case = BoundCase(load_rig("bench"), Duty.hold(12000, 30, 0.5), LIMITS, False)
    unfed, fed = (
        c.profile(TargetPlan.fixed(80e-6, 1e5)) for c in (case, dataclasses.replace(case, fed=True))
    )
    assert LimitVerdict.of(unfed).orbit_share > 1 > 0.5 > LimitVerdict.of(fed).orbit_share


def test_profiles_are_kept_under_what_decides_them(tmp_path, monkeypatch):
    monkeypatch.setattr("sim_hil.bound.kept._folder", lambda: tmp_path / "kept")
    case, plan = (
        BoundCase(load_rig("bench"), Duty.hold(6000, 100, 0.3), LIMITS, False),
        TargetPlan.fixed(60e-6, 1e5),
    )
    first = kept_profile(case, plan)
    path = next((tmp_path / "kept").iterdir())
    np.savez(path, profile=np.zeros((4, 3)))
    assert kept_profile(case, plan).power_W.max() == 0.0 < first.power_W.min()
    assert (
        kept_profile(dataclasses.replace(case, inlet_C=45.0), plan).power_W.max()
        < first.power_W.min()
    )


@pytest.mark.slow
def test_a_short_duty_is_bounded_in_order():
    duty = Duty(
        (0.0, 2.0, 5.0, 7.0, 10.0), (6000, 1500, 1500, 6000, 6000), (100, 300, 300, 100, 100)
    )
    case = BoundCase(load_rig("bench"), duty, LIMITS, False)
    entries = {e.name: e.verdict for e in study(case, (10, 10))}
    assert all(v.feasible for name, v in entries.items() if name != "nominal fixed")
    powers = [
        entries[n].mean_power_W
        for n in ("preview schedule", "causal schedule", "best feasible fixed")
    ]
    assert powers == sorted(powers)


@pytest.mark.slow
def test_references_of_a_build_from_where_it_stands():
    rig = load_rig("bench")
    duty = Duty((0.0, 3.0, 5.0), (9000, 9000, 4000), (60, 60, 100))
    found = references(
        rig,
        duty,
        build=Build.of_seed(rig, 1),
        inlet_C=42.0,
        seconds=6.0,
        start_m=50e-6,
        spacing_um=12,
    )
    for way in (found.preview, found.causal):
        assert way is not None
        assert way.verdict.feasible
        assert way.plan.clearance(0.0) == pytest.approx(50e-6, abs=3e-6)
    assert found.preview.verdict.mean_power_W <= 1.005 * found.causal.verdict.mean_power_W
    assert found.preview.verdict.mean_power_W < found.map.power_W[0, 10].mean()


@pytest.mark.slow
def test_references_of_an_episode_are_its_own_environments():
    episode, found = bound.episode_references(3, episode_s=6.0, spacing_um=20)
    env = RotorVectorEnv(1, episode_s=6.0)
    env.reset(seed=[3])
    assert env.episodes[0].clearance_m == episode.clearance_m
    power = []
    for step in range(60):
        share = (found.preview.plan.clearance(0.1 * step) - 40e-6) / 120e-6
        power.append(env.step(np.array([[2 * share - 1]], dtype=np.float32))[4]["power_W"][0])
    assert np.mean(power) == pytest.approx(found.preview.verdict.mean_power_W, rel=1e-6)
    assert found.preview.verdict.feasible
    assert found.preview.verdict.mean_power_W <= found.causal.verdict.mean_power_W
