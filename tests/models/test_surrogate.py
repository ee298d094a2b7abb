"""The film network as a graph: symmetry, dissipation, domain, parity of the file, and the shipped
artifact's bars."""

import json

import numpy as np
import pytest

from models import ARTIFACTS
from models.film.judge import dissipation, symmetry
from models.film.states import draw_states, solve_states, squeeze_velocity

SHAPE, ECCENTRICITY_MAX = 0.5, 0.97


@pytest.fixture(scope="module")
def net():
    from models.learning.network import Mlp

    return Mlp((2, 5, 3))


@pytest.fixture(scope="module")
def theta(net):
    return 0.3 * net.initial(np.random.default_rng(5))


@pytest.fixture(scope="module")
def module(net, theta):
    from models.film.reduced_network import ReducedFilm

    return ReducedFilm(net.layers(theta), SHAPE, ECCENTRICITY_MAX)


@pytest.fixture(scope="module")
def film(module):
    from models.film.judge import of_module

    return of_module(module)


def states(count=10_000):
    from models.film.surrogate import SurrogateSettings, random_states

    return random_states(count, SurrogateSettings(), 3)


def test_any_weights_give_rotation_mirror_and_homogeneity(film):
    assert all(bar.passed for bar in symmetry(film, SHAPE, np.random.default_rng(0), 500))


def test_symmetry_bars_see_a_film_that_lacks_it(film):
    def skew(state):
        force, *rest = film(state)
        return [force + 1e-6 * np.abs(force), *rest]

    rows = {
        bar.name.split("_")[0]: bar.passed
        for bar in symmetry(skew, SHAPE, np.random.default_rng(0), 500)
    }
    assert rows == {"rotation": False, "mirror": False, "homogeneity": True}


def test_any_weights_dissipate_everywhere_and_know_their_domain(film):
    driven, mistaken = dissipation(film, SHAPE, ECCENTRICITY_MAX, np.random.default_rng(0), 20_000)
    assert driven.passed
    assert mistaken.passed
    assert not dissipation(film, SHAPE, 0.5, np.random.default_rng(0), 20_000)[1].passed


def test_force_opposes_the_squeeze_velocity_outside_the_clearance_too(film):
    state = states()
    assert np.all(np.sum(film(state)[0] * squeeze_velocity(state), axis=1) <= 0.0)


def test_a_bearing_of_another_shape_lies_outside(film):
    state = draw_states(20, SHAPE, np.random.default_rng(1))
    assert np.all(film(state)[3] == 1.0)
    assert np.all(film(state * np.array([1, 1, 1, 1, 1, 1, 1, 1, 2]))[3] == 0.0)


def test_no_force_in_pure_whirl_at_half_speed(film):
    state = np.array([[3e-5, 0.0, 0.0, 0.5 * 400.0 * 3e-5, 400.0, 6e-5, 0.01, 0.02, 0.02]])
    assert np.all(np.abs(film(state)[0]) < 1e-9)


def test_the_compiled_law_is_the_graph(film, net, theta):
    from sim_hil.film.table_kernel import contact_force
    from sim_hil.rotor.film_law import film_law
    from sim_hil.rotor.network_law import ReducedNetworkLaw

    law = ReducedNetworkLaw.make(theta, net.sizes)
    state = draw_states(50, SHAPE, np.random.default_rng(2))
    force, torque, flow, _ = film(state)
    for k, row in enumerate(state):
        assert contact_force(*row[[0, 1, 4, 5]])[2] == 0.0
        answer = film_law(law, *row, 0.0)
        np.testing.assert_allclose(answer, [*force[k], torque[k, 0], flow[k, 0]], rtol=1e-9)


def test_one_file_answers_like_the_module_and_is_always_finite(module, tmp_path):
    import torch

    from models import export
    from models.film.reduced_network import layers_of_file
    from models.film.states import STATE

    metadata = export.Metadata(
        kind="surrogate",
        version="0",
        inputs=STATE,
        outputs=("force", "friction_torque", "side_flow", "inside"),
        domain={},
        rigs=(),
        data_hash="",
        metrics={},
        units=(),
    )
    path = tmp_path / "surrogate.onnx"
    example = torch.from_numpy(states(2))
    export.export(
        module, example, path, input_name="state", output_names=metadata.outputs, metadata=metadata
    )
    assert [p.name for p in tmp_path.iterdir()] == ["surrogate.onnx"]
    assert export.parity(module, path, states()) <= 1e-6
    assert all(
        np.isfinite(answer).all() for answer in export.session(path).run(None, {"state": states()})
    )
    for stored, linear in zip(layers_of_file(path), module.net.layers, strict=True):
        np.testing.assert_array_equal(stored[1:].T, linear.weight.detach().numpy())


def test_judged_states_scale_back_to_the_two_numbers():
    state = draw_states(40, SHAPE, np.random.default_rng(4))
    assert np.all(state[::8, 4] == 0.0)
    judged = solve_states(state[:2], (48, 8))
    np.testing.assert_allclose(np.hypot(*judged.ab.T), np.hypot(*state[:2, :2].T) / state[:2, 5])
    turned = squeeze_velocity(state[:2])
    np.testing.assert_allclose(
        judged.ab[:, 0],
        np.sum(state[:2, :2] * turned, axis=1) / (state[:2, 5] * np.hypot(*turned.T)),
    )


def test_shipped_surrogate_passes_every_bar():
    report = json.loads((ARTIFACTS / "surrogate.json").read_text())
    assert report["all_passed"]
    assert all(bar["pass"] for bar in report["bars"])
    assert report["export_parity"] <= 1e-6


@pytest.mark.slow
def test_shipped_surrogate_keeps_its_bars_on_films_of_today():
    from models.film.judge import of_file
    from models.film.surrogate import SurrogateSettings, judge, law_of

    path = ARTIFACTS / "surrogate.onnx"
    judged = solve_states(draw_states(40, SHAPE, np.random.default_rng(11)), (240, 48))
    settings = SurrogateSettings(dissipation_points=20_000)
    verdict = judge(of_file(path), law_of(path), judged, settings, 3)
    assert verdict["all_passed"], verdict["bars"]
