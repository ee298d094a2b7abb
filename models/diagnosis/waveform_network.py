"""A small convolutional network on waveforms over shaft angle: the rung that learns its own
features."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from firmware_py.acquire.orders import BINS, ROTATING
from firmware_py.acquire.windows import TURNS
from firmware_py.brain.verdict import class_probabilities
from models.diagnosis.dataset import Dataset
from models.learning.device import device

FILTERS = 12
BATCH = 64


class WaveformNetwork(nn.Module):
    """``waves (m, 7 x 1024)`` -> log-odds of the heads ``(m, 4)``.

    Every channel is brought to unit rms; the logarithm of the rms joins the pooled features.
    """

    def __init__(self) -> None:
        super().__init__()
        self.convolutions = nn.Sequential(
            nn.Conv1d(len(ROTATING), FILTERS, 16, stride=4),
            nn.ReLU(),
            nn.Conv1d(FILTERS, 2 * FILTERS, 8, stride=4),
            nn.ReLU(),
        )
        self.heads = nn.Linear(4 * FILTERS + len(ROTATING), 4)

    def forward(self, waves: Tensor) -> Tensor:
        """Log-odds."""
        x = waves.view(-1, len(ROTATING), TURNS * BINS)
        rms = torch.sqrt((x * x).mean(dim=2) + 1e-24)
        maps = self.convolutions(x / rms[:, :, None])
        pooled = torch.cat([maps.mean(dim=2), maps.amax(dim=2), torch.log10(rms) + 3.0], dim=1)
        return torch.as_tensor(self.heads(pooled))


def fit_waveforms(
    train: Dataset, inner: Dataset, epochs: int, seed: int, progress: Callable[[int], None]
) -> WaveformNetwork:
    """Adam on the heads' likelihood; the weights that are best on ``inner`` are kept."""
    torch.manual_seed(seed)
    order, network = np.random.default_rng(seed), WaveformNetwork().to(device())
    optimiser = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=1e-3)
    loss = nn.BCEWithLogitsLoss()
    sets = (train.features, train.heads, inner.features, inner.heads)
    x, heads, x_inner, inner_heads = (_tensor(values).to(device()) for values in sets)
    best, kept = np.inf, network.state_dict()
    for epoch in range(epochs):
        for rows in np.array_split(order.permutation(len(x)), max(1, len(x) // BATCH)):
            optimiser.zero_grad()
            loss(network(x[rows]), heads[rows]).backward()
            optimiser.step()
        with torch.no_grad():
            score = float(loss(network(x_inner), inner_heads))
        if score < best:
            best, kept = (
                score,
                {name: value.clone() for name, value in network.state_dict().items()},
            )
        progress(epoch + 1)
    network.load_state_dict(kept)
    return network.cpu()


def waveform_probability(
    network: WaveformNetwork, waves: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Class probabilities ``(n, 6)``."""
    with torch.no_grad():
        return class_probabilities(network(_tensor(waves)).double().numpy())


def _tensor(values: NDArray[np.floating]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))
