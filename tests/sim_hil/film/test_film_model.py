"""A film model of someone else is tabulated once and moves a rotor; what is no film model is
refused by name."""

from pathlib import Path

import numpy as np
import pytest

from sim_hil import Duty, load_rig, simulate
from sim_hil.film.model import tabulate
from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import table_force
from sim_hil.plant.response import SimulationError

BENCH = load_rig("bench")
DUTY = Duty.hold(6000, 100, 0.1)
SURROGATE = Path(__file__).parents[3] / "models" / "artifacts" / "surrogate.onnx"


def reynolds(state):
    table = FilmTable.load(0.5).coefficients
    rows = np.array([table_force(table, *row) for row in state.tolist()])
    return rows[:, :2], rows[:, 2:3], rows[:, 3:4]


def test_a_model_that_is_the_table_becomes_the_table():
    shipped = FilmTable.load(0.5)
    np.testing.assert_allclose(
        tabulate(reynolds, 0.5).coefficients, shipped.coefficients, rtol=0, atol=1e-3
    )


def test_rotor_on_the_shipped_surrogate_stays_within_a_tenth_of_a_percent():
    ours, reference = (
        simulate(BENCH, DUTY, clearance=60e-6, thermal=False, force=force)
        for force in (SURROGATE, "table")
    )
    assert np.abs(ours.position_m - reference.position_m).max() < 0.001 * 60e-6
    assert ours.power_W.mean() == pytest.approx(reference.power_W.mean(), rel=1e-3)


def test_what_is_no_film_model_is_refused(tmp_path):
    text = tmp_path / "film.onnx"
    text.write_text("no model")
    refused = {
        "not a film model": text,
        "use direct, table": tmp_path / "none.onnx",
        "actor.onnx": SURROGATE.with_name("actor.onnx"),
        "not finite": lambda state: [np.full((len(state), n), np.nan) for n in (2, 1, 1)],
    }
    for why, force in refused.items():
        with pytest.raises(SimulationError, match=why):
            simulate(BENCH, DUTY, clearance=60e-6, force=force)


def test_a_film_of_another_shape_is_refused():
    other = FilmTable(0.25, FilmTable.load(0.5).coefficients)
    with pytest.raises(SimulationError, match=r"0\.25"):
        simulate(BENCH, DUTY, clearance=60e-6, force=other)
