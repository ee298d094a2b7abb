"""The film network as a graph: symmetry, dissipation, parity of the file, and the shipped artifact's accuracy."""

import json

import numpy as np
import pytest

from models import ARTIFACTS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def module():
    from models.film_network import ReducedFilm
    from models.network import Mlp

    net = Mlp((2, 5, 3))
    return ReducedFilm(net.layers(0.3 * net.initial(np.random.default_rng(5))))


def film(module, state):
    from models.surrogate import of_module

    return of_module(module)(state)


def states(count=10_000):
    from models.surrogate import SurrogateSettings, random_states

    return random_states(count, SurrogateSettings(), 3)


def test_force_turns_with_the_frame(module):
    state, angle = states(500), 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = state.copy()
    turned[:, :2], turned[:, 2:4] = state[:, :2] @ turn.T, state[:, 2:4] @ turn.T
    for before, after in zip(film(module, state)[1:], film(module, turned)[1:], strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-18)
    force = film(module, state)[0]
    np.testing.assert_allclose(film(module, turned)[0], force @ turn.T, rtol=1e-9, atol=1e-9 * np.abs(force).max())


def test_force_is_mirrored_with_the_frame(module):
    state = states(500)
    mirrored = state * np.array([1, -1, 1, -1, -1, 1, 1, 1, 1])
    force, torque, flow = film(module, state)
    force_m, torque_m, flow_m = film(module, mirrored)
    np.testing.assert_allclose(force_m, force * [1, -1], rtol=1e-12)
    moving = state[:, 4] != 0.0
    np.testing.assert_allclose(torque_m[moving], torque[moving], rtol=1e-12)
    np.testing.assert_allclose(flow_m, flow, rtol=1e-12)


def test_force_opposes_the_squeeze_velocity_everywhere(module):
    state = states()
    force = film(module, state)[0]
    inside = np.hypot(state[:, 0], state[:, 1]) < 0.98 * state[:, 5]
    squeeze = state[:, 2:4] + 0.5 * state[:, 4:5] * np.column_stack([state[:, 1], -state[:, 0]])
    assert np.all(np.sum(force * squeeze, axis=1)[inside] <= 0.0)


def test_no_force_in_pure_whirl_at_half_speed(module):
    state = np.array([[3e-5, 0.0, 0.0, 0.5 * 400.0 * 3e-5, 400.0, 6e-5, 0.01, 0.02, 0.02]])
    assert np.all(np.abs(film(module, state)[0]) < 1e-9)


def test_one_file_answers_like_the_module_and_is_always_finite(module, tmp_path):
    import torch

    from models import export
    from models.film_network import STATE

    metadata = export.Metadata(
        kind="surrogate", version="0", inputs=STATE, outputs=("force", "friction_torque", "side_flow"), domain={},
        rigs=(), data_hash="", metrics={}, units=(),
    )  # fmt: skip
    path = tmp_path / "surrogate.onnx"
    example = torch.from_numpy(states(2))
    export.export(module, example, path, input_name="state", output_names=metadata.outputs, metadata=metadata)
    assert [p.name for p in tmp_path.iterdir()] == ["surrogate.onnx"]
    assert export.parity(module, path, states()) <= 1e-6
    assert all(np.isfinite(answer).all() for answer in export.session(path).run(None, {"state": states()}))


def test_shipped_surrogate_answers_like_the_film():
    from models.film_data import draw_points, solve_points
    from models.surrogate import judge, of_file

    points = draw_points(40, 0.95, np.random.default_rng(11))
    judged = solve_points(points, length_over_diameter=0.5, grid=(240, 48))
    scores = judge(of_file(ARTIFACTS / "surrogate.onnx"), judged, 0.5)
    assert scores["force_relative_rms_percent"] < 0.1
    assert scores["side_flow_relative_rms_percent"] < 0.1
    report = json.loads((ARTIFACTS / "surrogate.json").read_text())
    assert report["reduced_network"]["force_relative_rms_percent"] < 0.1
