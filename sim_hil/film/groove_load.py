"""What a groove opposite the load adds to it, by the film with the groove beside the film without.

`python -m sim_hil.film.groove_load` (half a minute) prints it for the groove of the `bench` rig, at
its loads, 30 to 300 N, and pressures: what a guard that knows the film without groove has to
declare of the one with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .equilibrium import equilibrium
from .records import FeedPatch, FilmArguments

_RADIUS_M, _LENGTH_M, _SPEED, _VISCOSITY, _CLEARANCE_M = 0.02, 0.02, 600.0, 0.01, 60e-6
"""Of no consequence but the shape: the answers have no dimension."""

_WIDTH_RAD, _LENGTH_SHARE = np.radians(20.0), 0.8
PROJECTED_M2 = 2.0 * _RADIUS_M * _LENGTH_M
ECCENTRICITY = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
PRESSURE_SHARE = (0.118, 0.25, 0.4, 0.571, 0.73, 0.889)
"""Pressure times projected area, over itself and the load: 0.118 to 0.571 at 0.5 bar, 0.889 at 3
bar and 30 N."""


@dataclass(frozen=True)
class GrooveLoad:
    """The film with groove at one place of the shaft.

    Parameters
    ----------
    eccentricity_ratio
        Where the shaft runs.
    area_share
        What the film without groove carries more there, over pressure and projected area.
    turned_deg
        Attitude beyond that without groove.
    whirl_share
        Mass of a rigid rotor that whirls without groove, over the one that whirls with it: the film
        without groove, in the same bearing, carries the load and the pressure on ``area_share`` of
        the call; nan where one never whirls.
    """

    eccentricity_ratio: float
    area_share: float
    turned_deg: float
    whirl_share: float


def groove_load(eccentricity_ratio: float, pressure_share: float, area_share: float) -> GrooveLoad:
    """At about that eccentricity and share of the pressure (:data:`PRESSURE_SHARE`).

    Raises
    ------
    FilmNotConverged
        No equilibrium there.
    """
    film: FilmArguments = {
        "radius_m": _RADIUS_M,
        "length_m": _LENGTH_M,
        "clearance_m": _CLEARANCE_M,
        "viscosity_Pa_s": _VISCOSITY,
        "speed_rad_s": _SPEED,
    }
    per_load = pressure_share / (1.0 - pressure_share)
    near_N = equilibrium(eccentricity_ratio=eccentricity_ratio, **film).load_N
    load_N = near_N / (1.0 + 0.25 * per_load)
    pressure_N = per_load * load_N
    groove = FeedPatch(
        "groove", 0.5 * np.pi, _WIDTH_RAD, _LENGTH_SHARE * _LENGTH_M, pressure_N / PROJECTED_M2
    )
    with_groove: FilmArguments = {**film, "feed": (groove,)}
    fed = equilibrium(load_N=load_N, **with_groove)
    there = equilibrium(eccentricity_ratio=fed.eccentricity_ratio, **film)
    pressed = equilibrium(load_N=load_N + area_share * pressure_N, **film)
    return GrooveLoad(
        fed.eccentricity_ratio,
        (there.load_N - load_N) / pressure_N,
        float(np.degrees(fed.attitude_rad - there.attitude_rad)),
        pressed.threshold**2 * pressed.load_N / (fed.threshold**2 * fed.load_N),
    )


def main(area_share: float = 0.2) -> None:
    """Print each number: a row a pressure, a column an eccentricity."""
    rows = [[groove_load(e, p, area_share) for e in ECCENTRICITY] for p in PRESSURE_SHARE]
    for name in ("area_share", "turned_deg", "whirl_share"):
        print(name)
        for share, row in zip(PRESSURE_SHARE, rows, strict=True):
            print(f"  {share:5.3f}", " ".join(f"{getattr(one, name):6.3f}" for one in row))


if __name__ == "__main__":
    main()
