"""The tabulated film with a groove against the solver that it was made with, at points that it has
not seen."""

import numpy as np
import pytest

from sim_hil.film import FeedPatch, FilmError, film_force
from sim_hil.film.fed import FedTable, fed_force
from sim_hil.film.table_kernel import EPS_TABLE, contact_force, table_force

R = L = 0.02
WIDTH, SHARE = np.radians(20), 0.8
TABLE = FedTable.load(0.5, WIDTH, SHARE)
LAW = TABLE.law(np.pi / 2)
C, MU, OMEGA, SUPPLY = 60e-6, 0.01, 300.0, 1e5
E, V = np.array([0.3, -0.4]) * C, np.array([1e-3, -5e-4])


def solved(e, v, c, mu, omega, supply):
    groove = FeedPatch("groove", np.pi / 2, WIDTH, SHARE * L, supply)
    return film_force(
        e,
        v,
        radius_m=R,
        length_m=L,
        clearance_m=c,
        viscosity_Pa_s=mu,
        speed_rad_s=omega,
        feed=[groove],
        grid=(96, 14),
    )


def tabulated(e, v, c=C, mu=MU, omega=OMEGA, supply=SUPPLY, law=LAW, c_rate=0.0):
    return np.array(fed_force(law, *e, *v, omega, c, mu, R, L, c_rate, supply))


def polar(length, angle):
    return length * np.array([np.cos(angle), np.sin(angle)])


def drawn(rng, low, high):
    """A state with the journal between these angles, its oil and the supply pressure."""
    c, omega, eps = rng.uniform(40e-6, 160e-6), rng.uniform(157, 1257), rng.uniform(0, 0.95)
    e = polar(eps * c, rng.uniform(low, high))
    v = 0.2 * omega * eps * c * rng.normal(size=2)
    return e, v, c, rng.uniform(0.005, 0.012), omega, rng.uniform(5e4, 3e5)


@pytest.mark.parametrize(("low", "high"), [(-np.pi, np.pi), (-np.pi / 2 - 0.3, 1.0 - np.pi / 2)])
def test_unseen_states(low, high):
    """Errors over the force of the unfed film plus supply pressure times projected area; of the
    flow, relative."""
    rng = np.random.default_rng(11)
    force_error, flow_error = [], []
    for _ in range(40):
        e, v, c, mu, omega, supply = state = drawn(rng, low, high)
        film = solved(*state)
        fx, fy, torque, flow, inflow = tabulated(e, v, c, mu, omega, supply)
        unfed = table_force(LAW.unfed, *e, *v, omega, c, mu, R, L, 0.0)
        scale = np.hypot(unfed[0], unfed[1]) + 2 * R * L * supply
        force_error.append(np.hypot(*(film.force_N - (fx, fy))) / scale)
        flow_error.append(abs(flow / film.side_flow_m3_s - 1))
        assert torque == pytest.approx(film.friction_torque_N_m, rel=1e-2)
        assert inflow == flow
    assert np.median(force_error) < 3e-3
    assert np.max(force_error) < 2.5e-2
    assert np.median(flow_error) < 1e-2
    assert np.max(flow_error) < 0.15


def test_standing_still_is_hydrostatic():
    film = solved(E, (0.0, 0.0), C, MU, 0.0, SUPPLY)
    fx, fy, torque, flow, _ = tabulated(E, (0.0, 0.0), omega=0.0)
    np.testing.assert_allclose((fx, fy), film.force_N, atol=1e-2 * np.hypot(*film.force_N))
    assert flow == pytest.approx(film.side_flow_m3_s, rel=1e-2)
    assert torque == pytest.approx(film.friction_torque_N_m, rel=2e-2)


def test_homogeneous_and_similar():
    one = tabulated(E, V)
    faster = tabulated(E, 3 * V, omega=3 * OMEGA, mu=2 * MU, supply=6 * SUPPLY)
    np.testing.assert_allclose(faster, one * [6, 6, 6, 3, 3], rtol=1e-9)
    wide = tabulated(2 * E, 2 * V, c=2 * C, supply=SUPPLY / 4)
    np.testing.assert_allclose(wide[:2], one[:2] / 4, rtol=1e-9)


def test_mirrored_and_turned_with_the_groove():
    one = tabulated(E, V)
    mirror = np.array([-1.0, 1.0])
    np.testing.assert_allclose(
        tabulated(E * mirror, V * mirror, omega=-OMEGA),
        one * [-1, 1, 1, 1, 1],
        rtol=1e-9,
        atol=1e-12,
    )
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = tabulated(turn @ E, turn @ V, law=TABLE.law(np.pi))
    np.testing.assert_allclose(turned, np.append(turn @ one[:2], one[2:]), rtol=1e-9)


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_continuous_across_the_seams(angle):
    """The angles wrap, the mirror plane lies through the groove, and the centre has no
    direction."""
    near = [tabulated(polar(0.5 * C, angle + s), polar(1e-3, angle + s)) for s in (-1e-7, 1e-7)]
    np.testing.assert_allclose(near[0], near[1], rtol=1e-4, atol=1e-4 * np.abs(near[0]).max())
    centre, aside = tabulated((0.0, 0.0), V), tabulated(polar(1e-9, angle), V)
    np.testing.assert_allclose(aside[:2], centre[:2], atol=5e-3 * np.hypot(*centre[:2]))


def test_opening_clearance_draws_oil():
    *_, flow, inflow = tabulated(E, V, c_rate=5e-5)
    assert inflow - flow == pytest.approx(2 * np.pi * R * L * 5e-5, rel=1e-9)


def test_contact_is_added_once():
    inside, outside = (tabulated(polar(s * C, -1.0), (0.0, 0.0)) for s in (EPS_TABLE, 1.005))
    contact = contact_force(*polar(1.005 * C, -1.0), OMEGA, C)
    np.testing.assert_allclose(outside[:2], inside[:2] + contact[:2], rtol=1e-6)


@pytest.mark.parametrize("supply", [0.0, -1e5, 1e9])
def test_finite_for_any_supply(supply):
    assert np.all(np.isfinite(tabulated(E, V, supply=supply)))
    assert np.all(np.isfinite(tabulated((0.0, 0.0), (0.0, 0.0), omega=0.0, supply=supply)))


def test_a_small_table_saves_and_loads(tmp_path, monkeypatch):
    table = FedTable.build(0.5, WIDTH, SHARE, cells=(4, 4, 4, 4), grid=(24, 6))
    table.save(tmp_path)
    monkeypatch.setattr("sim_hil.film.fed._DATA", tmp_path)
    np.testing.assert_allclose(
        FedTable.load(0.5, WIDTH, SHARE).groove, table.groove, rtol=1e-6, atol=1e-7
    )


def test_no_table_for_another_groove():
    with pytest.raises(FilmError, match=r"no film table for length/diameter 0\.7"):
        FedTable.load(0.7, WIDTH, SHARE)
