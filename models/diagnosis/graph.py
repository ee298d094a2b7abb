"""The classifier as one graph: scaling, network, calibration, novelty score and reasons inside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from firmware_py.acquire.features import GROUP_OF_FEATURE, GROUPS
from models.diagnosis.ladder import CLIP
from models.diagnosis.novelty import Part
from models.film.reduced_network import Perceptron

Floats = NDArray[np.float64]


class Distance(nn.Module):
    """:meth:`models.diagnosis.novelty.Part.distance` as a column, ``(m, F)`` -> ``(m, 1)``."""

    def __init__(self, part: Part) -> None:
        super().__init__()
        self.limit = part.limit
        self.whitening: Tensor
        self.centres: Tensor
        self.register_buffer("whitening", torch.from_numpy(part.whitening))
        self.register_buffer("centres", torch.from_numpy(part.centres))

    def forward(self, z: Tensor) -> Tensor:
        """Distance to the nearest centre."""
        away = (z @ self.whitening)[:, None, :] - self.centres
        nearest = torch.sqrt((away * away).mean(dim=2)).amin(dim=1, keepdim=True)
        return nearest / self.limit


class Diagnosis(nn.Module):
    """``features (m, F)`` -> ``heads (m, 4)`` probabilities, ``score (m, 1)`` novelty, ``drivers (m, G * 4)``; float32.

    Drivers are the log-odds that each head owes to each group of features: what it loses when the group is set to
    the mean of the training rows (occlusion, Zeiler and Fergus 2014).

    Parameters
    ----------
    mean, deviation
        Of the training windows, ``(F,)``.
    layers
        Weights of the network on scaled features.
    temperature
        Divisor of the log-odds.
    scale
        Mean and deviation of the rows that novelty was fitted on, ``(F,)`` each.
    parts
        Distances whose largest is the novelty score.
    """

    def __init__(
        self, mean: Floats, deviation: Floats, layers: list[Floats], temperature: float,
        scale: tuple[Floats, Floats], parts: Sequence[Part],
    ) -> None:  # fmt: skip
        super().__init__()
        self.net = Perceptron(layers)
        self.temperature = temperature
        self.mean: Tensor
        self.deviation: Tensor
        self.centre: Tensor
        self.spread: Tensor
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("deviation", torch.from_numpy(deviation))
        self.register_buffer("centre", torch.from_numpy(scale[0]))
        self.register_buffer("spread", torch.from_numpy(scale[1]))
        self.novelty = nn.ModuleList(Distance(part) for part in parts)
        self.kept: Tensor
        kept = np.arange(len(GROUPS))[:, None] != GROUP_OF_FEATURE
        self.register_buffer("kept", torch.from_numpy(kept.astype(np.float64)))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Probabilities of the heads, the novelty score, and what drove the heads."""
        z = (features.double() - self.mean) / self.deviation
        held = torch.clamp(z, -CLIP, CLIP)
        logits = self.net(held) / self.temperature
        without = self.net(held[:, None, :] * self.kept) / self.temperature
        drivers = (logits[:, None, :] - without).flatten(1)
        plain = (features.double() - self.centre) / self.spread
        score = torch.cat([part(plain) for part in self.novelty], dim=1).amax(dim=1, keepdim=True)
        return torch.sigmoid(logits).float(), score.float(), drivers.float()
