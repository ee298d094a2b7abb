"""Rigs, builds, duties: the shipped data is the reference data, and the spread is the declared
one."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from sim_hil.plant.build import Build, unbalance_of_grade
from sim_hil.plant.duty import Duty, NoDuty
from sim_hil.rigs import (
    RIGS,
    ActuatorData,
    AxialGroove,
    BearingData,
    UnknownRig,
    load_rig,
)

REFERENCE = Path(__file__).resolve().parents[3].parent / "shared" / "reference"


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="no ../shared/reference beside the repository")
def test_the_bench_is_the_reference_rig() -> None:
    rig, given = load_rig("bench"), json.loads((REFERENCE / "rig_bench.json").read_text())
    bearing, feed, rotor = given["bearing"], given["feed"], given["rotor"]
    clearance = bearing["radial_clearance_m"]
    assert rig.bearing == BearingData(
        bearing["journal_radius_m"], bearing["length_m"], clearance["min"], clearance["max"],
        clearance["nominal"],
    )  # fmt: skip
    supply, pressures = rig.supply, feed["pressure_Pa"]
    assert [supply.nominal_Pa, supply.min_Pa, supply.max_Pa] == [
        pressures[key] for key in ("nominal", "min", "max")
    ]
    assert supply.pump_efficiency == feed["pump_efficiency"]
    assert supply.groove == AxialGroove(
        math.pi / 2, math.radians(feed["width_deg"]), feed["length_share"]
    )
    assert rig.actuator == ActuatorData(**given["actuator"])
    assert [rig.speed_min_rpm, rig.speed_max_rpm] == given["speed_rpm"]
    assert (rig.load_min_N, rig.load_max_N) == (given["load_N"]["min"], given["load_N"]["max"])
    assert (rig.rotor.mass_kg, rig.rotor.diametral_inertia_kg_m2) == (
        rotor["mass_kg"], rotor["J_d_kg_m2"],
    )  # fmt: skip
    oil = given["oil"]
    assert (rig.oil.viscosity_at(40.0), rig.oil.density_kg_m3, rig.oil.inlet_C) == (
        oil["viscosity_Pa_s_at_40C"], oil["density_kg_m3"], oil["inlet_C"],
    )  # fmt: skip


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="no ../shared/reference beside the repository")
@pytest.mark.parametrize("name", RIGS)
def test_the_sensors_are_the_reference_sensors(name: str) -> None:
    sensors = json.loads((REFERENCE / "sensors.json").read_text())["channels"]
    for channel, sensor in zip(load_rig(name).channels, sensors, strict=True):
        si = 1e-6 if sensor["unit"] == "um" else 1.0
        assert (channel.name, channel.bandwidth_hz) == (sensor["name"], sensor["bandwidth_Hz"])
        assert [channel.low, channel.high] == [end * si for end in sensor["range"]]
        assert channel.noise_rms == sensor.get("noise_rms", 0.0) * si
        assert channel.gain_error_share == sensor.get("gain_error", 0.0)
        assert channel.zero_error == sensor.get("zero_error", 0.0) * si


def test_effective_mass_and_gravity_share_are_those_of_the_rig_file() -> None:
    rotor = load_rig("bench").rotor
    assert rotor.effective_mass_kg == pytest.approx(1.74)
    assert rotor.gravity_share_N == pytest.approx(29.4, abs=0.05)


def test_unknown_rig_is_refused() -> None:
    with pytest.raises(UnknownRig, match="bench, seed"):
        load_rig("ship")


def test_builds_stay_within_the_declared_spread_and_use_it() -> None:
    rig = load_rig("bench")
    spread, most = rig.spread, rig.build_errors
    builds = [Build.of_seed(rig, seed) for seed in range(300)]
    for name, share in (
        ("mass", most.mass_share),
        ("inertia", spread.inertia_share),
        ("coupling", spread.coupling_stiffness_share),
        ("contact", spread.contact_stiffness_share),
        ("damping", spread.foundation_damping_share),
        ("viscosity", most.viscosity_share),
    ):
        values = np.array([getattr(b, name) for b in builds])
        assert np.abs(values - 1).max() <= share
        assert np.abs(values - 1).max() > 0.9 * share
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
    duty = Duty.published(load_rig("bench"))
    assert duty.seconds == 66
    with pytest.raises(NoDuty, match="no table"):
        Duty.published(load_rig("seed"))
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
