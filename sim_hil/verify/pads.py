"""Fixed pads: published lobed bearings, and what must hold of any."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from sim_hil.film import Equilibrium, equilibrium
from sim_hil.film.bearing import DEFAULT_GRID
from sim_hil.film.bore import PadBore
from sim_hil.verify.closed_forms import MU, OMEGA, C, R
from sim_hil.verify.properties import apart, film_of, states
from sim_hil.verify.row import ComparisonRow, reference, residual

_UP: Final = math.pi / 2
_AXES: Final = ("xx", "xy", "yx", "yy")


def lemon(preload: float, arc_deg: float = 160.0) -> PadBore:
    """Two pads, above and below, with grooves beside."""
    return PadBore(2, _UP, math.radians(arc_deg), preload)


def two_lobes() -> Iterator[ComparisonRow]:
    """Someya's bearings with two lobes."""
    book = reference("two_lobe_someya.json")
    for table in book["tables"]:
        ratio, preload = table["length_over_diameter"], table["preload"]
        bore = lemon(preload, 180.0 - book["groove_deg"])
        source = f"Someya, Journal-Bearing Databook (1989), page {table['page']}"
        for row in table["rows"]:
            yield from _someya(bore, ratio, row, source, table.get("tolerance"))


def _someya(
    bore: PadBore, ratio: float, row: list[Any], source: str, allowed: dict[str, float] | None
) -> Iterator[ComparisonRow]:
    sommerfeld, eps, attitude, stiffness, damping = row
    machined, length = C / (1 - bore.preload), 2 * R * ratio
    load = MU * OMEGA / (2 * math.pi) * length * 2 * R / sommerfeld * (R / machined) ** 2
    state = _rest(bore, length, load)
    case = f"two lobes L/D={ratio:g} m={bore.preload:.3g} S={sommerfeld}:"
    within = allowed or {}
    yield ComparisonRow(
        f"{case} eccentricity", state.eccentricity_ratio, eps, source, within.get("eps")
    )
    angle, most_deg = math.degrees(state.attitude_rad), within.get("attitude_deg")
    yield ComparisonRow(f"{case} attitude, deg", angle, attitude, source, most_deg, True)
    share = within.get("coefficients_of_the_largest") if eps < 1.0 else None
    scaled = (
        ("K", state.stiffness_N_m * machined / load, stiffness),
        ("C", state.damping_N_s_m * machined * OMEGA / load, damping),
    )
    for letter, found, printed in scaled:
        most = None if share is None else share * max(printed)
        for axes, value, expected in zip(_AXES, found.ravel(), printed, strict=True):
            yield ComparisonRow(
                f"{case} {letter}{axes}", float(value), expected, source, most, True
            )


def _rest(
    bore: PadBore | None, length: float, load: float, grid: tuple[int, int] = DEFAULT_GRID
) -> Equilibrium:
    return equilibrium(
        load_N=load,
        radius_m=R,
        length_m=length,
        clearance_m=C,
        viscosity_Pa_s=MU,
        speed_rad_s=OMEGA,
        pads=bore,
        grid=grid,
    )


def pads() -> Iterator[ComparisonRow]:
    """Pads without preload are a round bore; equal pads repeat; preload stiffens and steadies."""
    e, v = states(12, 6)
    fine = partial(film_of, grid=(192, 16))
    for count in (2, 3, 4):
        whole = PadBore(count, _UP, 2 * math.pi / count, 0.0)
        case = f"{count} pads that meet, no preload, 12 states: largest relative error"
        found = fine(e, v, pads=whole).force_N
        yield residual(case, apart(found, fine(e, v).force_N), "round bore", 5e-3)
        bore = PadBore(count, _UP, 0.9 * 2 * math.pi / count, 0.4)
        turn = 2 * math.pi / count
        spin = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        still, turned = fine(e, v, pads=bore), fine(e @ spin.T, v @ spin.T, pads=bore)
        case = f"{count} pads, preload 0.4, all turned by a pad: largest relative error"
        yield residual(case, apart(turned.force_N, still.force_N @ spin.T), "equal pads", 1e-6)
    mirror = np.array([1.0, -1.0])
    bore = PadBore(2, _UP, math.radians(160.0), 0.5, 0.8)
    other = PadBore(2, _UP, math.radians(160.0), 0.5, 0.2)
    there = fine(e, v, pads=bore).force_N
    back = fine(e * mirror, v * mirror, speed_rad_s=-OMEGA, pads=other).force_N
    case = "offset pads, reflected, other way round: largest relative error"
    yield residual(case, apart(back, there * mirror), "reversed speed", 1e-6)
    yield from _lemon()
    yield from _converged()


def _lemon() -> Iterator[ComparisonRow]:
    """A light load, where the preload makes the film."""
    plain, bore = (_rest(lemon(m), R, 20.0) for m in (0.0, 0.5))
    source = "preload wedges of the pad above and below"
    k = plain.stiffness_N_m, bore.stiffness_N_m
    yield ComparisonRow(
        "lemon, preload 0.5, 20 N: stiffer along the load than without",
        float(k[1][0, 0] > 1.5 * k[0][0, 0]),
        1.0,
        source,
        0.0,
        True,
    )
    yield ComparisonRow(
        "lemon, preload 0.5, 20 N: stiffer along the load than across",
        float(k[1][0, 0] > 3 * abs(k[1][1, 1])),
        1.0,
        source,
        0.0,
        True,
    )
    onset = [_rest(lemon(m), R, 20.0).threshold for m in (0.0, 0.25, 0.5)]
    steady = [math.inf if math.isnan(one) else one for one in onset]
    yield ComparisonRow(
        "lemon, preload 0, 0.25, 0.5, 20 N: later onset of whirl the more preload",
        float(steady[0] < steady[1] < steady[2]),
        1.0,
        "known of preloaded bearings (Lund and Thomsen 1978)",
        0.0,
        True,
    )


def _converged() -> Iterator[ComparisonRow]:
    """The film of a lemon and of offset halves on three grids."""
    for name, bore in (
        ("lemon", lemon(0.5)),
        ("three lobes", PadBore(3, _UP, math.radians(105.0), 0.5)),
        ("offset halves", PadBore(2, _UP, math.radians(160.0), 0.5, 1.0)),
    ):
        at = (0.2 * C, -0.5 * C)
        loads = [
            float(np.hypot(*film_of(at, (0.0, 0.0), pads=bore, grid=(60 * k, 8 * k)).force_N))
            for k in (1, 2, 4)
        ]
        limit = loads[2] + (loads[2] - loads[1]) / 3
        default = film_of(at, (0.0, 0.0), pads=bore, grid=DEFAULT_GRID).force_N
        source = "Richardson limit of three grids"
        case = f"{name}, preload 0.5: force on the default grid, N"
        yield ComparisonRow(case, float(np.hypot(*default)), limit, source, 1e-2)
