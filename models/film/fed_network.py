"""The fed film network as one graph: supply pressure and groove angle beside the nine numbers of
the state.

In the groove's frame the force over ``mu R L^3 / c^2 (u + q)`` and the flow out of both ends over
``2 R L c (u + q)`` (see :mod:`models.film.fed_data`) are

    f = (|f0| + s) (N(z) + M N(M z)) / 2        Q = (Q0 + s) exp((n(z) + n(M z)) / 2)

with ``f0``, ``Q0`` the unfed film of :class:`models.film.reduced_network.ReducedFilm`, ``s`` the
share of the supply, ``(N, n)`` one small network and ``M`` the mirror about the groove, so that
mirror symmetry, rotation (of bearing and groove together) and homogeneity hold exactly.  Among the
inputs ``z`` is what decides whether the groove feeds the film or drains it: the pressure that a
short unfed film would have at the groove's edges, beside the supply's. The torque is ``(e x F) /
2`` and full Couette shear; the pressure is continuous, fed or not.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models.film.fed_data import GROOVE_WIDTH_RAD
from models.film.reduced_network import ECCENTRICITY_LIMIT, ReducedFilm, TorchPerceptron
from models.film.states import STATE

Floats = NDArray[np.float64]

FED_STATE = (*STATE, "p_s_Pa", "groove_rad")
"""Columns of the input: supply pressure above ambient, and the angle of the groove's middle."""

INPUT_SIGNS = (1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0)
OUTPUT_SIGNS = (1.0, -1.0, 1.0)
"""What the mirror about the groove does to the network's inputs and outputs."""

_ROUND = 1e-3
"""Square of the eccentricity ratio below which the outward direction fades, so that the middle is
smooth."""


def features(points: Tensor, unfed: ReducedFilm) -> tuple[Tensor, Tensor, Tensor]:
    """Inputs ``(m, 14)`` of the network, and the gains of force and flow ``(m, 1)``, from points of
    ``FedSamples``."""
    e, w = points[:, :2], points[:, 2:]
    eps, speed = _length(e), _length(w)
    share = 1.0 - speed
    f0, flow0 = _unfed_film(e, w, unfed)
    gain = _length(f0) + share
    deep = e * (-torch.log1p(-eps) / torch.clamp(eps, min=1e-9))
    outward = e / torch.sqrt(eps * eps + _ROUND)
    across = outward[:, 1:] * w[:, :1] - outward[:, :1] * w[:, 1:]
    along = (outward * w).sum(dim=1, keepdim=True)
    before, after = (
        _edge(e, w, share, sign * 0.5 * GROOVE_WIDTH_RAD, unfed) for sign in (-1.0, 1.0)
    )
    gap = torch.log(1.0 - e[:, :1])
    columns = [
        e,
        w,
        deep,
        along,
        across,
        share,
        f0 / gain,
        gap,
        before + after,
        2.0 * (after - before),
    ]
    return torch.cat(columns, dim=1), gain, flow0 + share


def _edge(e: Tensor, w: Tensor, share: Tensor, angle: float, unfed: ReducedFilm) -> Tensor:
    """Mean pressure along a short unfed film at ``angle``, as a share of itself and the
    supply's."""
    way = torch.tensor([[np.cos(angle)], [np.sin(angle)]], dtype=e.dtype)
    gap = 1.0 - e @ way
    pressure = 4.0 * unfed.length_over_diameter**2 * (w @ way) / (gap * gap * gap)
    return pressure / (torch.abs(pressure) + torch.clamp(share, min=1e-9))


def _unfed_film(e: Tensor, w: Tensor, unfed: ReducedFilm) -> tuple[Tensor, Tensor]:
    """Force over ``L^3`` and flow over ``2 L`` of the unfed film of a unit bearing at the squeeze
    velocity ``w``."""
    one, zero = torch.ones_like(e[:, :1]), torch.zeros_like(e[:, :1])
    length = 2.0 * unfed.length_over_diameter
    force, _, flow, _ = unfed(torch.cat([e, w, zero, one, one, one, length * one], dim=1))
    return force / length**3, flow / (2.0 * length)


def _length(v: Tensor) -> Tensor:
    return torch.sqrt((v * v).sum(dim=1, keepdim=True))


class FedFilm(nn.Module):
    """``state (m, 11)`` -> ``force (m, 2)`` N, ``friction_torque (m, 1)`` N m, ``side_flow (m, 1)``
    m3/s, ``inside``.

    ``inside (m, 1)`` is 1 in the domain of :class:`ReducedFilm` with a supply that is not below
    ambient, else 0.
    """

    def __init__(self, layers: list[Floats], unfed: ReducedFilm) -> None:
        super().__init__()
        self.net = TorchPerceptron(layers)
        self.unfed = unfed
        self.input_signs: Tensor
        self.output_signs: Tensor
        self.register_buffer("input_signs", torch.tensor(INPUT_SIGNS, dtype=torch.float64))
        self.register_buffer("output_signs", torch.tensor(OUTPUT_SIGNS, dtype=torch.float64))

    def forward(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Force on the journal, torque braking it (for either sense), flow out of both ends,
        domain."""
        x, y, vx, vy, omega, c, mu, radius, length, supply, groove = (
            state[:, k : k + 1] for k in range(11)
        )
        eps = torch.sqrt(x * x + y * y) / c
        shrink = ECCENTRICITY_LIMIT / torch.clamp(eps, min=ECCENTRICITY_LIMIT)
        squeeze = torch.cat([vx + 0.5 * omega * y, vy - 0.5 * omega * x], dim=1) / c
        feed = torch.clamp(supply, min=0.0) * c * c / (mu * radius * radius)
        rate = _length(squeeze) + feed
        cosine, sine = torch.cos(groove), torch.sin(groove)
        e = _turned(torch.cat([x, y], dim=1) / c * shrink, cosine, -sine)
        w = _turned(squeeze / torch.clamp(rate, min=1e-30), cosine, -sine)
        force, flow = self.reduced(torch.cat([e, w], dim=1))
        force = _turned(force, cosine, sine) * (mu * radius * length**3 / (c * c) * rate)
        ex, ey = x * shrink, y * shrink
        wall = (
            2.0
            * np.pi
            * mu
            * radius**3
            * length
            / (c * torch.sqrt(1.0 - (ex * ex + ey * ey) / (c * c)))
        )
        sense = torch.where(omega < 0.0, -1.0, 1.0)
        torque = sense * (wall * omega + 0.5 * (ex * force[:, 1:2] - ey * force[:, 0:1]))
        inside = self.unfed(state[:, : len(STATE)])[3] * (supply >= 0.0).to(state.dtype)
        return force, torque, 2.0 * radius * length * c * rate * flow, inside

    def reduced(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Dimensionless force ``(m, 2)`` in the groove's frame, and flow, at points ``(m, 4)`` of
        ``FedSamples``."""
        z, force_gain, flow_gain = features(points, self.unfed)
        answer = 0.5 * (self.net(z) + self.output_signs * self.net(self.input_signs * z))
        return force_gain * answer[:, :2], flow_gain * torch.exp(answer[:, 2:])


def _turned(v: Tensor, cosine: Tensor, sine: Tensor) -> Tensor:
    """``v (m, 2)`` turned by the angle of that cosine and sine."""
    return torch.cat(
        [v[:, :1] * cosine - v[:, 1:] * sine, v[:, :1] * sine + v[:, 1:] * cosine], dim=1
    )
