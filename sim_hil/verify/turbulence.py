"""The turbulent film against what its own laws leave in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from sim_hil.film import FilmForce, equilibrium, film_force
from sim_hil.film.records import FilmArguments
from sim_hil.verify.row import ComparisonRow

_R: Final = 0.05
_C: Final = 100e-6
_WATER: Final = 1000.0
_MU: Final = 1e-3
_LAWS: Final = "Ng and Pan 1965, Constantinescu 1974"


def _film(speed_rad_s: float, eps: float, length: float, density: float) -> FilmForce:
    return film_force(
        (0.0, -eps * _C),
        (0.0, 0.0),
        radius_m=_R,
        length_m=length,
        clearance_m=_C,
        viscosity_Pa_s=_MU,
        speed_rad_s=speed_rad_s,
        rupture="full",
        density_kg_m3=density,
        grid=(120, 24),
    )


def turbulent() -> Iterator[ComparisonRow]:
    """Concentric friction, load of a short and of a long bearing at a light load."""
    for number in (2000.0, 10_000.0, 50_000.0):
        speed = number * _MU / (_WATER * _R * _C)
        still, stirred = (_film(speed, 0.0, _R, density) for density in (0.0, _WATER))
        ratio = float(stirred.friction_torque_N_m / still.friction_torque_N_m)
        expected = 1 + 0.0012 * number**0.94
        case = f"turbulent film, Re={number:g}:"
        yield ComparisonRow(f"{case} friction over Petroff's", ratio, expected, _LAWS, 1e-6)
        for name, length, factor, power in (
            ("short", _R / 20, 0.0043, 0.96),
            ("long", 40 * _R, 0.0136, 0.9),
        ):
            still, stirred = (_film(speed, 1e-3, length, density) for density in (0.0, _WATER))
            load = float(np.hypot(*stirred.force_N) / np.hypot(*still.force_N))
            expected = 1 + factor / 12 * number**power
            quantity = f"{case} load of the {name} bearing over the laminar one's"
            yield ComparisonRow(quantity, load, expected, _LAWS, 2e-2)
    yield from _laminar()


def _laminar() -> Iterator[ComparisonRow]:
    """Below Taylor's onset the film is the laminar one to the last digit."""
    onset = 41.1 * math.sqrt(_R / _C)
    speed = 0.5 * onset * _MU / (_WATER * _R * _C)
    rules: FilmArguments = {
        "radius_m": _R,
        "length_m": _R,
        "clearance_m": _C,
        "viscosity_Pa_s": _MU,
        "speed_rad_s": speed,
    }
    plain = equilibrium(load_N=5.0, **rules)
    dense: FilmArguments = {**rules, "density_kg_m3": _WATER}
    judged = equilibrium(load_N=5.0, **dense)
    yield ComparisonRow(
        "half of the onset of vortices: stiffness along the load, N/m",
        float(judged.stiffness_N_m[0, 0]),
        float(plain.stiffness_N_m[0, 0]),
        "laminar film",
        1e-9,
    )
