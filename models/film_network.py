"""The reduced film-force network as one graph: SI in, newtons out, symmetry and dissipation by construction.

For a plain aligned unfed film with ambient rupture, the force depends on the effective squeeze velocity
``v_s = v - (omega / 2) z x e`` and the eccentricity alone.  In the frame of ``v_s`` the eccentricity ratio is
``(a, b)``, and mirror symmetry makes the force along ``v_s`` even and the force across it odd in ``b``:

    F_along  = -g |v_s| J_along(a, b)  exp(n1(a, b**2))
    F_across = -g |v_s| J_across(a, b) exp(n2(a, b**2))          g = mu R L**3 / c**3
    Q_side   = 2 R L |v_s| exp(n3(a, b**2))

``J`` are the integrals of the short (Ocvirk) half film, ``n`` one small network: it learns only how a film of
this length departs from a short one.  The torque needs no network: ``(e x F) / 2`` is the pressure part, full
Couette shear the rest.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Floats = NDArray[np.float64]
STATE = ("x_m", "y_m", "vx_m_s", "vy_m_s", "omega_rad_s", "c_m", "mu_Pa_s", "R_m", "L_m")
"""Columns of the input."""

ECCENTRICITY_LIMIT = 0.98
"""Beyond it the film keeps the shape it has here: an answer, never a NaN, and outside the stated domain."""

_NODES = 40


def half_film_integrals(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Short-bearing integrals over the loaded half, ``int (cos^2, cos sin) phi / (1 - a cos - b sin)^3 dphi``.

    Gauss-Legendre in ``t = tan(phi / 2)``; ``a``, ``b`` of shape ``(m, 1)``.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    t = torch.tensor(nodes, dtype=a.dtype)
    w = torch.tensor(weights, dtype=a.dtype)
    q = (1.0 + a) * t * t - 2.0 * b * t + (1.0 - a)
    kernel = 2.0 * w * (1.0 - t * t) / (q * q * q)
    along = (kernel * (1.0 - t * t)).sum(dim=1, keepdim=True)
    across = (kernel * (2.0 * t)).sum(dim=1, keepdim=True)
    return along, across


class Perceptron(nn.Module):
    """Weights of a :class:`models.network.Mlp` as a float64 torch module."""

    def __init__(self, layers: list[Floats]) -> None:
        super().__init__()
        self.layers = nn.ModuleList()
        for matrix in layers:
            linear = nn.Linear(matrix.shape[0] - 1, matrix.shape[1], dtype=torch.float64)
            linear.weight.data = torch.tensor(matrix[1:].T.copy())
            linear.bias.data = torch.tensor(matrix[0].copy())
            self.layers.append(linear)

    def forward(self, x: Tensor) -> Tensor:
        """Linear outputs of the sigmoid network."""
        for linear in self.layers[:-1]:
            x = torch.sigmoid(linear(x))
        outputs: Tensor = self.layers[-1](x)
        return outputs


class ReducedFilm(nn.Module):
    """``state (m, 9)`` -> ``force (m, 2)`` N, ``friction_torque (m, 1)`` N m, ``side_flow (m, 1)`` m3/s."""

    def __init__(self, layers: list[Floats]) -> None:
        super().__init__()
        self.net = Perceptron(layers)

    def forward(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Force on the journal, torque braking it (for either sense), flow out of both ends."""
        x, y, vx, vy, omega, c, mu, radius, length = (state[:, k : k + 1] for k in range(9))
        ex, ey = _inside(x / c, y / c)
        sx, sy = vx + 0.5 * omega * c * ey, vy - 0.5 * omega * c * ex
        speed = torch.sqrt(sx * sx + sy * sy)
        ux, uy = sx / (speed + 1e-30), sy / (speed + 1e-30)
        a, b = ex * ux + ey * uy, ey * ux - ex * uy
        along, across = half_film_integrals(a, b)
        n = self.net(torch.cat([a, b * b], dim=1))
        gain = -mu * radius * length**3 / (c * c * c) * speed
        along, across = gain * along * torch.exp(n[:, 0:1]), gain * across * torch.exp(n[:, 1:2])
        force = torch.cat([along * ux - across * uy, along * uy + across * ux], dim=1)
        wall = 2.0 * np.pi * mu * radius**3 * length / (c * torch.sqrt(1.0 - ex * ex - ey * ey))
        sense = torch.where(omega < 0.0, -1.0, 1.0)
        torque = sense * (wall * omega + 0.5 * c * (ex * force[:, 1:2] - ey * force[:, 0:1]))
        return force, torque, 2.0 * radius * length * speed * torch.exp(n[:, 2:3])


def _inside(ex: Tensor, ey: Tensor) -> tuple[Tensor, Tensor]:
    """Eccentricity ratio drawn back to :data:`ECCENTRICITY_LIMIT` where it lies beyond."""
    eps = torch.sqrt(ex * ex + ey * ey)
    shrink = ECCENTRICITY_LIMIT / torch.clamp(eps, min=ECCENTRICITY_LIMIT)
    return ex * shrink, ey * shrink
