"""The bench measures what it says: the yardstick solves, the orbits converge, figures are judged
rightly."""

import json

import numpy as np
import pytest

from sim_hil import bench
from sim_hil.bench import Figure, rotors, timing
from sim_hil.bench.hil import Witness, idle, rig_beside_empty
from sim_hil.bench.reference_kernel import cyclic_thomas, reference_arrays
from sim_hil.bench.rotors import orbit
from sim_hil.bench.timing import Timing
from sim_hil.server import PERIOD_NS


def test_the_yardstick_solves_its_ring():
    (lower, diagonal, upper), right, (x, z, g) = reference_arrays(9, 1)
    cyclic_thomas(lower, diagonal, upper, right[0], x, z, g)
    matrix = np.diag(diagonal) + np.diag(upper[:-1], 1) + np.diag(lower[1:], -1)
    matrix[0, -1], matrix[-1, 0] = lower[0], upper[-1]
    np.testing.assert_allclose(x, np.linalg.solve(matrix, right[0]), rtol=1e-12)


@pytest.mark.parametrize("rpm", bench.SPEEDS_RPM)
def test_the_timed_orbit_is_the_converged_one(rpm):
    assert orbit("table", rpm).error() < bench.ORBIT_ERROR


def test_the_whole_rig_is_timed(monkeypatch):
    monkeypatch.setattr(bench, "REFERENCE_CALLS", 20)
    factor, ratio = bench.rig_figures()
    assert factor.value > 1.0
    assert ratio.value > 0.0
    assert len(rotors.whole_rig(0.02)().counts) == 100


def test_rotors_and_reference_gain_from_threads_alike(monkeypatch):
    monkeypatch.setattr(rotors, "ROUNDS", 1)
    assert all(
        gain > 0 for gain in rotors.speed_ups(2, 2, 0.002)
    )  # by the wall clock: other work may stand beside it


def test_training_is_timed(monkeypatch):
    monkeypatch.setattr(timing, "ROUNDS", 1)
    step, share = rotors.environment_steps(2)
    assert step.seconds > 0
    assert 0.1 < share < 10
    assert 0.1 < rotors.kernel_share(2) < 10


def test_a_point_left_out_of_the_grid_is_counted():
    witness = Witness()
    for periods in (0, 1, 4, 5):
        witness.sleep_until(periods * PERIOD_NS)  # long past: returns at once
    assert witness.missed == 1
    assert len(witness.late_ns) == 4


def test_an_empty_loop_wakes_after_its_points():
    witness, left = Witness(), iter([True] * 5 + [False])
    idle(witness, lambda: next(left))
    assert len(witness.late_ns) == 5
    assert min(witness.late_ns) >= 0


@pytest.mark.slow
def test_the_real_rig_runs_beside_an_empty_loop():
    found = rig_beside_empty(1.0)
    assert found["rig"]["cpu_share"] > found["empty"]["cpu_share"]
    assert all(
        0 <= loop["missed_share"] <= 1 and loop["late_max_us"] > 0 for loop in found.values()
    )


@pytest.mark.parametrize(
    ("value", "at_least", "passed"), [(6, True, True), (4, True, False), (4, False, True)]
)
def test_a_figure_is_judged_by_its_limit(value, at_least, passed):
    assert Figure("f", value, "x", 5, at_least).passed is passed
    assert Figure("f", value, "x").passed is None


def test_the_report_names_what_is_missed(monkeypatch, capsys):
    monkeypatch.setattr(bench, "film_figures", lambda: [Figure("slow", 11.0, "", 10.0)])
    monkeypatch.setattr(bench, "rotor_figures", lambda: [Figure("fast", 9.0, "x", 5.0, True)])
    monkeypatch.setattr(bench, "rig_figures", list)
    assert bench.main(["sim", "--quick", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["missed"] == ["slow"]


def test_film_figures_are_medians_of_a_run():
    from sim_hil.bench import film

    found = film.film_timings(20)
    assert set(found) == {"reference", "direct", "table"}
    assert all(isinstance(t, Timing) and t.seconds > 0 and t.ratio > 0 for t in found.values())
