"""The classifier as one graph: scaling, network, calibration and novelty score inside."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models.film_network import Perceptron

Floats = NDArray[np.float64]
CLIP = 10.0
"""Standard deviations beyond which a feature moves the verdict no further."""


class Diagnosis(nn.Module):
    """``features (m, F)`` float32 -> ``heads (m, 4)`` probabilities, ``score (m, 1)`` novelty, both float32.

    Parameters
    ----------
    mean, deviation
        Of the training windows, ``(F,)``.
    layers
        Weights of the network on scaled features.
    temperature
        Divisor of the log-odds.
    whitening
        ``(F, k)``: scaled features times it have unit covariance over the training windows, so that the
        score ``|z W| / sqrt(k)`` is the Mahalanobis distance, about 1 for what was taught.
    """

    def __init__(
        self, mean: Floats, deviation: Floats, layers: list[Floats], temperature: float, whitening: Floats
    ) -> None:
        super().__init__()
        self.net = Perceptron(layers)
        self.temperature = temperature
        self.mean: Tensor
        self.deviation: Tensor
        self.whitening: Tensor
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("deviation", torch.from_numpy(deviation))
        self.register_buffer("whitening", torch.from_numpy(whitening))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Probabilities of the heads, and the novelty score."""
        z = (features.double() - self.mean) / self.deviation
        logits = self.net(torch.clamp(z, -CLIP, CLIP)) / self.temperature
        distance = z @ self.whitening
        score = torch.sqrt((distance * distance).mean(dim=1, keepdim=True))
        return torch.sigmoid(logits).float(), score.float()
