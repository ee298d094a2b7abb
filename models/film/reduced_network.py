"""The reduced film-force network as one graph: SI in, newtons out, symmetry and dissipation by
construction.

For a plain aligned unfed film with ambient rupture, the force depends on the effective squeeze
velocity ``v_s = v - (omega / 2) z x e`` and the eccentricity alone.  In the frame of ``v_s`` the
eccentricity ratio is ``(a, b)``, and mirror symmetry makes the force along ``v_s`` even and the
force across it odd in ``b``:

    F_along  = -g |v_s| J_along(a, b)  exp(n1(a, b**2))
    F_across = -g |v_s| J_across(a, b) exp(n2(a, b**2))          g = mu R L**3 / c**3
    Q_side   = 2 R L |v_s| exp(n3(a, b**2))

``J`` are the integrals of the short (Ocvirk) half film, ``n`` one small network: it learns only how
a film of this length departs from a short one.  The torque needs no network: ``(e x F) / 2`` is the
pressure part, full Couette shear the rest.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models.film.states import STATE

Floats = NDArray[np.float64]

ECCENTRICITY_LIMIT = 0.98
"""Beyond it the film keeps the shape it has here: an answer, never a NaN, and outside the stated
domain."""

_NODES = 40


def half_film_integrals(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Short-bearing integrals over the loaded half, ``int (cos^2, cos sin) phi / (1 - a cos - b
    sin)^3 dphi``.

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


class TorchPerceptron(nn.Module):
    """Weights of a :class:`models.learning.network.Mlp` as a float64 torch module."""

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
    """``state (m, 9)`` -> ``force (m, 2)`` N, ``friction_torque (m, 1)`` N m, ``side_flow (m, 1)``
    m3/s, ``inside``.

    ``inside (m, 1)`` is 1 where the state lies in the domain (a film, no thinner than the
    training's, in a bearing of its length over diameter), else 0: the other outputs are finite
    there and mean nothing.
    """

    def __init__(
        self, layers: list[Floats], length_over_diameter: float, eccentricity_max: float
    ) -> None:
        super().__init__()
        self.net = TorchPerceptron(layers)
        self.length_over_diameter, self.eccentricity_max = length_over_diameter, eccentricity_max

    def forward(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Force on the journal, torque braking it (for either sense), flow out of both ends,
        domain."""
        x, y, vx, vy, omega, c, mu, radius, length = (
            state[:, k : k + 1] for k in range(len(STATE))
        )
        eccentric = torch.sqrt(x * x + y * y) / c <= self.eccentricity_max
        shaped = (
            torch.abs(length / (2.0 * radius) - self.length_over_diameter)
            <= 1e-6 * self.length_over_diameter
        )
        inside = eccentric & shaped & (c > 0.0) & (mu > 0.0)
        ex, ey = _inside(x / c, y / c)
        sx, sy = vx + 0.5 * omega * y, vy - 0.5 * omega * x
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
        flow = 2.0 * radius * length * speed * torch.exp(n[:, 2:3])
        return force, torque, flow, inside.to(state.dtype)


def layers_of_file(path: Path) -> list[Floats]:
    """Weights in an exported file, one ``(inputs + 1, outputs)`` matrix a layer, biases in row
    0."""
    import onnx
    from onnx import numpy_helper

    stored = {
        tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load(path).graph.initializer
    }
    names = sorted(
        name for name in stored if name.startswith("net.layers.") and name.endswith(".weight")
    )
    pairs = [(stored[name.replace(".weight", ".bias")], stored[name]) for name in names]
    return [np.vstack([bias[None], weight.T]) for bias, weight in pairs]


def _inside(ex: Tensor, ey: Tensor) -> tuple[Tensor, Tensor]:
    """Eccentricity ratio drawn back to :data:`ECCENTRICITY_LIMIT` where it lies beyond."""
    eps = torch.sqrt(ex * ex + ey * ey)
    shrink = ECCENTRICITY_LIMIT / torch.clamp(eps, min=ECCENTRICITY_LIMIT)
    return ex * shrink, ey * shrink
