"""Rigs, builds, duties: the shipped data is the reference data, and the spread is the declared
one."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from sim_hil.build import Build, unbalance_of_grade
from sim_hil.duty import Duty
from sim_hil.rigs import UnknownRig, load_rig, read_json

REFERENCE = Path(__file__).resolve().parents[2].parent / "shared" / "reference"


@pytest.mark.parametrize(
    ("shipped", "given"),
    [
        ("bench.json", "rig_bench.json"),
        ("seed.json", "rig_seed.json"),
        ("sensors.json", "sensors.json"),
        ("classes.json", "classes.json"),
        ("duty_bench.json", "duty_bench.json"),
    ],
)
def test_shipped_data_is_the_reference_data(shipped: str, given: str) -> None:
    if not REFERENCE.is_dir():
        pytest.skip("no ../shared/reference beside the repository")
    assert read_json(shipped) == json.loads((REFERENCE / given).read_text())


def test_effective_mass_and_gravity_share_are_those_of_the_rig_file() -> None:
    rotor = load_rig("bench").rotor
    assert rotor.effective_mass_kg == pytest.approx(1.74)
    assert rotor.gravity_share_N == pytest.approx(29.4, abs=0.05)


def test_unknown_rig_is_refused() -> None:
    with pytest.raises(UnknownRig, match="bench, seed"):
        load_rig("ship")


def test_builds_stay_within_the_declared_spread_and_use_it() -> None:
    rig = load_rig("bench")
    spread = read_json("classes.json")["build_spread"]
    builds = [Build.of_seed(rig, seed) for seed in range(300)]
    for name, key in (
        ("mass", "mass"),
        ("inertia", "inertia"),
        ("coupling", "coupling_stiffness"),
        ("contact", "contact_stiffness"),
        ("damping", "foundation_damping"),
        ("viscosity", "viscosity"),
    ):
        values = np.array([getattr(b, name) for b in builds])
        assert np.abs(values - 1).max() <= spread[key]
        assert np.abs(values - 1).max() > 0.9 * spread[key]
    grades = np.array([b.unbalance_kg_m for b in builds]) / unbalance_of_grade(rig, 1.0)
    assert grades.min() >= 0.4 - 1e-9
    assert grades.max() <= 6.3 + 1e-9
    assert max(abs(b.clearance_error_m) for b in builds) <= 2e-6
    assert max(b.runout_m.sum(axis=1).max() for b in builds) <= 1e-5
    assert max(np.abs(b.zero[:2]).max() for b in builds) <= 2e-6
    gaps = np.concatenate([b.bolt_gap_m for b in builds])
    assert gaps.min() >= 2e-5
    assert gaps.max() <= 2e-4


def test_build_of_a_seed_repeats() -> None:
    rig = load_rig("bench")
    np.testing.assert_array_equal(Build.of_seed(rig, 5).gain, Build.of_seed(rig, 5).gain)
    assert Build.of_seed(rig, 5).mass != Build.of_seed(rig, 6).mass


def test_published_duty() -> None:
    duty = Duty.published()
    assert duty.seconds == 66
    np.testing.assert_allclose(duty.at(np.array([0.0, 13.0, 20.0, 66.0]))[:, 1], [30, 65, 100, 30])
    assert duty.at(np.array([13.0]))[0, 0] == pytest.approx(9000 * math.pi / 30)


@pytest.mark.parametrize("seed", range(5))
def test_random_duty_keeps_range_and_rates(seed: int) -> None:
    rig = load_rig("bench")
    duty = Duty.random(rig, np.random.default_rng(seed), 60.0)
    t = np.arange(0, duty.seconds, 0.01)
    speed, load = duty.at(t).T
    assert duty.seconds >= 60
    assert load.min() >= rig.load_min_N
    assert load.max() <= rig.load_max_N
    assert np.abs(np.diff(load)).max() / 0.01 <= 50.001
    assert np.abs(np.diff(speed)).max() / 0.01 <= 2000.1 * math.pi / 30


def test_one_point_of_a_duty_is_what_the_array_says() -> None:
    duty = Duty((0.0, 1.0, 1.0, 3.0), (600.0, 900.0, 1200.0, 1200.0), (30.0, 40.0, 50.0, 300.0))
    for t in (-1.0, 0.0, 0.5, 1.5, 2.99, 3.0, 9.0):
        np.testing.assert_allclose(duty.point(t), duty.at(np.array([t]))[0])
