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

from firmware_py.guard.plausibility.reading_rows import power_max_W
from models import export
from models.control.episodes import Board
from models.control.rivals import pressures
from models.control.shielded import Observation
from models.learning.ddpg import Actor, Scale
from models.learning.dqn import Values
from sim_hil.gym.control_task import OBSERVATIONS, actions_of
from sim_hil.plant.duty import RAD_S_PER_RPM
from sim_hil.rigs import RigData

Floats = NDArray[np.float64]

OUTPUTS: Final = ("clearance", "pressure")


def ranges_of(rig: RigData) -> dict[str, tuple[float, float]]:
    """What a working machine shows: the scale of the network's inputs, and the model's domain."""
    o, b, oil = rig.config.machine.operating, rig.bearing, rig.config.machine.lubricant
    most_m = b.clearance_max_m
    readings = rig.config.machine.readings
    most_W = readings.shaft_power_max_W or power_max_W(rig.config)
    return {
        "speed_rad_s": (
            0.6 * o.speed_min_rpm * RAD_S_PER_RPM,
            1.1 * o.speed_max_rpm * RAD_S_PER_RPM,
        ),
        "eccentricity_x_m": (-0.75 * most_m, 0.75 * most_m),
        "eccentricity_y_m": (-0.75 * most_m, 0.75 * most_m),
        "peak_to_peak_x_m": (0.0, 0.6 * most_m),
        "peak_to_peak_y_m": (0.0, 0.6 * most_m),
        "clearance_m": (0.75 * b.clearance_min_m, 1.06 * most_m),
        "supply_pressure_bar": (0.0, 1e-5 * rig.supply.max_Pa + 1.0),
        "shaft_power_W": (-2.0 * rig.errors.shaft_power_W, most_W),
        "oil_outlet_C": (oil.inlet_min_C - 15.0, oil.film_max_C + 20.0),
        "load_estimate_N": (0.0, 1.7 * rig.load_max_N),
        "subsync_share": (0.0, 1.0),
    }


def scale(rig: RigData) -> Scale:
    """Of the network's inputs."""
    ranges = ranges_of(rig)
    low, high = np.array([ranges[name] for name in OBSERVATIONS], np.float32).T
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


def random_observations(rig: RigData, count: int, seed: int) -> NDArray[np.float32]:
    """Observations over the ranges and beyond, corners first."""
    low, high = np.array(list(ranges_of(rig).values())).T
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 2, (min(count, 2 ** min(len(low), 10)), len(low)))
    spread = rng.uniform(-0.5, 1.5, (count - len(corners), len(low)))
    share = np.concatenate([corners.astype(np.float64), spread])
    return np.asarray(low + share * (high - low), np.float32)
