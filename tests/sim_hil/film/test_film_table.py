"""The tabulated film against the film itself."""

import math

import numpy as np
import pytest

from sim_hil.film import FilmError, film_force
from sim_hil.film.table import FilmTable, table_force
from sim_hil.film.table_kernel import CONTACT_STIFFNESS_N_M, EPS_TABLE, table_slopes
from sim_hil.jit import kernel

C, MU, R, L = 60e-6, 0.01, 0.02, 0.02
GRIDS = ((112, 14), (224, 28))
BEARING = {"radius_m": R, "length_m": L, "clearance_m": C, "viscosity_Pa_s": MU}


@pytest.fixture(scope="module")
def coefficients():
    return FilmTable.load(0.5).coefficients


def states(count, seed=3):
    """Random journal states to eccentricity 0.95; every fourth a pure squeeze, in or out."""
    rng = np.random.default_rng(seed)
    eps, angle, whirl = rng.uniform(0, 0.95, count), *rng.uniform(-np.pi, np.pi, (2, count))
    speed = rng.uniform(-600, 600, count)
    velocity = rng.uniform(0, 0.25, count) * C * 600 * np.array([np.cos(whirl), np.sin(whirl)])
    squeeze = np.arange(count) % 4 == 0
    radial = rng.choice([-1, 1], count) * 1e-3 * np.array([np.cos(angle), np.sin(angle)])
    speed[squeeze], velocity[:, squeeze] = 0.0, radial[:, squeeze]
    return C * eps * np.array([np.cos(angle), np.sin(angle)]), velocity, speed


def converged(position, velocity, speed, name):
    coarse, fine = (
        getattr(film_force(position, velocity, speed_rad_s=speed, grid=g, **BEARING), name)
        for g in ((112, 14), (224, 28))
    )
    return (4 * fine - coarse) / 3


def test_force_and_flow_follow_the_converged_film(coefficients):
    errors, flow_errors = [], []
    for e, v, w in zip(*(a.T for a in states(60)), strict=True):
        fx, fy, _, flow = table_force(coefficients, *e, *v, w, C, MU, R, L)
        truth = converged(e, v, w, "force_N")
        errors.append(math.hypot(fx - truth[0], fy - truth[1]) / np.hypot(*truth))
        flow_errors.append(flow / converged(e, v, w, "side_flow_m3_s") - 1)
    assert np.sqrt(np.mean(np.square(errors))) <= 5e-4
    assert max(errors) <= 2e-3
    assert np.max(np.abs(flow_errors)) <= 1e-3


def test_friction_torque_follows_the_film(coefficients):
    for e, v, w in zip(*(a.T for a in states(12, seed=5)), strict=True):
        torque = table_force(coefficients, *e, *v, w, C, MU, R, L)[2]
        assert torque == pytest.approx(
            film_force(e, v, speed_rad_s=w, **BEARING).friction_torque_N_m, rel=5e-3, abs=1e-8
        )


@pytest.mark.parametrize("rate", [-0.05, 0.05])
def test_clearance_rate_is_followed_to_first_order(coefficients, rate):
    position, velocity = (0.7 * C, 0.1 * C), (0.0, 0.0)
    squeeze = 150.0 * math.hypot(*position)
    table = table_force(coefficients, *position, *velocity, 300.0, C, MU, R, L, rate * squeeze)
    film = film_force(
        position, velocity, speed_rad_s=300.0, clearance_rate_m_s=rate * squeeze, **BEARING
    )
    still = film_force(position, velocity, speed_rad_s=300.0, **BEARING)
    effect = np.hypot(*(film.force_N - still.force_N))
    assert np.hypot(*(film.force_N - table[:2])) <= 0.1 * effect


def test_force_opposes_the_effective_squeeze_velocity(coefficients):
    for e, v, w in zip(*(a.T for a in states(5000, seed=7)), strict=True):
        fx, fy, _, _ = table_force(coefficients, *e, *v, w, C, MU, R, L)
        assert fx * (v[0] + w / 2 * e[1]) + fy * (v[1] - w / 2 * e[0]) <= 0


def test_mirror_symmetry_is_exact(coefficients):
    right = table_force(coefficients, 2e-5, 1e-5, 1e-3, 5e-4, 300.0, C, MU, R, L)
    left = table_force(coefficients, -2e-5, 1e-5, -1e-3, 5e-4, -300.0, C, MU, R, L)
    assert left == pytest.approx((-right[0], *right[1:]), rel=1e-12)


def test_still_journal_in_still_oil_feels_nothing(coefficients):
    assert table_force(coefficients, 0.0, 0.0, 0.0, 0.0, 0.0, C, MU, R, L) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("at", range(5))
def test_what_is_no_number_gives_none(coefficients, at):
    state = [1e-5, 2e-5, 1e-3, 0.0, 300.0]
    state[at] = np.nan
    assert np.isnan(table_force(coefficients, *state, C, MU, R, L)[:2]).all()


@pytest.mark.parametrize("excess", [1e-9, 1e-6, 1e-3])
def test_past_the_table_asperities_push_back_and_stay_finite(coefficients, excess):
    e = EPS_TABLE * C + excess
    result = table_force(coefficients, e, 0.0, 0.0, 0.0, 0.0, C, MU, R, L)
    assert np.all(np.isfinite(result))
    assert result[0] == pytest.approx(-CONTACT_STIFFNESS_N_M * excess, rel=1e-6)


def test_contact_rub_brakes_both_ways(coefficients):
    e = EPS_TABLE * C + 1e-6
    _, fy, torque, _ = table_force(coefficients, e, 0.0, 0.0, 0.0, 1e-9, C, MU, R, L)
    _, fy_back, torque_back, _ = table_force(coefficients, e, 0.0, 0.0, 0.0, -1e-9, C, MU, R, L)
    assert torque > 0
    assert torque_back == pytest.approx(torque)
    assert fy < 0  # the journal surface at the contact moves along +y
    assert fy_back == pytest.approx(-fy)


@pytest.mark.parametrize("shape", [0.09, 2.1, float("nan")])
def test_a_shape_that_no_machine_has_is_refused(shape):
    with pytest.raises(FilmError, match=r"films are tabulated from 0\.1 to 2"):
        FilmTable.load(shape)


@pytest.mark.parametrize("shape", [0.115, 0.3, 0.85, 1.7])
def test_a_shape_between_the_shipped_ones_follows_the_film(shape):
    table = FilmTable.load(shape)
    bearing = BEARING | {"length_m": 2 * R * shape}
    errors, flows = [], []
    for e, v, w in zip(*(a.T for a in states(8, seed=11)), strict=True):
        fx, fy, _, flow = table_force(table.coefficients, *e, *v, w, C, MU, R, 2 * R * shape)
        coarse, fine = (film_force(e, v, speed_rad_s=w, grid=g, **bearing) for g in GRIDS)
        truth = (4 * fine.force_N - coarse.force_N) / 3
        errors.append(math.hypot(fx - truth[0], fy - truth[1]) / np.hypot(*truth))
        flows.append(flow * 3 / (4 * fine.side_flow_m3_s - coarse.side_flow_m3_s) - 1)
    assert max(errors) <= 2e-3
    assert np.max(np.abs(flows)) <= 2e-3


def test_saved_table_is_the_built_one(tmp_path, monkeypatch):
    built = FilmTable.build(1.0, cells=(6, 8), grid=(16, 6))
    assert built.save(tmp_path).name == "table_ld1.npz"
    monkeypatch.setattr("sim_hil.film.table._DATA", tmp_path)
    np.testing.assert_array_equal(FilmTable.load(1.0).coefficients, built.coefficients)


@kernel
def known_slopes(
    table: np.ndarray, e: np.ndarray, v: np.ndarray, omega: float, rate: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return table_slopes(table, e[0], e[1], v[0], v[1], omega, C, MU, R, L, rate)


@pytest.mark.parametrize("omega", [600.0, -600.0, 0.0])
def test_the_table_knows_its_slopes(coefficients, omega):
    """Against central differences, at random eccentricities and squeezes."""
    rng = np.random.default_rng(11)
    for eps, at, to in rng.uniform([0.01, -np.pi, -np.pi], [0.98, np.pi, np.pi], (50, 3)):
        e = eps * C * np.array([np.cos(at), np.sin(at)])
        v = 0.2 * C * 600.0 * np.array([np.cos(to), np.sin(to)])
        force, slopes = known_slopes(coefficients, e, v, omega, 0.0)
        assert force == pytest.approx(table_force(coefficients, *e, *v, omega, C, MU, R, L))
        de, dv = 1e-6 * (C - np.hypot(*e)), 1e-6 * C * 600.0
        columns = []
        for which, step in ((0, de), (1, de), (2, dv), (3, dv)):
            ends = []
            for sign in (1, -1):
                state = np.concatenate([e, v])
                state[which] += sign * step
                ends.append(table_force(coefficients, *state, omega, C, MU, R, L)[:2])
            columns.append((np.array(ends[0]) - ends[1]) / (2 * step))
        for found, wanted in (
            (slopes[:4], np.array(columns[:2]).T),
            (slopes[4:], np.array(columns[2:]).T),
        ):
            np.testing.assert_allclose(
                np.reshape(found, (2, 2)), wanted, atol=1e-4 * np.abs(wanted).max()
            )


@pytest.mark.parametrize("rate", [0.01, 0.3, 5.0])
def test_slopes_and_force_agree_on_a_moving_clearance(coefficients, rate):
    e, v = np.array([2e-5, 1e-5]), np.array([1e-3, 5e-4])
    force, _ = known_slopes(coefficients, e, v, 300.0, rate * 1e-3)
    assert force == pytest.approx(
        table_force(coefficients, *e, *v, 300.0, C, MU, R, L, rate * 1e-3)
    )
