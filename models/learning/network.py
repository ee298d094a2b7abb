"""The multilayer perceptron of equations (1) and (5): sigmoid hidden layers, linear output, float64
numpy.

The weights travel as one flat vector, which is what Levenberg-Marquardt and scaled conjugate
gradient want.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

Floats = NDArray[np.float64]
Vector = TypeVar("Vector", NDArray[np.float64], "Tensor")


def sigmoid(z: Floats) -> Floats:
    """``1 / (1 + exp(-z))`` without overflow."""
    half: Floats = 0.5 * (1.0 + np.tanh(0.5 * z))
    return half


@dataclass(frozen=True)
class Mlp:
    """Feed-forward network ``A(k) = (1, sigmoid(A(k-1) Theta(k-1)))`` with a linear last layer.

    Parameters
    ----------
    sizes
        Neurons of each layer, input first.
    """

    sizes: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of weights, biases included."""
        return sum((n + 1) * m for n, m in pairwise(self.sizes))

    def layers(self, theta: Vector) -> list[Vector]:
        """``theta``, an array or a tensor, as one ``(inputs + 1, outputs)`` matrix a layer; row 0
        is the bias."""
        matrices: list[Vector] = []
        start = 0
        for n, m in pairwise(self.sizes):
            matrices.append(theta[start : start + (n + 1) * m].reshape(n + 1, m))
            start += (n + 1) * m
        return matrices

    def is_weight(self) -> NDArray[np.bool_]:
        """True where ``theta`` holds a weight, False for a bias: equations (6) and (8) penalise
        only weights."""
        mask, start = np.ones(self.count, dtype=bool), 0
        for n, m in pairwise(self.sizes):
            mask[start : start + m] = False
            start += (n + 1) * m
        return mask

    def initial(self, rng: np.random.Generator) -> Floats:
        """Random weights with unit spread at each neuron's input (Glorot and Bengio 2010)."""
        parts = []
        for n, m in pairwise(self.sizes):
            matrix = rng.normal(0.0, 1.0 / np.sqrt(n), (n + 1, m))
            parts.append(matrix.ravel())
        return np.concatenate(parts)

    def outputs(self, theta: Floats, x: Floats) -> Floats:
        """Predictions ``(m, outputs)`` for inputs ``(m, inputs)``."""
        return self._forward(theta, x)[-1]

    def gradient(self, theta: Floats, x: Floats, slope: Floats) -> Floats:
        """Gradient of a cost whose derivative to the predictions is ``slope`` ``(m, outputs)``."""
        activations = self._forward(theta, x)
        delta, blocks = slope, []
        for matrix, a in zip(reversed(self.layers(theta)), reversed(activations[:-1]), strict=True):
            blocks.append(np.vstack([delta.sum(axis=0), a.T @ delta]).ravel())
            delta = (delta @ matrix[1:].T) * (a * (1.0 - a))
        return np.concatenate(blocks[::-1])

    def _forward(self, theta: Floats, x: Floats) -> list[Floats]:
        activations = [x]
        matrices = self.layers(theta)
        for k, matrix in enumerate(matrices):
            z = activations[-1] @ matrix[1:] + matrix[0]
            activations.append(z if k == len(matrices) - 1 else sigmoid(z))
        return activations
