"""The fed network's rival: the simulator's own table of the fed film."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.film.fed_data import GROOVE_LENGTH_SHARE, GROOVE_WIDTH_RAD
from models.film.judge import FilmModel
from sim_hil.film.fed import FedTable, fed_force

Floats = NDArray[np.float64]


def shipped_table(length_over_diameter: float) -> tuple[FilmModel, int]:
    """The simulator's own table of the fed film as a film model, and how many numbers it holds."""
    stored = FedTable.load(length_over_diameter, float(GROOVE_WIDTH_RAD), GROOVE_LENGTH_SHARE)
    law = stored.law(0.0)

    def film(state: Floats) -> list[Floats]:
        rows = np.array([fed_force(law._replace(groove_angle_rad=row[10]), *row[:9], 0.0, row[9]) for row in state])
        return [rows[:, :2], rows[:, 2:3]]

    return film, law.unfed.size + law.groove.size
