"""The fed film-force network as one graph: supply pressure and groove angle beside the nine numbers of the state.

In the groove's frame the force over ``mu R L^3 / c^2 (u + q)`` (see :mod:`models.film.fed_data`) is

    f = (|f0| + s) (N(z) + M N(M z)) / 2

with ``f0`` the unfed film of :class:`models.film.reduced_network.ReducedFilm`, ``s`` the share of the supply, ``N``
one small network and ``M`` the mirror about the groove, so that mirror symmetry, rotation (of bearing and groove
together) and homogeneity hold exactly. The torque is ``(e x F) / 2`` and full Couette shear; the pressure is
continuous, fed or not.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models.film.reduced_network import ECCENTRICITY_LIMIT, Perceptron, ReducedFilm
from models.film.states import STATE

Floats = NDArray[np.float64]

FED_STATE = (*STATE, "p_s_Pa", "groove_rad")
"""Columns of the input: supply pressure above ambient, and the angle of the groove's middle."""

INPUT_SIGNS = (1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0)
OUTPUT_SIGNS = (1.0, -1.0)
"""What the mirror about the groove does to the network's inputs and outputs."""


_ROUND = 1e-3
"""Square of the eccentricity ratio below which the outward direction fades, so that the middle is smooth."""


def features(points: Tensor, unfed: ReducedFilm) -> tuple[Tensor, Tensor]:
    """Inputs ``(m, 11)`` of the network and its gain ``|f0| + s`` ``(m, 1)``, from the points of ``FedSamples``."""
    e, w = points[:, :2], points[:, 2:]
    eps, speed = _length(e), _length(w)
    share = 1.0 - speed
    f0 = _unfed_force(e, w, unfed)
    gain = _length(f0) + share
    deep = e * (-torch.log1p(-eps) / torch.clamp(eps, min=1e-9))
    outward = e / torch.sqrt(eps * eps + _ROUND)
    across = outward[:, 1:] * w[:, :1] - outward[:, :1] * w[:, 1:]
    along = (outward * w).sum(dim=1, keepdim=True)
    return torch.cat([e, w, deep, along, across, share, f0 / gain], dim=1), gain


def _unfed_force(e: Tensor, w: Tensor, unfed: ReducedFilm) -> Tensor:
    """Force of the unfed film of a unit bearing (mu, R, c = 1) over ``L^3``, at the squeeze velocity ``w``."""
    one, zero = torch.ones_like(e[:, :1]), torch.zeros_like(e[:, :1])
    length = 2.0 * unfed.length_over_diameter
    force: Tensor = unfed(torch.cat([e, w, zero, one, one, one, length * one], dim=1))[0]
    return force / length**3


def _length(v: Tensor) -> Tensor:
    return torch.sqrt((v * v).sum(dim=1, keepdim=True))


class FedFilm(nn.Module):
    """``state (m, 11)`` -> ``force (m, 2)`` N, ``friction_torque (m, 1)`` N m, ``inside (m, 1)``.

    ``inside`` is 1 in the domain of :class:`ReducedFilm` with a supply that is not below ambient, else 0.
    """

    def __init__(self, layers: list[Floats], unfed: ReducedFilm) -> None:
        super().__init__()
        self.net = Perceptron(layers)
        self.unfed = unfed
        self.input_signs: Tensor
        self.output_signs: Tensor
        self.register_buffer("input_signs", torch.tensor(INPUT_SIGNS, dtype=torch.float64))
        self.register_buffer("output_signs", torch.tensor(OUTPUT_SIGNS, dtype=torch.float64))

    def forward(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Force on the journal, torque braking it (for either sense), domain."""
        x, y, vx, vy, omega, c, mu, radius, length, supply, groove = (state[:, k : k + 1] for k in range(11))
        eps = torch.sqrt(x * x + y * y) / c
        shrink = ECCENTRICITY_LIMIT / torch.clamp(eps, min=ECCENTRICITY_LIMIT)
        squeeze = torch.cat([vx + 0.5 * omega * y, vy - 0.5 * omega * x], dim=1) / c
        feed = torch.clamp(supply, min=0.0) * c * c / (mu * radius * radius)
        rate = _length(squeeze) + feed
        cosine, sine = torch.cos(groove), torch.sin(groove)
        e = _turned(torch.cat([x, y], dim=1) / c * shrink, cosine, -sine)
        w = _turned(squeeze / torch.clamp(rate, min=1e-30), cosine, -sine)
        force = _turned(self.reduced(torch.cat([e, w], dim=1)), cosine, sine) * (
            mu * radius * length**3 / (c * c) * rate
        )
        ex, ey = x * shrink, y * shrink
        wall = 2.0 * np.pi * mu * radius**3 * length / (c * torch.sqrt(1.0 - (ex * ex + ey * ey) / (c * c)))
        sense = torch.where(omega < 0.0, -1.0, 1.0)
        torque = sense * (wall * omega + 0.5 * (ex * force[:, 1:2] - ey * force[:, 0:1]))
        return force, torque, self.unfed(state[:, : len(STATE)])[3] * (supply >= 0.0).to(state.dtype)

    def reduced(self, points: Tensor) -> Tensor:
        """Dimensionless force ``(m, 2)`` in the groove's frame, at points ``(m, 4)`` of ``FedSamples``."""
        z, gain = features(points, self.unfed)
        image = self.output_signs * self.net(self.input_signs * z)
        answer: Tensor = 0.5 * gain * (self.net(z) + image)
        return answer


def _turned(v: Tensor, cosine: Tensor, sine: Tensor) -> Tensor:
    """``v (m, 2)`` turned by the angle of that cosine and sine."""
    return torch.cat([v[:, :1] * cosine - v[:, 1:] * sine, v[:, :1] * sine + v[:, 1:] * cosine], dim=1)
