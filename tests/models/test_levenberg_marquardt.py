"""Levenberg-Marquardt against SciPy's lm, and on the network of equation (5)."""

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares

from models.learning.levenberg_marquardt import LmOptions, levenberg_marquardt
from models.learning.network import Mlp
from models.learning.squares import NetworkSquares, Squares, jacobian


def rosenbrock(theta):
    x, y = theta
    return np.array([10 * (y - x**2), 1 - x]), np.array([[-20 * x, 10.0], [-1.0, 0.0]])


def powell_badly_scaled(theta):
    x, y = theta
    r = np.array([1e4 * x * y - 1, np.exp(-x) + np.exp(-y) - 1.0001])
    return r, np.array([[1e4 * y, 1e4 * x], [-np.exp(-x), -np.exp(-y)]])


@pytest.mark.parametrize(
    ("problem", "start"), [(rosenbrock, [-1.2, 1.0]), (powell_badly_scaled, [0.0, 1.0])]
)
def test_same_minimum_as_scipy(problem, start):
    ours = levenberg_marquardt(
        lambda t: Squares.of(*problem(t)), np.array(start), options=LmOptions(iterations=500)
    )
    oracle = least_squares(
        lambda t: problem(t)[0], start, jac=lambda t: problem(t)[1], method="lm", xtol=1e-15
    )
    np.testing.assert_allclose(ours.theta, oracle.x, rtol=1e-6)


def test_network_fit_reaches_scipys_cost():
    rng = np.random.default_rng(1)
    net = Mlp((2, 4, 1))
    x = rng.uniform(-1, 1, (80, 2))
    y = np.sin(2 * x[:, :1]) * x[:, 1:] + 0.01 * rng.normal(size=(80, 1))

    def slope(theta):
        return jacobian(net, torch.from_numpy(theta), torch.from_numpy(x))[1].numpy()[:, 0]

    start = net.initial(rng)
    squares = NetworkSquares(net, x, y, np.ones_like(y), None)
    ours = levenberg_marquardt(squares, start, options=LmOptions(iterations=2000))
    oracle = least_squares(lambda t: (net.outputs(t, x) - y)[:, 0], start, jac=slope, method="lm")
    assert ours.cost <= oracle.cost * 1.02


def test_l2_matches_the_closed_form_of_ridge_regression():
    rng = np.random.default_rng(2)
    a, b, l2 = rng.normal(size=(30, 3)), rng.normal(size=30), 0.7
    penalised = np.array([False, True, True])
    ours = levenberg_marquardt(
        lambda t: Squares.of(a @ t - b, a), np.zeros(3), l2=l2, penalised=penalised
    )
    exact = np.linalg.solve(a.T @ a + l2 * np.diag(penalised.astype(float)), a.T @ b)
    np.testing.assert_allclose(ours.theta, exact, rtol=1e-8)


def test_returns_the_best_point_by_the_monitor():
    start = np.array([-1.2, 1.0])
    result = levenberg_marquardt(
        lambda t: Squares.of(*rosenbrock(t)), start, monitor=lambda t: abs(t[0] + 1.0)
    )
    assert min(result.scores) == result.score
    assert result.scores[0] == pytest.approx(0.2)
    assert abs(result.theta[0] + 1.0) == result.score < 0.2


def test_refuses_a_start_that_is_not_finite():
    with pytest.raises(ValueError, match="not finite"):
        levenberg_marquardt(lambda t: Squares.of(np.array([np.nan]), np.ones((1, 1))), np.zeros(1))
