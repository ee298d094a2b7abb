"""Properties that the film must have whatever the numbers are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import get_args

import numpy as np

from sim_hil.film import FeedPatch, film_force
from sim_hil.film.bearing import DEFAULT_GRID
from sim_hil.film.direct import DirectFilm, direct_force
from sim_hil.film.records import Floats, Inlet, Rupture
from sim_hil.film.table import FilmTable, table_force
from sim_hil.verify.closed_forms import MU, OMEGA, C, R
from sim_hil.verify.row import ComparisonRow, residual

_GRID = (96, 12)
film_of = partial(
    film_force,
    radius_m=R,
    length_m=R,
    clearance_m=C,
    viscosity_Pa_s=MU,
    speed_rad_s=OMEGA,
    grid=_GRID,
)


def states(count: int, seed: int) -> tuple[Floats, Floats]:
    """Random positions up to 0.9 of the clearance and velocities of the order of c omega."""
    rng = np.random.default_rng(seed)
    radius, angle = C * 0.9 * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    position = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return position, rng.normal(size=(count, 2)) * (0.2 * C * OMEGA)


def apart(found: Floats, expected: Floats) -> float:
    """Largest distance of forces over the size of the expected force."""
    return float(np.max(np.hypot(*(found - expected).T) / np.hypot(*expected.T)))


def scaling() -> Iterator[ComparisonRow]:
    """What speed, viscosity, clearance, rotation and reflection do to the force."""
    e, v = states(12, 1)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    mirror = np.array([1.0, -1.0])
    ruptures: tuple[Rupture, ...] = ("gumbel", "reynolds")
    for rupture in ruptures:
        film = partial(film_of, rupture=rupture)
        force = film(e, v).force_N
        cases = (
            (
                "twice speed and velocity",
                film(e, 2 * v, speed_rad_s=2 * OMEGA),
                2 * force,
                "homogeneity of degree one",
            ),
            (
                "thrice the viscosity",
                film(e, v, viscosity_Pa_s=3 * MU),
                3 * force,
                "linear in viscosity",
            ),
            (
                "half the clearance",
                film(e / 2, v / 2, clearance_m=C / 2),
                4 * force,
                "F ~ 1/c^2 at equal e/c, v/c",
            ),
            ("turned by 90 degrees", film(e @ turn.T, v @ turn.T), force @ turn.T, "rotation"),
            (
                "reflected",
                film(e * mirror, v * mirror, speed_rad_s=-OMEGA),
                force * mirror,
                "reversed speed",
            ),
        )
        for name, found, expected, source in cases:
            case = f"{rupture}, 12 random states, {name}: largest relative error"
            yield residual(case, apart(found.force_N, expected), source, 1e-9)


def fast_films() -> Iterator[ComparisonRow]:
    """The films that the rotor runs on against the film they stand for, on a fine grid."""
    e, v = states(40, 3)
    table, direct = FilmTable.load(0.5).coefficients, DirectFilm.make()
    state = (OMEGA, C, MU, R, R)
    tabulated = np.array(
        [table_force(table, *a, *b, *state)[:2] for a, b in zip(e, v, strict=True)]
    )
    solved = np.array(
        [
            direct_force(direct.ring, direct.axial, direct.work, *a, *b, *state)[:2]
            for a, b in zip(e, v, strict=True)
        ]
    )
    cases: tuple[tuple[str, Floats, Rupture, float], ...] = (
        ("table", tabulated, "reynolds", 3e-3),
        ("direct", solved, "gumbel", 2e-2),
    )
    for name, found, rupture, allowed in cases:
        exact = film_of(e, v, rupture=rupture, grid=(240, 30)).force_N
        case = f"{name} film, 40 random states to eps=0.9: largest relative error"
        yield residual(case, apart(found, exact), f"film_force, {rupture}, fine grid", allowed)


def whirl_and_dissipation() -> Iterator[ComparisonRow]:
    """No force in pure whirl at half speed; the film never drives the effective squeeze, nor gives
    power."""
    e, v = states(40, 2)
    half = OMEGA / 2 * np.column_stack([-e[:, 1], e[:, 0]])
    still = np.hypot(*film_of(e, np.zeros_like(e)).force_N.T).mean()
    whirled = float(np.max(np.hypot(*film_of(e, half).force_N.T)) / still)
    yield residual(
        "reynolds: force in pure whirl at omega/2 over force at rest",
        whirled,
        "paper, equation (3)",
        1e-9,
    )
    film = film_of(e, v)
    against = float(
        np.max(np.sum(film.force_N * (v - half), axis=1) / (np.hypot(*film.force_N.T) * C * OMEGA))
    )
    yield ComparisonRow(
        "reynolds: F . v_s not above zero, 40 states",
        float(against <= 0),
        1.0,
        "dissipation",
        0.0,
        True,
    )
    power = film.friction_torque_N_m * OMEGA - np.sum(film.force_N * v, axis=1)
    yield ComparisonRow(
        "reynolds: dissipated power above zero, 40 states",
        float(power.min() > 0),
        1.0,
        "second law",
        0.0,
        True,
    )


def complementarity() -> Iterator[ComparisonRow]:
    """Pressure and Reynolds residual of the ruptured film, by finite differences of our own on the
    returned field."""
    e = np.array([0.3, -0.6]) * C
    film = film_of(e, (0.0, 0.0), fields=True, grid=(180, 24))
    assert film.pressure_Pa is not None
    assert film.theta_rad is not None
    assert film.z_m is not None
    p, (theta, gap, face) = film.pressure_Pa, _ring(film.theta_rad)
    width = ((gap + np.roll(gap, 1)) / 2)[:, None]
    at_face, at_node = _thickness(e, face), _thickness(e, theta)
    flux = (at_face**3 / gap)[:, None] * (np.roll(p, -1, axis=0) - p) / (12 * MU * R**2)
    dz = np.diff(film.z_m)
    curvature = np.diff(np.diff(p, axis=1) / dz, axis=1) / ((dz[1:] + dz[:-1]) / 2)
    divergence = ((flux - np.roll(flux, 1, axis=0)) / width)[:, 1:-1] + (at_node**3)[:, None] / (
        12 * MU
    ) * curvature
    wedge = OMEGA / 2 * (at_face - np.roll(at_face, 1))[:, None] / width
    excess = (wedge - divergence) / np.abs(wedge).max()
    full = p[:, 1:-1] > 1e-9 * p.max()
    source = "Swift-Stieber: p >= 0, div q <= wedge, one of them equal"
    name = "reynolds, own finite differences:"
    yield ComparisonRow(f"{name} smallest pressure, Pa", float(p.min()), 0.0, source, 1e-9, True)
    yield residual(
        f"{name} largest residual where p > 0", float(np.abs(excess[full]).max()), source, 5e-3
    )
    yield residual(
        f"{name} largest inflow where p = 0", float(max(0, -excess[~full].min())), source, 5e-3
    )


def _ring(theta: Floats) -> tuple[Floats, Floats, Floats]:
    """Angles, gaps to the next ones, and faces between."""
    gap = np.remainder(np.roll(theta, -1) - theta, 2 * np.pi)
    return theta, gap, theta + gap / 2


def _thickness(e: Floats, theta: Floats) -> Floats:
    return np.asarray(C - e @ [np.cos(theta), np.sin(theta)])


def flow_balance() -> Iterator[ComparisonRow]:
    """The mass-conserving film loses nothing, neither in all nor along the streamers."""
    e = np.array([0.2, -0.6]) * C
    groove = FeedPatch("groove", math.pi / 2, math.radians(20), 0.8 * R, 1e5)
    film = film_of(e, (0.0, 0.0), rupture="jfo", feed=[groove], fields=True)
    source = "mass conservation (Jakobsson, Floberg, Olsson)"
    yield ComparisonRow(
        "jfo: side flow, m3/s, against inflow",
        float(film.side_flow_m3_s),
        float(film.inflow_m3_s),
        source,
        1e-7,
    )
    assert film.fill is not None
    assert film.theta_rad is not None
    _, _, face = _ring(film.theta_rad)
    carried = film.fill * _thickness(e, face)[:, None]
    dry = film.fill < 1
    alone = dry & np.roll(dry, 1, axis=0) & np.roll(dry, -1, axis=0)
    alone[:, 1:-1] &= dry[:, :-2] & dry[:, 2:]
    alone[:, [0, -1]] = False
    pairs = alone & np.roll(alone, 1, axis=0)
    change = np.abs(carried / np.roll(carried, 1, axis=0) - 1)[pairs]
    case = f"jfo: change of fill x gap along {int(pairs.sum())} streamer faces"
    yield residual(case, float(change.max()), source, 1e-6)


def grid_convergence() -> Iterator[ComparisonRow]:
    """Loads on three grids, each twice as fine, and the default grid against their limit."""

    def load(rupture: Rupture, grid: tuple[int, int]) -> float:
        inlet: Inlet = "groove_hmax" if rupture == "jfo" else "periodic"
        film = film_of((0.0, -0.7 * C), (0.0, 0.0), rupture=rupture, inlet=inlet, grid=grid)
        return float(np.hypot(*film.force_N))

    for rupture in get_args(Rupture):
        loads = [load(rupture, (60 * k, 8 * k)) for k in (1, 2, 4)]
        limit = loads[2] + (loads[2] - loads[1]) / 3
        order = math.log2(abs((loads[0] - loads[1]) / (loads[1] - loads[2])))
        default = load(rupture, DEFAULT_GRID)
        yield ComparisonRow(
            f"{rupture}: load on the default grid, N", default, limit, "Richardson limit", 5e-3
        )
        # a rupture line that crosses the cells adds a first-order grain to the second order of the
        # scheme
        yield ComparisonRow(
            f"{rupture}: observed order of convergence", order, 2.0, "three grids", 1.0, True
        )
