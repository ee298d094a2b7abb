"""Runs faster than real time: schedules, recordings, pressure, faults on the way."""

import numpy as np
import pytest

from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.runs import record, run
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS

RIG = load_rig("bench")


def test_recording_follows_speed_load_and_clearance() -> None:
    duty = Duty((0.0, 2.0), (3000.0, 6000.0), (50.0, 150.0))
    r = record(
        RIG,
        Build.of_seed(RIG, 1),
        duty,
        2.0,
        clearance=lambda t: 60e-6 + 20e-6 * t,
        seed=3,
        pressure=2e5,
    )
    assert r.counts.shape == (10000, 8)
    assert r.counts.dtype == np.int16
    assert r.status.shape == (40, 5)
    assert len(r.mark_s) == pytest.approx(150, abs=1)
    assert np.diff(r.status[:, 3])[5:].mean() == pytest.approx(20e-6 * 0.05, rel=0.15)
    assert r.counts[:, 6].mean() * 1e-3 == pytest.approx(2.0, abs=0.06)
    assert r.column("load_N")[-1] == pytest.approx(150, rel=0.01)
    np.testing.assert_allclose(np.diff(r.time_s), 2e-4)


def test_recording_repeats() -> None:
    first, again = (
        record(
            RIG,
            Build.of_seed(RIG, 1),
            Duty.hold(6000, 100),
            0.3,
            clearance=60e-6,
            seed=3,
            faults={"rub": 0.9},
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.counts, again.counts)
    np.testing.assert_array_equal(first.status, again.status)


def followed(duty: Duty, **faults: float) -> dict[str, np.ndarray]:
    machine = SimulatedMachine(RIG, Build.nominal(RIG), 0, clearance_m=60e-6)
    for name, severity in faults.items():
        machine.inject(name, severity)
    return dict(
        zip(TRUTH_COLUMNS, run(machine, duty, duty.seconds, clearance=60e-6).truth.T, strict=True)
    )


@pytest.mark.parametrize("speed_rpm", [0.0, -3000.0])
def test_standstill_and_backward_rotation_stay_finite(speed_rpm: float) -> None:
    truth = followed(Duty.hold(speed_rpm, 300, 0.5))
    assert all(np.isfinite(column).all() for column in truth.values())
    assert truth["min_film_m"].min() > -1e-6
    if speed_rpm < 0:
        assert truth["eccentricity_x_m"][-500:].mean() < 0  # attitude turns with the rotation


def test_faults_change_the_power() -> None:
    healthy, worn = (
        followed(Duty.hold(9000, 100, 0.4), **faults) for faults in ({}, {"wear": 1.0})
    )
    assert worn["shaft_power_W"].mean() < 0.95 * healthy["shaft_power_W"].mean()
