"""Search of weights: lambda and start by validation, mirror symmetry by construction, and solutions
kept."""

from dataclasses import dataclass

import numpy as np
import pytest

from models.film.cache import kept
from models.film.fit import DataError, Search, Targets, fit
from models.learning.network import Mlp
from models.learning.squares import Squares

SIGNS = (np.array([1.0, -1.0]), np.array([1.0, -1.0]))


def targets(mirror=None):
    x = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    y = np.column_stack([x[:, 0] + x[:, 1] ** 2, x[:, 0] * x[:, 1]])
    return Targets(x, y, np.ones_like(y), mirror)


def search(folder, rows):
    plan = Search((1e-8, 1.0), 2, 60)
    return fit(
        Mlp((2, 6, 2)), targets(), plan, np.random.default_rng(1), "toy", folder, rows.append
    )


def test_the_best_start_by_validation_is_returned_and_every_start_is_listed(tmp_path):
    rows = []
    result = search(tmp_path, rows)
    assert rows == result.starts
    assert [(row["lambda"], row["start"]) for row in rows] == [
        (1e-8, 1),
        (1e-8, 2),
        (1.0, 1),
        (1.0, 2),
    ]
    assert result.l2 == 1e-8
    assert float(f"{result.score:.4g}") == min(row["validation"] for row in rows)
    assert result.score < 0.05


def test_an_interrupted_search_goes_on_and_ends_the_same(tmp_path):
    class Interrupted(Exception):
        pass

    def stop(row):
        if row["start"] == 2:
            raise Interrupted

    with pytest.raises(Interrupted):
        search(tmp_path, type("Log", (), {"append": staticmethod(stop)}))
    done = sorted(tmp_path.iterdir())
    before = [path.stat().st_mtime_ns for path in done]
    again, rows = search(tmp_path, []), []
    assert len(done) == 2
    assert [path.stat().st_mtime_ns for path in done] == before
    whole = search(tmp_path / "another", rows)
    np.testing.assert_array_equal(again.theta, whole.theta)
    assert again.starts == rows


def test_too_few_points_and_points_that_are_not_finite_are_refused(tmp_path):
    data, net, plan = targets(), Mlp((2, 6, 2)), Search((1e-8,), 1, 5)
    with pytest.raises(DataError, match=r"toy: 4 points, at least 5"):
        fit(net, data.subset(np.arange(200) < 4), plan, np.random.default_rng(1), "toy", tmp_path)
    data.y[7, 1] = np.nan
    with pytest.raises(
        DataError, match=r"toy: 1 points are not finite, the first is point 7 at .*solve them again"
    ):
        fit(net, data, plan, np.random.default_rng(1), "toy", tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_mirror_makes_the_fit_odd_and_even_exactly():
    net, data = Mlp((2, 6, 2)), targets(SIGNS)
    theta = net.initial(np.random.default_rng(2))
    flipped = Targets(SIGNS[0] * data.x, SIGNS[1] * data.y, data.weight, SIGNS)
    np.testing.assert_allclose(
        flipped.error(net, theta), SIGNS[1] * data.error(net, theta), rtol=1e-12, atol=1e-15
    )


def test_the_squares_of_a_mirrored_net_are_those_of_its_errors():
    """In two parts, the second not full."""
    net, some = Mlp((2, 3, 2)), targets()
    x, y = np.tile(some.x, (6, 1)), np.tile(some.y, (6, 1))
    data = Targets(x, y, np.random.default_rng(4).uniform(0.5, 2.0, y.shape), SIGNS)
    theta = net.initial(np.random.default_rng(3))
    steps = 1e-6 * np.eye(net.count)
    slopes = np.array(
        [(data.error(net, theta + s) - data.error(net, theta - s)).ravel() / 2e-6 for s in steps]
    ).T
    expected, found = Squares.of(data.error(net, theta).ravel(), slopes), data.squares(net)(theta)
    assert found.cost == pytest.approx(expected.cost, rel=1e-12)
    np.testing.assert_allclose(found.gradient, expected.gradient, atol=1e-5)
    np.testing.assert_allclose(found.normal, expected.normal, atol=1e-5)


@dataclass(frozen=True)
class Numbers:
    values: np.ndarray


def test_solutions_are_made_once_for_each_key(tmp_path):
    made = []

    def make():
        made.append(1)
        return Numbers(np.arange(3.0))

    for key in (1, 1, 2):
        np.testing.assert_array_equal(
            kept(tmp_path, "numbers", key, Numbers, make).values, [0.0, 1.0, 2.0]
        )
    assert len(made) == 2
