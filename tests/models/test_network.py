"""Derivatives of the network against finite differences."""

import numpy as np
import torch

from models.learning.network import Mlp
from models.learning.squares import jacobian

NET = Mlp((3, 5, 4, 2))


def central_difference(theta, x, i, step=1e-6):
    shift = step * np.eye(theta.size)[i]
    return (NET.outputs(theta + shift, x) - NET.outputs(theta - shift, x)) / (2 * step)


def test_jacobian_and_gradient_are_the_derivatives():
    rng = np.random.default_rng(0)
    theta, x, slope = NET.initial(rng), rng.normal(size=(7, 3)), rng.normal(size=(7, 2))
    numeric = np.stack([central_difference(theta, x, i) for i in range(theta.size)], axis=2)
    outputs, slopes = (
        tensor.numpy() for tensor in jacobian(NET, torch.from_numpy(theta), torch.from_numpy(x))
    )
    np.testing.assert_allclose(outputs, NET.outputs(theta, x), rtol=1e-12)
    np.testing.assert_allclose(slopes, numeric, atol=1e-8)
    np.testing.assert_allclose(
        NET.gradient(theta, x, slope), np.einsum("mk,mkp->p", slope, slopes), atol=1e-12
    )


def test_biases_are_not_penalised():
    mask = NET.is_weight()
    assert mask.size == NET.count
    assert (~mask).sum() == 5 + 4 + 2
    assert not mask[:5].any()
    assert mask[5:20].all()
    assert not mask[20:24].any()
