"""Feeds behind restrictors: closed forms of hydrostatic bearings, limits, balances, and the table
that the rotor runs on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from firmware_py.machine.restrictor import Restrictor, capillary, orifice
from sim_hil.film import FeedPatch, FilmForce, equilibrium, film_force
from sim_hil.film.feeding import feed_patches
from sim_hil.film.port_table import port_force, port_law
from sim_hil.rigs import load_rig
from sim_hil.verify.closed_forms import C, R
from sim_hil.verify.properties import apart
from sim_hil.verify.row import ComparisonRow, residual

_RHO, _MU, _SUPPLY = 998.0, 1e-3, 4e5
_SEGMENTS = 24
_SHARE = 0.25
"""Of the circumference that the segments of a row cover: a segment has one pressure, and many that
nearly touch would be a way around for the flow."""
_THIN = 0.02
"""Length of a segment along the axis, over the journal radius."""


def _film(e: tuple[float, float], feed: list[FeedPatch], **rules: object) -> FilmForce:
    usual = {"radius_m": R, "length_m": R, "clearance_m": C, "viscosity_Pa_s": _MU,
             "speed_rad_s": 0.0, "feed": feed}  # fmt: skip
    return film_force(np.array(e) * C, np.zeros(2), **(usual | rules))  # type: ignore[arg-type]


def _row(law: Restrictor) -> list[FeedPatch]:
    """Segments all round in the middle plane, each behind its own restrictor."""
    width = 2 * math.pi / _SEGMENTS
    return [
        FeedPatch("groove", k * width, _SHARE * width, _THIN * R, _SUPPLY, 0.0, law)
        for k in range(_SEGMENTS)
    ]


def _holes(law: Restrictor, count: int = 4, first: float = math.pi / 4) -> list[FeedPatch]:
    bore = 1e-3
    return [
        FeedPatch("orifice", first + 2 * math.pi * k / count, bore / R, bore, _SUPPLY, 0.0, law)
        for k in range(count)
    ]


def _line_fed(segment_Pa: float, line_Pa: float, softness: float, length: float) -> float:
    """Stiffness, N/m, of the concentric bearing at rest with a line of restrictors in its middle
    plane.

    The full film at small eccentricity eps: p = l (1 - z/a) + eps A cos(theta) sinh((a - z)/R) /
    sinh(a/R), a the land on either side.  The flow of a restrictor falls by ``softness`` dp /
    (p_s - s) of itself: 1 of a capillary, 1/2 of an orifice, and it spreads from the segments'
    pressure s to that of the line, l, through a film that goes with h^3 as well.  Where s is l and
    the bearing short, A = 3 b (1 - b) p_s and 6 b (1 - b) / (2 - b) p_s with b = l / p_s (Rowe,
    Hydrostatic and Hybrid Bearing Design, 1983).
    """
    land, spread, drop = length / 2, segment_Pa - line_Pa, _SUPPLY - segment_Pa
    leaving = land / (R * math.tanh(land / R) * line_Pa)
    rise, _ = np.linalg.solve(
        [[-1 / spread, 1 / spread + softness / drop], [leaving, softness / drop]], [3.0, 3.0]
    )
    return 2 * math.pi * R**2 * float(rise) * math.tanh(land / (2 * R)) / C


def hydrostatic() -> Iterator[ComparisonRow]:
    """Pockets and rows at rest beside their closed forms."""
    width = 0.2 * R
    ring = FeedPatch("groove", 0.0, 2 * math.pi, width, _SUPPLY, 0.0, capillary(0.6e-3, 60e-3))
    film = _film((0.0, 0.0), [ring], grid=(96, 40))
    lands = 12 * _MU * (R - width) / 2 / (4 * math.pi * R * C**3)
    pipe = 128 * _MU * 60e-3 / (math.pi * 0.6e-3**4)
    source = "capillary and two annular lands in series"
    yield ComparisonRow(
        "capillary-fed pocket all round: flow, L/min",
        6e4 * float(film.inflow_m3_s), 6e4 * _SUPPLY / (lands + pipe), source, 1e-3,
    )  # fmt: skip
    assert film.feed_pressure_Pa is not None
    yield ComparisonRow(
        "capillary-fed pocket all round: pressure over supply",
        float(film.feed_pressure_Pa[0]) / _SUPPLY, lands / (lands + pipe), source, 1e-3,
    )  # fmt: skip
    slow, small = 1e-4, 0.02
    for name, law, softness in (
        ("capillaries", capillary(0.35e-3, 40e-3), 1.0),
        ("orifices", orifice(0.3e-3, 0.61, _RHO, 1.0), 0.5),
    ):
        for length in (R / 2, R):
            row = _row(law)
            rest = _film((0.0, 0.0), row, length_m=length, rupture="full")
            assert rest.feed_pressure_Pa is not None
            segment_Pa = float(rest.feed_pressure_Pa.mean())
            line_Pa = float(rest.inflow_m3_s) * 12 * _MU * length / 2 / (4 * math.pi * R * C**3)
            moved = _film((small, 0.0), row, length_m=length, rupture="full", speed_rad_s=slow)
            yield ComparisonRow(
                f"row of {_SEGMENTS} {name}, L/D={length / (2 * R):g}: stiffness, N/um",
                -float(moved.force_N[0]) / (small * C) * 1e-6,
                _line_fed(segment_Pa, line_Pa, softness, length) * 1e-6,
                f"line feed, small eccentricity, at {segment_Pa / _SUPPLY:.2f} of the supply",
                3e-2,
            )


def restricted() -> Iterator[ComparisonRow]:
    """Flow balance, symmetry, and both ends of a restrictor."""
    hole = orifice(1e-3, 0.61, _RHO, math.pi * 1e-3)
    e, omega = (0.3, -0.5), 300.0
    film = _film(e, _holes(hole), rupture="jfo", speed_rad_s=omega)
    source = "mass conservation"
    yield ComparisonRow(
        "four orifices, jfo: side flow, m3/s, against inflow",
        float(film.side_flow_m3_s), float(film.inflow_m3_s), source, 1e-7,
    )  # fmt: skip
    assert film.feed_pressure_Pa is not None
    assert film.feed_flow_m3_s is not None
    told = [
        hole.flow_m3_s(
            _SUPPLY - float(p),
            _MU,
            C * (1 - e[0] * math.cos(f.angle_rad) - e[1] * math.sin(f.angle_rad)),
        )
        for p, f in zip(film.feed_pressure_Pa, _holes(hole), strict=True)
    ]
    worst = float(np.max(np.abs(film.feed_flow_m3_s / np.array(told) - 1)))
    yield residual(
        "four orifices, jfo: flow into the film over the restrictors'", worst, source, 1e-7
    )
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    one = _film(e, _holes(hole, 3), speed_rad_s=omega)
    x, y = turn @ e
    other = _film((x, y), _holes(hole, 3, 0.75 * math.pi), speed_rad_s=omega)
    yield residual(
        "three orifices, all turned by 90 degrees: largest relative error",
        apart(other.force_N[None], (turn @ one.force_N)[None]), "rotation", 1e-9,
    )  # fmt: skip
    ports = _film(e, [replace(f, restrictor=Restrictor()) for f in _holes(hole)], speed_rad_s=omega)
    wide = _film(e, _holes(Restrictor(l0=1e3)), speed_rad_s=omega)
    yield residual(
        "restrictor without resistance, beside ports: error of the force",
        apart(wide.force_N[None], ports.force_N[None]), "limit of a wide restrictor", 1e-6,
    )  # fmt: skip
    plain = _film(e, [], speed_rad_s=omega)
    closed = _film(e, _holes(Restrictor(l0=1e22)), speed_rad_s=omega)
    yield residual(
        "closed restrictor, beside the plain film: error of the force",
        apart(closed.force_N[None], plain.force_N[None]), "limit of a closed one", 5e-2,
    )  # fmt: skip
    for name, feed in (("ports", [replace(f, restrictor=Restrictor()) for f in _holes(hole)]),
                       ("orifices", _holes(hole))):  # fmt: skip
        state = equilibrium(
            load_N=5.0, radius_m=R, length_m=R, clearance_m=C, viscosity_Pa_s=_MU,
            speed_rad_s=omega, feed=feed,
        )  # fmt: skip
        yield ComparisonRow(
            f"four {name} at {_SUPPLY * 1e-5:g} bar, 5 N: least direct stiffness, N/um",
            float(np.diag(state.stiffness_N_m).min()) * 1e-6, 0.0, "shown", None, True,
        )  # fmt: skip


def port_table() -> Iterator[ComparisonRow]:
    """The table of the rig `seed` against the solver at states it has not seen."""
    rig, random = load_rig("seed"), np.random.default_rng(7)
    ports, c, mu, omega = rig.supply.ports, rig.bearing.clearance_nominal_m, 1e-3, 300.0
    law = port_law(ports, R, R, rig.oil.density_kg_m3)
    for speed_share in (0.0, 0.3):
        for supply in (rig.supply.min_Pa, rig.supply.max_Pa):
            errors, flows = [], []
            for _ in range(40):
                eps, at, way = 0.9 * math.sqrt(random.uniform()), *random.uniform(0, 2 * math.pi, 2)
                e = eps * c * np.array([math.cos(at), math.sin(at)])
                v = (
                    speed_share
                    * random.uniform()
                    * c
                    * omega
                    * np.array([math.cos(way), math.sin(way)])
                )
                found = port_force(law, *e, *v, omega, c, mu, R, R, 0.0, supply)
                feed = feed_patches(ports, R, rig.oil.density_kg_m3, supply)
                rules = {"radius_m": R, "length_m": R, "clearance_m": c, "viscosity_Pa_s": mu,
                         "speed_rad_s": omega, "grid": (120, 16)}  # fmt: skip
                exact = film_force(e, v, feed=feed, **rules)  # type: ignore[arg-type]
                bare = film_force(e, v, **rules)  # type: ignore[arg-type]
                size = np.hypot(*exact.force_N) + np.hypot(*bare.force_N)
                errors.append(float(np.hypot(*(np.array(found[:2]) - exact.force_N)) / size))
                flows.append(abs(found[3] / float(exact.side_flow_m3_s) - 1))
            case = f"seed, {supply * 1e-5:g} bar, 40 states, velocity to {speed_share:g} c omega:"
            source = "film_force; median, share of |F| with and without feed"
            yield residual(f"{case} force", float(np.median(errors)), source, 3e-2)
            yield ComparisonRow(
                f"{case} force, 95 %", float(np.quantile(errors, 0.95)), 0.0,
                "film_force; 95 of 100", None, True,
            )  # fmt: skip
            yield residual(f"{case} side flow", float(np.median(flows)), "film_force; median", 5e-2)
