"""Scaled conjugate gradient against L-BFGS."""

import numpy as np
import pytest
from scipy.optimize import minimize, rosen, rosen_der

from models.learning.network import Mlp, sigmoid
from models.learning.scaled_conjugate_gradient import scaled_conjugate_gradient


def logistic_problem():
    rng = np.random.default_rng(3)
    net, x = Mlp((4, 6, 1)), rng.normal(size=(200, 4))
    y = (x[:, :1] * x[:, 1:2] + 0.3 * rng.normal(size=(200, 1)) > 0).astype(float)

    def cost(theta):
        z = net.outputs(theta, x)
        value = np.logaddexp(0.0, z) - y * z
        return float(value.mean() + 5e-3 * theta @ theta), net.gradient(
            theta, x, (sigmoid(z) - y) / 200
        ) + 1e-2 * theta

    return cost, net.initial(rng)


def test_reaches_the_minimum_of_l_bfgs_on_a_classifier():
    cost, start = logistic_problem()
    ours = scaled_conjugate_gradient(cost, start, iterations=3000, gradient_tolerance=1e-8)
    oracle = minimize(
        cost, start, jac=True, method="L-BFGS-B", options={"maxiter": 5000, "ftol": 1e-15}
    )
    assert ours.cost <= oracle.fun + 1e-4
    assert ours.reason == "gradient"


def test_rosenbrock_in_ten_dimensions():
    result = scaled_conjugate_gradient(
        lambda t: (float(rosen(t)), rosen_der(t)), np.zeros(10), iterations=5000
    )
    np.testing.assert_allclose(result.theta, np.ones(10), atol=1e-4)


def test_quadratic_takes_about_one_step_a_dimension():
    a = np.diag(np.arange(1.0, 11.0))
    result = scaled_conjugate_gradient(lambda t: (float(0.5 * t @ a @ t), a @ t), np.ones(10))
    assert result.iterations < 25
    assert result.cost < 1e-12


def test_monitor_keeps_its_best_point_and_stops_by_patience():
    result = scaled_conjugate_gradient(
        lambda t: (float(t @ t), 2 * t),
        np.array([3.0, 1.0]),
        monitor=lambda t: -float(t @ t),
        patience=1,
    )
    assert result.reason == "patience"
    assert result.score == -10.0


def test_refuses_a_start_that_is_not_finite():
    with pytest.raises(ValueError, match="not finite"):
        scaled_conjugate_gradient(lambda t: (float("nan"), t), np.zeros(1))
