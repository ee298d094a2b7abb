"""The table of the film with openings against the solver, at both ends, and as a file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from firmware_py.machine import FeedPort
from firmware_py.machine.restrictor import Restrictor
from sim_hil.film import film_force
from sim_hil.film.feeding import feed_patches
from sim_hil.film.port_table import PortLaw, PortTable, port_force, port_law
from sim_hil.film.records import Floats
from sim_hil.film.table import FilmTable
from sim_hil.film.table_kernel import EPS_TABLE, contact_force, table_force
from sim_hil.rigs import load_rig
from sim_hil.rotor.film_law import film_law

SEED = load_rig("seed")
R = L = 0.02
C, MU, OMEGA, RHO, SUPPLY = 62.5e-6, 1e-3, 300.0, 998.0, 4.35e5
UNFED = FilmTable.load(0.5).coefficients


@pytest.fixture(scope="module")
def law() -> PortLaw:
    return port_law(SEED.supply.ports, R, L, RHO)


def found(law: PortLaw, e: Floats, v: Floats, supply: float = SUPPLY) -> Floats:
    return np.array(port_force(law, *e, *v, OMEGA, C, MU, R, L, 0.0, supply))


def solved(e: Floats, v: Floats, supply: float = SUPPLY, rupture: str = "reynolds"):
    return film_force(
        e, v, radius_m=R, length_m=L, clearance_m=C, viscosity_Pa_s=MU, speed_rad_s=OMEGA,
        feed=feed_patches(SEED.supply.ports, R, RHO, supply), grid=(96, 14), rupture=rupture,
    )  # fmt: skip


def polar(length: float, angle: float) -> Floats:
    return length * np.array([math.cos(angle), math.sin(angle)])


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.2])
@pytest.mark.parametrize("eps", [0.2, 0.5, 0.8])
def test_force_and_flow_at_rest_are_the_solvers(law: PortLaw, eps: float, angle: float) -> None:
    e, still = polar(eps * C, angle), np.zeros(2)
    exact, table = solved(e, still), found(law, e, still)
    assert np.hypot(*(table[:2] - exact.force_N)) < 0.06 * np.hypot(*exact.force_N)
    assert table[3] == pytest.approx(exact.side_flow_m3_s, rel=0.12)


def test_a_film_without_suction_is_the_solvers_to_a_percent(law: PortLaw) -> None:
    e, v = polar(0.05 * C, 0.4), polar(2e-4, 1.0)
    exact, full = solved(e, v), solved(e, v, rupture="full")
    np.testing.assert_allclose(exact.force_N, full.force_N, rtol=1e-6)
    table = found(law, e, v)
    assert np.hypot(*(table[:2] - exact.force_N)) < 0.015 * np.hypot(*exact.force_N)


def test_behind_closed_restrictors_it_is_the_plain_film(law: PortLaw) -> None:
    closed = law._replace(restrictor=np.tile([0.0, 0.0, 1e24, 0.0], (4, 1)))
    for eps, angle in ((0.3, 0.2), (0.8, 2.2)):
        e, v = polar(eps * C, angle), polar(1e-3, -0.7)
        plain = table_force(UNFED, *e, *v, OMEGA, C, MU, R, L, 0.0)
        np.testing.assert_allclose(found(closed, e, v)[:2], plain[:2], rtol=2e-3, atol=1e-6)


def test_openings_turn_with_the_bearing() -> None:
    row = [FeedPort("orifice", angle, bore_mm=1.0) for angle in (0.0, 90.0, 180.0, 270.0)]
    turned = port_law(row, R, L, RHO)
    law = port_law(SEED.supply.ports, R, L, RHO)
    e, v, quarter = polar(0.5 * C, 0.2), polar(1e-3, 1.1), -math.pi / 4
    spin = np.array(
        [[math.cos(quarter), -math.sin(quarter)], [math.sin(quarter), math.cos(quarter)]]
    )
    here, there = found(law, e, v), found(turned, spin @ e, spin @ v)
    assert np.hypot(*(spin @ here[:2] - there[:2])) < 0.02 * np.hypot(*here[:2])


def test_past_the_table_it_is_the_contacts(law: PortLaw) -> None:
    e = polar(1.0005 * C, 0.7)
    inside = found(law, e * EPS_TABLE * C / np.hypot(*e), np.zeros(2))
    beyond = found(law, e, np.zeros(2))
    contact = contact_force(*e, OMEGA, C)
    np.testing.assert_allclose(beyond[:2] - inside[:2], contact[:2], rtol=1e-6)
    assert np.isfinite(beyond).all()


def test_the_rotors_call_is_the_same(law: PortLaw) -> None:
    e, v = polar(0.4 * C, 0.2), polar(1e-3, 1.1)
    same = film_law(law, *e, *v, OMEGA, C, MU, R, L, 0.0, SUPPLY)
    np.testing.assert_array_equal(same, found(law, e, v))


def test_a_table_is_kept_under_the_hash_of_what_decides_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    places = [PortTable.of(0.5, ()).openings, PortTable.of(0.4, ()).openings]
    files = sorted((tmp_path / "orbitd" / "film").iterdir())
    assert len(files) == len(places) == 2
    again = PortTable.of(0.5, ())
    assert f"ports_{again.key}.npz" in {file.name for file in files}
    assert Restrictor() == Restrictor(0.0)
