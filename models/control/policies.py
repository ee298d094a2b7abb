"""Learned policies: a network's actions as settings in SI, as a module, as a file, as values of
choices."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models import export
from models.control.episodes import Board
from models.control.rivals import pressures
from models.control.shielded import Observation
from models.learning.ddpg import Actor, Scale
from models.learning.dqn import Values
from sim_hil.gym.control_task import OBSERVATIONS, actions_of

Floats = NDArray[np.float64]

RANGES: Final = {
    "speed_rad_s": (100.0, 1400.0),
    "eccentricity_x_m": (-1.2e-4, 1.2e-4),
    "eccentricity_y_m": (-1.2e-4, 1.2e-4),
    "peak_to_peak_x_m": (0.0, 1e-4),
    "peak_to_peak_y_m": (0.0, 1e-4),
    "clearance_m": (3e-5, 1.7e-4),
    "supply_pressure_bar": (0.0, 4.0),
    "shaft_power_W": (-10.0, 500.0),
    "oil_outlet_C": (20.0, 80.0),
    "load_estimate_N": (0.0, 500.0),
    "subsync_share": (0.0, 1.0),
}
"""What a working machine shows: the scale of the network's inputs, and the model's domain."""

OUTPUTS: Final = ("clearance", "pressure")


def scale() -> Scale:
    """Of the network's inputs."""
    low, high = np.array([RANGES[name] for name in OBSERVATIONS], np.float32).T
    return Scale(low, high)


class BoundedSettings(nn.Module):
    """``observation (m, 11)`` in SI -> ``settings (m, k)``: clearance, m, and pressure, Pa, inside
    what the rig has.

    Parameters
    ----------
    reach
        Smallest and largest setting, shape (2, k).
    """

    def __init__(self, actor: Actor, reach: Floats) -> None:
        super().__init__()
        self.actor = actor
        self.reach: Tensor
        self.register_buffer("reach", torch.from_numpy(reach.astype(np.float32)))

    def forward(self, observation: Tensor) -> Tensor:
        """Scaled and clipped inside the graph."""
        low, high = self.reach[0], self.reach[1]
        share = 0.5 * (self.actor(observation) + 1.0)
        return torch.minimum(torch.maximum(low + share * (high - low), low), high)


class Columns(nn.Module):
    """Settings as one output each, as a file names them."""

    def __init__(self, module: nn.Module, count: int) -> None:
        super().__init__()
        self.module, self.count = module, count

    def forward(self, observation: Tensor) -> tuple[Tensor, ...]:
        """``(m, 1)`` each."""
        settings = self.module(observation)
        return tuple(settings[:, i : i + 1] for i in range(self.count))


class _Memoryless:
    """A policy that is a function of the observation."""

    def start(self, count: int) -> None:
        """Nothing to forget."""


@dataclass(frozen=True)
class OfModule(_Memoryless):
    """A torch module as a policy."""

    module: nn.Module

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`models.control.episodes.SettingPolicy`."""
        with torch.no_grad():
            return np.asarray(self.module(torch.from_numpy(observation)).numpy(), np.float64)


@dataclass(frozen=True)
class OfFile(_Memoryless):
    """An exported file as a policy."""

    path: Path

    @property
    def outputs(self) -> list[str]:
        """What it sets."""
        return [output.name for output in _session(self.path).get_outputs()]

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`models.control.episodes.SettingPolicy`."""
        answers = _session(self.path).run(None, {"observation": observation})
        return np.concatenate(answers, axis=1).astype(np.float64)


_session = cache(export.session)


@dataclass(frozen=True)
class OfValues(_Memoryless):
    """The choice of highest value as a policy; ``choices`` (n, k) in SI."""

    values: Values
    choices: Floats

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`models.control.episodes.SettingPolicy`."""
        return self.choices[self.values.best(observation)]


def choices(board: Board, clearances: int) -> Floats:
    """Settings that values are learned of: clearances evenly over the range, with each pressure,
    shape (n, k), SI."""
    low, high = board.reach[:, 0]
    row = np.linspace(low, high, clearances)
    return np.array([[c] if p is None else [c, p] for p, c in product(pressures(board), row)])


def actions_of_choices(board: Board, clearances: int) -> Observation:
    """The same as actions in [-1, 1]."""
    return actions_of(board.data, choices(board, clearances))


def random_observations(count: int, seed: int) -> NDArray[np.float32]:
    """Observations over the ranges and beyond, corners first."""
    low, high = np.array(list(RANGES.values())).T
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 2, (min(count, 2 ** min(len(low), 10)), len(low)))
    spread = rng.uniform(-0.5, 1.5, (count - len(corners), len(low)))
    share = np.concatenate([corners.astype(np.float64), spread])
    return np.asarray(low + share * (high - low), np.float32)
