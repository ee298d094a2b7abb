"""Whirl of a rotor out of balance: where it begins, and the guard's table of it."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim_hil.film.static_table import ONSET_ECCENTRICITY, ONSET_UNBALANCE_SHARE
from sim_hil.film.table import FilmTable
from sim_hil.film.whirl_onset import onset_share

TABLE = Path("firmware_py/machine/film_table.json")


def onset() -> dict[str, list]:
    return json.loads(TABLE.read_text())["onset"]


@pytest.mark.parametrize("eccentricity", [0.1, 0.3])
def test_a_balanced_rotor_begins_at_its_linear_threshold(eccentricity: float) -> None:
    assert onset_share(FilmTable.load(0.5), eccentricity, 0.0) == 1.0


@pytest.mark.parametrize(("row", "column"), [(2, 4), (5, 6)])
def test_the_guards_table_is_that_of_the_rotor_on_the_film(row: int, column: int) -> None:
    found = onset_share(FilmTable.load(0.5), ONSET_ECCENTRICITY[row], ONSET_UNBALANCE_SHARE[column])
    assert onset()["clearance_share"][1][row][column] == pytest.approx(found, abs=1e-6)


def test_a_larger_unbalance_never_admits_a_wider_clearance_and_none_changes_nothing() -> None:
    shares = np.array(onset()["clearance_share"])
    assert (np.diff(shares, axis=2) <= 0.0).all()
    assert (shares[:, :, 0] == 1.0).all()
    assert 0.75 < shares.min() < 0.85
