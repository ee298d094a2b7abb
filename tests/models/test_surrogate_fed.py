"""The fed film network: symmetry, the unfed film far from any supply, the file, and the fed film
that judges it."""

import numpy as np
import pytest

from models.film.fed_data import draw_fed, fed_film, solve_fed

SHAPE, ECCENTRICITY_MAX = 0.5, 0.97


@pytest.fixture(scope="module")
def unfed():
    from models import ARTIFACTS
    from models.film.reduced_network import ReducedFilm, layers_of_file

    return ReducedFilm(layers_of_file(ARTIFACTS / "surrogate.onnx"), SHAPE, ECCENTRICITY_MAX)


@pytest.fixture(scope="module")
def film(unfed):
    from models.film.fed_network import INPUT_SIGNS, OUTPUT_SIGNS, FedFilm
    from models.film.judge import of_module
    from models.learning.network import Mlp

    net = Mlp((len(INPUT_SIGNS), 5, len(OUTPUT_SIGNS)))
    return of_module(FedFilm(net.layers(net.initial(np.random.default_rng(1))), unfed))


def states(count=200):
    from models.film.fed_judge import draw_fed_states

    return draw_fed_states(count, SHAPE, np.random.default_rng(2))


def turned(state, angle):
    c, s = np.cos(angle), np.sin(angle)
    changed = state.copy()
    for k in (0, 2):
        changed[:, k], changed[:, k + 1] = (
            c * state[:, k] - s * state[:, k + 1],
            s * state[:, k] + c * state[:, k + 1],
        )
    changed[:, 10] += angle
    return changed, np.array([[c, s], [-s, c]])


def test_any_weights_give_rotation_with_the_groove_mirror_and_homogeneity(film):
    state = states()
    force = film(state)[0]
    size = np.abs(force).max(axis=1, keepdims=True)
    rotated, turn = turned(state, 0.7)
    assert np.all(np.abs(film(rotated)[0] - force @ turn) < 1e-9 * size)
    mirrored = state * np.array([1, -1, 1, -1, -1, 1, 1, 1, 1, 1, -1])
    assert np.all(np.abs(film(mirrored)[0] - force * [1, -1]) < 1e-9 * size)
    faster = state * np.array([1, 1, 3, 3, 3, 1, 1, 1, 1, 3, 1])
    assert np.all(np.abs(film(faster)[0] - 3 * force) < 1e-9 * size)
    thicker = state * np.array([1, 1, 1, 1, 1, 1, 7, 1, 1, 7, 1])
    assert np.all(np.abs(film(thicker)[0] - 7 * force) < 1e-9 * size)


def test_domain_ends_at_the_eccentricity_and_below_ambient_supply(film):
    state = states(20)
    assert np.all(film(state)[3] == 1.0)
    assert np.all(film(state * np.array([1] * 9 + [-1, 1]))[3] == 0.0)
    deep = state.copy()
    deep[:, 0], deep[:, 1] = 0.98 * deep[:, 5], 0.0
    assert np.all(film(deep)[3] == 0.0)


def test_reduced_points_are_the_film_of_any_bearing():
    state = states(3)[1]
    c, mu, radius, length, supply, groove = state[5:]
    squeeze = state[2:4] + 0.5 * state[4] * np.array([state[1], -state[0]])
    rate, feed = np.hypot(*squeeze) / c, supply * c**2 / (mu * radius**2)
    back = np.array([[np.cos(groove), np.sin(groove)], [-np.sin(groove), np.cos(groove)]])
    point = np.concatenate([back @ state[:2] / c, back @ squeeze / c / (rate + feed)])
    reduced = solve_fed(point[None], length_over_diameter=SHAPE, grid=(96, 16))
    film = fed_film(state, (96, 16))
    expected = film.force_N @ back.T / (mu * radius * length**3 / c**2 * (rate + feed))
    np.testing.assert_allclose(reduced.force[0], expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        reduced.side_flow[0],
        film.side_flow_m3_s / (2 * radius * length * c * (rate + feed)),
        rtol=1e-6,
    )


def test_a_table_answers_like_the_film_and_a_thinned_one_worse():
    from models.film import fed_table

    state = states(3)
    state[:, :2] *= 0.5
    films = [fed_film(row, (120, 24)) for row in state]
    force, flow = (
        np.array([film.force_N for film in films]),
        np.array([film.side_flow_m3_s for film in films]),
    )
    errors = []
    tables = fed_table.tables(SHAPE)
    for table in (tables["shipped"], tables["smallest"]):
        answer = fed_table.model(table)(state)
        errors.append(
            [
                np.abs(answer[0] - force).max() / np.abs(force).max(),
                np.abs(answer[2][:, 0] / flow - 1).max(),
            ]
        )
    assert max(errors[0]) < 0.05
    assert np.all(np.array(errors[1]) > 3 * np.array(errors[0]))


def test_drawn_points_fill_one_side_of_the_groove():
    points = draw_fed(500, ECCENTRICITY_MAX, np.random.default_rng(3))
    assert np.all(points[:, 1] >= 0.0)
    assert np.hypot(*points[:, :2].T).max() < ECCENTRICITY_MAX
    assert np.hypot(*points[:, 2:].T).max() <= 1.0
    share = 1.0 - np.hypot(*points[1::2, 2:].T)
    assert share.min() < 0.05 < 0.9 < share.max()  # turning journals, hardly fed to strongly fed


@pytest.mark.slow
def test_smoke_training_makes_a_whole_run(tmp_path):
    from models.film.surrogate_fed import SETTINGS, train
    from models.runs import TrainingRun

    settings = SETTINGS().smoked()
    run = TrainingRun(tmp_path, "surrogate_fed", 0, settings, smoke=True)
    report = train(run, settings)
    assert report["export_parity"] <= 1e-6
    assert {p.name for p in run.folder.iterdir()} >= {
        "surrogate_fed.onnx",
        "surrogate_fed.json",
        "surrogate_fed.md",
    }
