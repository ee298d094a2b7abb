"""The classifier as one graph: scaling, network, calibration, novelty score and reasons inside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from firmware_py.acquire.features import GROUP_OF_FEATURE, GROUPS
from models.diagnosis.ladder import CLIP
from models.diagnosis.novelty import FARTHEST, OPERATING_COLUMNS, PAIRS, REACH, Part, Residual
from models.film.reduced_network import TorchPerceptron

Floats = NDArray[np.float64]


class Residuals(nn.Module):
    """:class:`models.diagnosis.novelty.Residual`, ``(m, F)`` -> ``(m, F)``."""

    def __init__(self, residual: Residual) -> None:
        super().__init__()
        self.centre: Tensor
        self.spread: Tensor
        self.mean: Tensor
        self.log_scale: Tensor
        for name in ("centre", "spread", "mean", "log_scale"):
            self.register_buffer(name, torch.from_numpy(getattr(residual, name)))
        self.columns: Tensor
        self.register_buffer("columns", torch.from_numpy(OPERATING_COLUMNS))
        self.pairs: Tensor
        self.register_buffer("pairs", torch.from_numpy(PAIRS))

    def forward(self, features: Tensor) -> Tensor:
        """What the operating point does not explain."""
        held = torch.clamp((features[:, self.columns] - self.centre) / self.spread, -REACH, REACH)
        linear = torch.cat([torch.ones_like(held[:, :1]), held], dim=1)
        terms = torch.cat([linear, held[:, self.pairs[0]] * held[:, self.pairs[1]]], dim=1)
        scaled = (features - terms @ self.mean) * torch.exp(-linear @ self.log_scale)
        return torch.clamp(scaled, -FARTHEST, FARTHEST)


class White(nn.Module):
    """The whitened residuals of one :class:`models.diagnosis.novelty.Part` about healthy, ``(m,
    F)`` -> ``(m, k)``."""

    def __init__(self, part: Part) -> None:
        super().__init__()
        self.limit, self.exponent = part.limit, part.exponent
        self.whitening: Tensor
        self.healthy: Tensor
        self.centres: Tensor
        self.register_buffer("whitening", torch.from_numpy(part.whitening))
        self.register_buffer("healthy", torch.from_numpy(part.centres[0]))
        self.register_buffer("centres", torch.from_numpy(part.centres - part.centres[0]))

    def forward(self, residual: Tensor) -> Tensor:
        """Zero where a healthy machine of the fleet lies on average."""
        return residual @ self.whitening - self.healthy

    def distance(self, white: Tensor) -> Tensor:
        """Novelty of ``forward``'s answer by its distance to the nearest taught centre, ``(m,
        1)``."""
        away = white[:, None, :] - self.centres
        nearest = torch.sqrt((away * away).mean(dim=2)).amin(dim=1, keepdim=True)
        return (nearest / self.limit) ** self.exponent


class DiagnosisGraph(nn.Module):
    """``features (m, F)`` -> ``heads (m, 4)`` probabilities, ``score (m, 1)`` novelty, ``drivers
    (m, G * 4)``, ``normal (m, k)``, ``departures (m, G)``; float32.

    Drivers are the log-odds that each head owes to each group of features: what it loses when the
    group is set to the mean of the training rows (occlusion, Zeiler and Fergus 2014).  ``normal``
    are the whitened residuals of all parts, from which the device learns what is normal for one
    machine; ``departures`` the root mean square of the residuals in each group of features.

    Parameters
    ----------
    mean, deviation
        Of the training windows, ``(F,)``.
    layers
        Weights of the network on scaled features.
    temperature
        Divisors of the heads' log-odds, ``(4,)``.
    residual, parts
        What :func:`models.diagnosis.novelty.fit_novelty` found; the largest distance is the novelty
        score.
    fleet
        What :func:`models.diagnosis.novelty.fleet` found; goes into the file's metadata.
    """

    def __init__(
        self,
        mean: Floats,
        deviation: Floats,
        layers: list[Floats],
        temperature: Floats,
        residual: Residual,
        parts: Sequence[Part],
        fleet: Mapping[str, object],
    ) -> None:
        super().__init__()
        self.net = TorchPerceptron(layers)
        self.temperature: Tensor
        self.register_buffer("temperature", torch.from_numpy(temperature))
        self.fleet = fleet
        self.mean: Tensor
        self.deviation: Tensor
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("deviation", torch.from_numpy(deviation))
        self.residuals = Residuals(residual)
        self.whites = [White(part) for part in parts]
        self.parts = nn.ModuleList(self.whites)
        self.kept: Tensor
        kept = np.arange(len(GROUPS))[:, None] != GROUP_OF_FEATURE
        self.share: Tensor
        self.register_buffer(
            "share", torch.from_numpy((~kept / np.sum(~kept, axis=1, keepdims=True)).T.copy())
        )
        self.register_buffer("kept", torch.from_numpy(kept.astype(np.float64)))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Probabilities of the heads, novelty score, what drove the heads, whitened residuals,
        their size by group."""
        z = (features.double() - self.mean) / self.deviation
        held = torch.clamp(z, -CLIP, CLIP)
        logits = self.net(held) / self.temperature
        without = self.net(held[:, None, :] * self.kept) / self.temperature
        drivers = (logits[:, None, :] - without).flatten(1)
        residual = self.residuals(features.double())
        white = [part(residual) for part in self.whites]
        score = torch.cat([p.distance(w) for p, w in zip(self.whites, white, strict=True)], 1).amax(
            1, keepdim=True
        )
        departures = torch.sqrt((residual * residual) @ self.share)
        answers = torch.sigmoid(logits), score, drivers, torch.cat(white, dim=1), departures
        heads, score, drivers, normal, departures = (answer.float() for answer in answers)
        return heads, score, drivers, normal, departures
