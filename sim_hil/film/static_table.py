"""Static film of the plain unfed bearing for the guard: what its closed forms are short of.

`python -m sim_hil.film.static_table` writes `firmware_py/machine/film_table.json` (ten minutes):
load and attitude of the Reynolds solution as shares of the short bearing's, the whirl threshold,
over eccentricity and length, and how much before it a rotor out of balance whirls.
"""

from __future__ import annotations

import json
import math
from itertools import accumulate
from pathlib import Path
from typing import Any

from .equilibrium import equilibrium
from .table import FilmTable
from .whirl_onset import onset_share

TITLE = (
    "Unfed Reynolds film at rest; rows length_over_diameter, columns eccentricity; "
    "sim_hil.film.static_table"
)
LENGTH_OVER_DIAMETER = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)
ECCENTRICITY = (
    0.01,
    0.05,
    0.1,
    0.15,
    0.2,
    0.25,
    0.3,
    0.35,
    0.4,
    0.45,
    0.5,
    0.55,
    0.6,
    0.65,
    0.7,
    0.75,
    0.8,
    0.84,
    0.87,
    0.9,
    0.92,
    0.94,
    0.96,
    0.97,
)
ONSET_LENGTH_OVER_DIAMETER = (0.25, 0.5, 0.75, 1.0)
ONSET_ECCENTRICITY = (0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)
ONSET_UNBALANCE_SHARE = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
_RADIUS_M, _CLEARANCE_M, _VISCOSITY, _SPEED = 0.02, 60e-6, 0.01, 600.0


def node(ratio: float, eccentricity: float) -> tuple[float, float, float]:
    """Load and tangent of the attitude over the short bearing's, and ``1 / Omega^2`` of the whirl
    threshold.

    ``Omega = w sqrt(c m / W)``; 0 where the film is stable at any speed.
    """
    length_m, e2 = 2 * _RADIUS_M * ratio, eccentricity * eccentricity
    state = equilibrium(
        eccentricity_ratio=eccentricity,
        radius_m=_RADIUS_M,
        length_m=length_m,
        clearance_m=_CLEARANCE_M,
        viscosity_Pa_s=_VISCOSITY,
        speed_rad_s=_SPEED,
    )
    short_N = (
        _VISCOSITY
        * _SPEED
        * _RADIUS_M
        * length_m**3
        * eccentricity
        * math.sqrt(16 * e2 + math.pi**2 * (1 - e2))
        / (4 * _CLEARANCE_M**2 * (1 - e2) ** 2)
    )
    short_tangent = math.pi * math.sqrt(1 - e2) / (4 * eccentricity)
    whirl = 0.0 if math.isnan(state.threshold) else 1 / state.threshold**2
    return state.load_N / short_N, math.tan(state.attitude_rad) / short_tangent, whirl


def table() -> dict[str, Any]:
    """The whole table, five digits."""
    nodes = [[node(ratio, e) for e in ECCENTRICITY] for ratio in LENGTH_OVER_DIAMETER]
    names = ("load_share", "tangent_share", "whirl_share")
    columns = {
        name: [[float(f"{n[i]:.5g}") for n in row] for row in nodes] for i, name in enumerate(names)
    }
    return {
        "title": TITLE,
        "length_over_diameter": LENGTH_OVER_DIAMETER,
        "eccentricity": ECCENTRICITY,
        **columns,
        "onset": onset(),
    }


def onset() -> dict[str, Any]:
    """Shares of :func:`.whirl_onset.onset_share`: a block a length, a row an eccentricity, a column
    an unbalance.

    A larger unbalance that keeps whirl off again does not count: the machine gets there through a
    smaller one.
    """
    blocks = []
    for ratio in ONSET_LENGTH_OVER_DIAMETER:
        film = FilmTable.build(ratio)
        rows = [
            [onset_share(film, e, u) for u in ONSET_UNBALANCE_SHARE] for e in ONSET_ECCENTRICITY
        ]
        blocks.append([[round(share, 2) for share in accumulate(row, min)] for row in rows])
    return {
        "length_over_diameter": ONSET_LENGTH_OVER_DIAMETER,
        "eccentricity": ONSET_ECCENTRICITY,
        "unbalance_share": ONSET_UNBALANCE_SHARE,
        "clearance_share": blocks,
    }


if __name__ == "__main__":
    Path("firmware_py/machine/film_table.json").write_text(
        json.dumps(table()) + "\n", encoding="utf-8"
    )
