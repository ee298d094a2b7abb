"""Restrictors in the film: balance, limits, symmetry, stiffness, and the store of a recess."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_py.machine.restrictor import NONE, Restrictor, capillary, orifice
from sim_hil.film import FeedPatch, FilmError, FilmMemory, equilibrium, film_force
from sim_hil.film.records import Floats

R = L = 0.02
C, MU, OMEGA, RHO, SUPPLY = 60e-6, 1e-3, 300.0, 998.0, 4e5
RULES = {"radius_m": R, "length_m": L, "clearance_m": C, "viscosity_Pa_s": MU}
GRID = (64, 12)


def row(law: Restrictor, count: int = 4, at: float = math.pi / 4, bore: float = 1e-3) -> list:
    return [
        FeedPatch("orifice", at + 2 * math.pi * k / count, bore / R, bore, SUPPLY, 0.0, law)
        for k in range(count)
    ]


def hole(bore: float = 1e-3) -> Restrictor:
    return orifice(bore, 0.61, RHO, math.pi * bore)


def force(e: Floats, feed: list, **rules: object) -> Floats:
    return np.asarray(film(e, feed, **rules).force_N)


def film(e: Floats, feed: list, **rules: object):
    return film_force(
        np.asarray(e) * C,
        np.zeros(2),
        feed=feed,
        grid=GRID,
        **({**RULES, "speed_rad_s": OMEGA} | rules),
    )


@pytest.mark.parametrize("law", [hole(), capillary(0.3e-3, 20e-3)])
@pytest.mark.parametrize("rupture", ["full", "jfo"])
def test_what_the_restrictors_let_in_leaves_at_the_ends(law: Restrictor, rupture: str) -> None:
    e = np.array([0.3, -0.5])
    found = film(e, row(law), rupture=rupture)
    assert found.side_flow_m3_s == pytest.approx(found.inflow_m3_s, rel=1e-8)
    for feed, pressure, flow in zip(
        row(law), found.feed_pressure_Pa, found.feed_flow_m3_s, strict=True
    ):
        at = np.array([math.cos(feed.angle_rad), math.sin(feed.angle_rad)])
        drop = SUPPLY - float(pressure)
        assert law.flow_m3_s(drop, MU, C * (1 - float(e @ at))) == pytest.approx(flow, rel=1e-8)
        assert 0 < pressure < SUPPLY


def test_without_resistance_it_is_a_port_and_with_much_a_plain_film() -> None:
    e = np.array([0.2, -0.6])
    small = Restrictor(l0=1e3)
    ports = [replace(feed, restrictor=NONE) for feed in row(NONE)]
    np.testing.assert_allclose(force(e, row(small)), force(e, ports), rtol=1e-6)
    closed = film(e, row(Restrictor(l0=1e22), bore=0.2e-3))
    plain = force(e, [])
    assert abs(closed.inflow_m3_s) < 1e-12
    assert np.hypot(*(closed.force_N - plain)) < 0.02 * np.hypot(*plain)


def test_the_film_turns_with_its_openings_and_mirrors() -> None:
    e, turn = np.array([0.2, -0.5]), 0.7
    spin = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    base = force(e, row(hole(), 3, 0.3))
    turned = force(spin @ e, row(hole(), 3, 0.3 + turn))
    np.testing.assert_allclose(turned, spin @ base, rtol=1e-9)
    mirrored = film(e * [-1, 1], row(hole(), 3, math.pi - 0.3), speed_rad_s=-OMEGA).force_N
    np.testing.assert_allclose(mirrored, base * [-1, 1], rtol=1e-6)


def test_orifices_push_back_where_ports_pull() -> None:
    """A port at constant pressure has negative stiffness; a restrictor's is positive."""
    upward = np.array([0.0, 0.2])
    port = force(upward, row(NONE, 1, math.pi / 2), speed_rad_s=0.0)[1]
    middle = force(np.zeros(2), row(NONE, 1, math.pi / 2), speed_rad_s=0.0)[1]
    assert port > middle  # nearer the port it is pushed away less
    four = force(upward, row(hole()), speed_rad_s=0.0)[1]
    assert four < 0
    state = equilibrium(load_N=20.0, feed=row(hole()), grid=GRID, speed_rad_s=OMEGA, **RULES)
    assert np.all(np.diag(state.stiffness_N_m) > 0)


def test_openings_lie_anywhere_along_the_bearing() -> None:
    two = [replace(feed, axial_m=side * 0.005) for feed in row(hole()) for side in (-1.0, 1.0)]
    found = film([0.0, -0.4], two)
    pressures = found.feed_pressure_Pa.reshape(4, 2)
    np.testing.assert_allclose(pressures[:, 0], pressures[:, 1], rtol=1e-6)
    assert found.side_flow_m3_s == pytest.approx(found.inflow_m3_s, rel=5e-3)
    with pytest.raises(FilmError, match="reach the end of the bearing"):
        film([0.0, 0.0], [replace(row(hole())[0], axial_m=0.0096)])


def test_a_recess_with_air_follows_late() -> None:
    law = hole()._replace(volume_m3=2e-7, air_share=0.05)
    start = film([0.0, -0.2], row(law))
    memory = FilmMemory(1e-6, 1.0, start.feed_pressure_Pa)
    at_once = film([0.0, -0.3], row(law))
    late = film([0.0, -0.3], row(law), memory=memory)
    change = at_once.feed_pressure_Pa - start.feed_pressure_Pa
    assert np.all(np.abs(late.feed_pressure_Pa - start.feed_pressure_Pa) < 0.3 * np.abs(change))
    for _ in range(400):
        late = film([0.0, -0.3], row(law), memory=FilmMemory(1e-3, 1.0, late.feed_pressure_Pa))
    np.testing.assert_allclose(late.feed_pressure_Pa, at_once.feed_pressure_Pa, rtol=1e-3)
