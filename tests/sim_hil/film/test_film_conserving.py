"""The mass-conserving film, steady and with memory."""

import numpy as np
import pytest

from sim_hil.film import FeedPatch, FilmError, FilmMemory, equilibrium, film_force

C = 60e-6
OIL = {
    "radius_m": 0.02,
    "length_m": 0.02,
    "clearance_m": C,
    "viscosity_Pa_s": 0.01,
    "speed_rad_s": 300.0,
}
GROOVE = FeedPatch("groove", np.pi / 2, np.radians(20), 0.016, 1e5)
E, REST = np.array([0.24, -0.55]) * C, (0.0, 0.0)
MIRROR = np.array([-1.0, 1.0])
FED = OIL | {"rupture": "jfo", "feed": [GROOVE], "grid": (96, 12)}


@pytest.mark.parametrize(
    "supply", [{"feed": [GROOVE]}, {"inlet": "groove_hmax"}, {"rupture": "full", "feed": [GROOVE]}]
)
@pytest.mark.parametrize("speed", [300.0, -300.0])
def test_what_comes_in_goes_out(supply, speed):
    film = film_force(E, REST, **(OIL | {"rupture": "jfo", "speed_rad_s": speed} | supply))
    assert film.inflow_m3_s > 0
    assert film.inflow_m3_s == pytest.approx(film.side_flow_m3_s, rel=1e-5)


def test_film_between_flooded_ends_only_circulates():
    film = film_force(E, REST, end_pressure_Pa=(5e4, 5e4), rupture="jfo", **OIL)
    circulating = 300 / 2 * C * 0.02 * 0.02
    assert abs(film.side_flow_m3_s) < 1e-6 * circulating


def test_steady_rupture_is_that_of_reynolds_behind_an_inlet_line():
    """The rupture condition is the same, the reformation is at the line in both."""
    conserving, reynolds = (
        film_force(E, REST, inlet="groove_hmax", rupture=r, couette="filled", **OIL)
        for r in ("jfo", "reynolds")
    )
    np.testing.assert_allclose(conserving.force_N, reynolds.force_N, rtol=1e-9)
    assert conserving.friction_torque_N_m == pytest.approx(reynolds.friction_torque_N_m, rel=1e-3)


def test_pressure_and_void_exclude_each_other():
    film = film_force(E, REST, fields=True, **FED)
    ruptured = film.fill < 1
    assert 0.1 < ruptured.mean() < 0.7
    assert film.fill.min() >= 0
    assert film.pressure_Pa.min() == 0
    inside = ruptured[:, 1:-1]
    assert np.all(film.pressure_Pa[:, 1:-1][inside] == 0)


def test_streamers_carry_their_oil_along():
    """Between the port and the ends, fill x gap is constant downstream of rupture where no pressure
    acts."""
    film = film_force(E, REST, fields=True, **FED)
    gap = C - E[0] * np.cos(film.theta_rad) - E[1] * np.sin(film.theta_rad)
    middle = film.z_m.size // 2
    dry = film.pressure_Pa[:, middle] == 0
    face = (gap + np.roll(gap, -1)) / 2
    carried = (film.fill[:, middle] * face)[dry & np.roll(dry, 1) & np.roll(dry, -1)]
    assert carried.size > 5
    np.testing.assert_allclose(carried, carried.mean(), rtol=2e-2)


def test_mirror_symmetry():
    one = film_force(E, (1e-3, 2e-3), **FED)
    two = film_force(E * MIRROR, (-1e-3, 2e-3), **(FED | {"speed_rad_s": -300.0}))
    np.testing.assert_allclose(two.force_N, one.force_N * MIRROR, rtol=1e-9)
    assert two.side_flow_m3_s == pytest.approx(one.side_flow_m3_s, rel=1e-9)


def test_memory_leads_to_the_steady_film():
    memory = FilmMemory(dt_s=5e-3)
    for _ in range(60):
        film = film_force(E, REST, memory=memory, **FED)
        memory = film.memory
    steady = film_force(E, REST, **FED)
    np.testing.assert_allclose(film.force_N, steady.force_N, rtol=2e-2)


def test_memory_keeps_the_film_from_filling_at_once():
    """After the journal backed away, the gap it left stays void for a while."""
    near, far = film_force(E, REST, memory=FilmMemory(1e-4), **FED), None
    memory = near.memory
    for k in range(1, 6):
        far = film_force(E * (1 - 0.1 * k), -E * 0.1 / 1e-4, memory=memory, fields=True, **FED)
        memory = far.memory
    assert far.fill.min() < 0.8
    assert film_force(E / 2, REST, memory=FilmMemory(1e-4), fields=True, **FED).fill.min() > 0.95


def test_memory_of_a_batch():
    batch = film_force([E, E / 2], [REST, REST], memory=FilmMemory(1e-3), **FED)
    again = film_force([E, E / 2], [REST, REST], memory=batch.memory, **FED)
    one = film_force(E / 2, REST, memory=FilmMemory(1e-3), **FED)
    two = film_force(E / 2, REST, memory=one.memory, **FED)
    np.testing.assert_array_equal(again.force_N[1], two.force_N)


def test_a_step_longer_than_the_gap_is_refused():
    with pytest.raises(FilmError, match="too long for this velocity"):
        film_force(E, E / 1e-4, memory=FilmMemory(1e-3), **FED)


def test_equilibrium_of_the_conserving_film():
    state = equilibrium(load_N=100.0, **FED)
    assert state.film.force_N == pytest.approx((0.0, 100.0), abs=1e-5)
    assert 0 < state.attitude_rad < np.pi / 2
    assert np.all(np.diag(state.damping) > 0)


@pytest.mark.parametrize(
    ("change", "memory", "message"),
    [
        ({"feed": []}, None, "runs dry"),
        ({"rupture": "reynolds"}, FilmMemory(1e-3), "only the film with rupture = 'jfo'"),
        ({}, FilmMemory(0.0), "dt_s"),
        ({}, FilmMemory(1e-3, np.ones((5, 5))), "belongs to another grid"),
    ],
)
def test_unusable_memory_is_refused(change, memory, message):
    with pytest.raises(FilmError, match=message):
        film_force(E, REST, memory=memory, **(FED | change))
