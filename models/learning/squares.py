"""Sums of squares as Levenberg-Marquardt wants them: cost, gradient and Gauss-Newton matrix, never
a whole Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from models.learning.device import device
from models.learning.network import Mlp

Floats = NDArray[np.float64]

_ROWS = 256
"""Samples at a time: of 1024 the fed film's Jacobian is 25 MB and a pass takes a fifth longer, of
64 as well."""


@dataclass(frozen=True)
class Squares:
    """``1/2 sum r**2``, its gradient ``J^T r`` ``(p,)``, and ``J^T J`` ``(p, p)``."""

    cost: float
    gradient: Floats
    normal: Floats

    @classmethod
    def of(cls, r: Floats, jacobian: Floats) -> Squares:
        """From residuals ``(n,)`` and their derivatives ``(n, p)``."""
        return cls(0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian)


class NetworkSquares:
    """Weighted squares of a network's errors on its samples, as a function of its weights.

    Parameters
    ----------
    x, y, weight
        Inputs ``(m, n)``, targets and their weights ``(m, k)``.
    mirror
        Signs of the inputs and of the outputs: the prediction is the mean of the network and of its
        mirror image.
    """

    def __init__(
        self, net: Mlp, x: Floats, y: Floats, weight: Floats, mirror: tuple[Floats, Floats] | None
    ) -> None:
        self._net, self._device = net, device()
        self._x, self._y, self._weight = (self._put(array) for array in (x, y, weight))
        self._mirror = None if mirror is None else (self._put(mirror[0]), self._put(mirror[1]))

    def _put(self, array: Floats) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self._device)

    def __call__(self, theta: Floats) -> Squares:
        """The sums at weights ``theta``."""
        p, weights = self._net.count, self._put(theta)
        cost, gradient, normal = 0.0, np.zeros(p), np.zeros((p, p))
        for first in range(0, len(self._x), _ROWS):
            r, slope = self._errors(weights, slice(first, first + _ROWS))
            part = Squares.of(r.numpy(), slope.numpy()) if slope.is_cpu else _on_gpu(r, slope)
            cost, gradient, normal = (
                cost + part.cost,
                gradient + part.gradient,
                normal + part.normal,
            )
        return Squares(cost, gradient, normal)

    def _errors(self, theta: Tensor, rows: slice) -> tuple[Tensor, Tensor]:
        """Weighted errors of some samples, flat, and their derivatives."""
        x, weight = self._x[rows], self._weight[rows]
        outputs, slope = jacobian(self._net, theta, x)
        if self._mirror is not None:
            image, its_slope = jacobian(self._net, theta, self._mirror[0] * x)
            outputs = 0.5 * (outputs + self._mirror[1] * image)
            slope = 0.5 * (slope + self._mirror[1][:, None] * its_slope)
        error = (outputs - self._y[rows]) * weight
        return error.ravel(), (slope * weight[:, :, None]).reshape(-1, self._net.count)


def _on_gpu(r: Tensor, slope: Tensor) -> Squares:
    """Only the sums leave the GPU."""
    gradient, normal = (slope.T @ r).cpu().numpy(), (slope.T @ slope).cpu().numpy()
    return Squares(0.5 * float(r @ r), gradient, normal)


def jacobian(net: Mlp, theta: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
    """Predictions ``(m, outputs)`` for ``x (m, inputs)`` and their derivatives ``(m, outputs,
    count)``."""
    matrices, activations = net.layers(theta), [x]
    for matrix in matrices[:-1]:
        activations.append(torch.sigmoid(activations[-1] @ matrix[1:] + matrix[0]))
    outputs = activations[-1] @ matrices[-1][1:] + matrices[-1][0]
    samples, width = outputs.shape
    delta = torch.eye(width, dtype=x.dtype, device=x.device).expand(samples, width, width)
    blocks: list[Tensor] = []
    for matrix, a in zip(reversed(matrices), reversed(activations), strict=True):
        ones = torch.cat([torch.ones_like(a[:, :1]), a], dim=1)
        blocks.append((ones[:, None, :, None] * delta[:, :, None, :]).reshape(samples, width, -1))
        delta = (delta @ matrix[1:].T) * (a * (1.0 - a))[:, None, :]
    return outputs, torch.cat(blocks[::-1], dim=2)
