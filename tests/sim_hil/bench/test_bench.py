"""The bench measures what it says: the yardstick solves, the orbits converge, figures are judged rightly."""

import json

import numpy as np
import pytest

from sim_hil import bench
from sim_hil.bench import Figure
from sim_hil.bench.reference_kernel import cyclic_thomas, reference_arrays
from sim_hil.bench.rotors import many, orbit
from sim_hil.bench.timing import Timing


def test_the_yardstick_solves_its_ring():
    (lower, diagonal, upper), right, (x, z, g) = reference_arrays(9, 1)
    cyclic_thomas(lower, diagonal, upper, right[0], x, z, g)
    matrix = np.diag(diagonal) + np.diag(upper[:-1], 1) + np.diag(lower[1:], -1)
    matrix[0, -1], matrix[-1, 0] = lower[0], upper[-1]
    np.testing.assert_allclose(x, np.linalg.solve(matrix, right[0]), rtol=1e-12)


@pytest.mark.parametrize("rpm", bench.SPEEDS_RPM)
def test_the_timed_orbit_is_the_converged_one(rpm):
    assert orbit("table", rpm).error() < bench.ORBIT_ERROR


def test_many_rotors_are_timed():
    assert 0 < many(2, 1, 0.01, rounds=1) < 10


@pytest.mark.parametrize(("value", "at_least", "passed"), [(6, True, True), (4, True, False), (4, False, True)])
def test_a_figure_is_judged_by_its_limit(value, at_least, passed):
    assert Figure("f", value, "x", 5, at_least).passed is passed
    assert Figure("f", value, "x").passed is None


def test_the_report_names_what_is_missed(monkeypatch, capsys):
    monkeypatch.setattr(bench, "film_figures", lambda: [Figure("slow", 11.0, "", 10.0)])
    monkeypatch.setattr(bench, "rotor_figures", lambda: [Figure("fast", 9.0, "x", 5.0, True)])
    assert bench.main(["sim", "--quick", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["missed"] == ["slow"]


def test_film_figures_are_medians_of_a_run():
    from sim_hil.bench import film

    found = film.film_timings(20)
    assert set(found) == {"reference", "direct", "table"}
    assert all(isinstance(t, Timing) and t.seconds > 0 and t.ratio > 0 for t in found.values())
