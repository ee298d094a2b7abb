"""The report on the paper: self-contained, every claim with its figures, and the independent
Reynolds orbit."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from models.reproduce import main
from models.reproduce.claims import (
    MISPRINTS,
    OPEN,
    POWER,
    SIX_CLASSES,
    SPEED,
    TRANSIENTS,
    TWO_CLASSES,
)
from models.reproduce.report import ClaimRow, Series, write


def test_the_report_holds_its_figures_and_escapes_its_text(tmp_path):
    row = ClaimRow("some", "a < b", "1", "2", "careful", "orbitd evaluate surrogate")
    page = write(
        tmp_path,
        [Series("Some", [row], {"x": 1.5}, [(Figure(), "empty")])],
        "orbitd reproduce",
        3.0,
    )
    text = page.read_text()
    assert "a &lt; b" in text
    assert "data:image/png;base64," in text
    assert "http" not in text
    table = json.loads((tmp_path / "report.json").read_text())
    assert table["claims"][0]["claim"] == "a < b"
    assert table["claims"][0]["command"] == "orbitd reproduce; orbitd evaluate surrogate"
    assert {
        "model": "surrogate",
        "figure": "unseen_films.points_driven",
        "reached": "0",
        "bar": "most 0",
        "holds": "yes",
    } in table["shipped"]
    assert table["measured"] == {"Some": {"x": 1.5}}
    assert len(table["misprints"]) == len(MISPRINTS)
    assert table["open"] == list(OPEN)


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_quick_run_answers_every_claim(tmp_path, capsys):
    assert main(["--quick", "--out", str(tmp_path)]) == 0
    table = json.loads((tmp_path / "report.json").read_text())
    assert [row["claim"] for row in table["claims"]] == [
        SPEED,
        TRANSIENTS,
        SIX_CLASSES,
        TWO_CLASSES,
        POWER,
    ]
    assert all(
        row["paper_method"] and row["our_method"] and row["caveat"] for row in table["claims"]
    )
    apart = table["measured"]["Trajectories"]["largest_distance_percent_of_clearance"]
    assert max(apart["reduced network"].values()) < 1.0 < max(apart["springs and dampers"].values())
    assert POWER in capsys.readouterr().out


@pytest.mark.slow
def test_equation_2_integrated_apart_follows_the_compiled_rotor():
    from models.reproduce.trajectories import CASES, compiled, reynolds, unfed
    from sim_hil.rigs import load_rig

    rig = unfed(load_rig("seed"))
    for case in CASES:
        apart = np.hypot(*(reynolds(rig, case, 1)[0] - compiled(rig, case, 1, "table")[0]).T)
        assert apart.max() < 0.002 * rig.bearing.clearance_nominal_m


@pytest.mark.slow
def test_a_network_that_diverges_is_a_row():
    """A force beyond all numbers; one that only throws the shaft far away is a distance."""
    from models.reproduce.trajectories import (
        CASES,
        LINEAR,
        OURS,
        PAPER,
        REYNOLDS,
        _rows,
        apart,
        unfed,
    )
    from sim_hil.rigs import load_rig
    from sim_hil.rotor.network_law import Perceptron, RawNetworkLaw

    forwards = np.zeros((5, 2))
    forwards[3:] = np.inf * np.ones((2, 2))
    law = RawNetworkLaw(Perceptron.make(forwards.ravel(), (4, 2)), 1e-4, 1e-3, 1e3)
    truth = np.zeros((1, 2))
    orbit, _, why = apart(unfed(load_rig("seed")), CASES[0], 1, law, truth)
    assert orbit is None
    assert "left the finite numbers" in str(why)
    speed = {REYNOLDS: 0.1, PAPER: None, OURS: 2.0, LINEAR: 3.0}
    errors = {PAPER: {"case": why}, OURS: {"case": 0.5}, LINEAR: {"case": 300.0}}
    first, second = _rows(speed, errors)
    assert "diverged" in first.paper_method
    assert "case diverged" in second.paper_method
    assert "0.5 %" in second.our_method
    assert "out of the bearing" in second.our_method
