"""What could replace the learned agent: a table, two controllers of the measured eccentricity, each
from the same observations and behind the same shield."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from models.control.episodes import Board, SettingPolicy
from models.control.shielded import Observation, column
from models.workers import map_in_order
from sim_hil import power_map
from sim_hil.gym.control_task import CONTROL_S, EpisodeLimits
from sim_hil.rigs import RigData

Floats = NDArray[np.float64]

FILM_MARGIN: Final = 1.3
SWING_MARGIN: Final = 0.6
"""Shares of the limits that the nominal machine keeps, so that a build at the edge of the spread
still does."""


class Lookup(nn.Module):
    """``observation (m, 11)`` -> ``settings (m, k)``, SI: bilinear in the logarithms of speed and
    estimated load.

    ``table`` (speeds, loads, k) holds clearances, m, and where it may be set the supply pressure,
    Pa.
    """

    def __init__(self, rig: RigData, table: Floats) -> None:
        super().__init__()
        self.sides: Tensor
        self.table: Tensor
        speeds, loads = _axes(rig, (table.shape[0], table.shape[1]))
        ends = np.log([[speeds[0], speeds[-1]], [loads[0], loads[-1]]])
        self.register_buffer("sides", torch.from_numpy(ends.astype(np.float32)))
        self.register_buffer("table", torch.from_numpy(table.astype(np.float32)))

    def forward(self, observation: Tensor) -> Tensor:
        """Held beyond the ends of the table."""
        names = ("speed_rad_s", "load_estimate_N")
        fast, heavy = (
            self._hats(observation[:, column(name)], axis) for axis, name in enumerate(names)
        )
        columns = [
            torch.sum((fast @ self.table[:, :, i]) * heavy, dim=1)
            for i in range(self.table.shape[2])
        ]
        return torch.stack(columns, dim=1)

    def _hats(self, x: Tensor, axis: int) -> Tensor:
        """Weights of the knots of one axis, shape (m, knots)."""
        low, high = self.sides[axis, 0], self.sides[axis, 1]
        share = (torch.log(torch.clamp(x, min=1.0)) - low) / (high - low)
        knots = self.table.shape[axis]
        place = torch.clamp(share, 0.0, 1.0)[:, None] * (knots - 1)
        return torch.relu(1.0 - torch.abs(place - torch.arange(knots, dtype=place.dtype)))


def lookup(
    board: Board, points: tuple[int, int, int], workers: int, progress: Callable[[int], None]
) -> Lookup:
    """Table of the least power that keeps the limits, by steady runs of the drawing's rotor.

    Parameters
    ----------
    points
        Speeds, loads and clearances of the grid.
    """
    rows = []
    speeds, _ = _axes(board.data, points[:2])
    for done, row in enumerate(
        map_in_order(partial(_row, board, points), speeds.tolist(), workers), 1
    ):
        rows.append(row)
        progress(done)
    return Lookup(board.data, np.array(rows))


def _row(board: Board, points: tuple[int, int, int], speed_rad_s: float) -> Floats:
    """The table's settings (loads, k) at one speed."""
    _, loads = _axes(board.data, points[:2])
    low, high = board.reach[:, 0]
    clearances = np.linspace(low, high, points[2])
    settings, figures = [], []
    for pressure in pressures(board):
        rpm = np.array([speed_rad_s * 30.0 / np.pi])
        found = power_map(board.data, rpm, loads, clearances, seconds=0.6, pressure_Pa=pressure)
        figures.append([m[0] for m in (found.power_W, found.min_film_m, found.peak_to_peak_m)])
        settings += [[c] if pressure is None else [c, pressure] for c in clearances]
    power, film, swing = np.concatenate(figures, axis=2)
    choices, limits = np.array(settings), board.limits
    best = [_best(limits, choices[:, 0], *row) for row in zip(power, film, swing, strict=True)]
    return choices[best]


def pressures(board: Board) -> tuple[float | None, ...]:
    """Supply pressures that tables and fixed settings are chosen from, Pa; None where it cannot be
    set."""
    return settings_Pa(board.data) if board.pressure else (None,)


def settings_Pa(rig: RigData) -> tuple[float, float, float]:
    """The rig's least and nominal supply pressure, and the middle between that and the greatest;
    the pump's power grows with its square."""
    supply = rig.supply
    return supply.min_Pa, supply.nominal_Pa, 0.5 * (supply.nominal_Pa + supply.max_Pa)


def _axes(rig: RigData, points: tuple[int, int]) -> tuple[Floats, Floats]:
    """Speeds, rad/s, and loads, N, of the table."""
    speeds = np.geomspace(rig.speed_min_rpm, rig.speed_max_rpm, points[0]) * np.pi / 30.0
    return speeds, np.geomspace(rig.load_min_N, rig.load_max_N, points[1])


def _best(
    limits: EpisodeLimits, clearances: Floats, power: Floats, film: Floats, swing: Floats
) -> int:
    """The setting of least power among those that keep the limits with margin, else the one of
    thickest film."""
    good = (film >= FILM_MARGIN * limits.min_film_m) & (
        swing <= SWING_MARGIN * limits.swing_share * clearances
    )
    return int(np.argmin(np.where(good, power, np.inf)) if good.any() else np.argmax(film))


@dataclass(frozen=True)
class Fed:
    """A policy of the clearance beside a supply pressure that stays as it is, Pa."""

    policy: SettingPolicy
    pressure_Pa: float

    def start(self, count: int) -> None:
        """As :class:`models.control.episodes.SettingPolicy`."""
        self.policy.start(count)

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`models.control.episodes.SettingPolicy`."""
        wish = self.policy(observation)
        return np.column_stack([wish, np.full(len(wish), self.pressure_Pa)])


class EccentricityPI:
    """Proportional-integral control of the measured eccentricity ratio towards a set point.

    Parameters
    ----------
    set_point
        Eccentricity over reported clearance.
    gain_m, integral_m_s
        Clearance per ratio, and per ratio and second: a wider bearing runs more eccentric.
    range_m
        The bearing's; the integral stops there.
    """

    def __init__(
        self, set_point: float, gain_m: float, integral_m_s: float, range_m: tuple[float, float]
    ) -> None:
        self._set_point, self._gain_m, self._integral_m_s = set_point, gain_m, integral_m_s
        self._range_m = range_m
        self._base_m: Floats = np.zeros(0)

    def start(self, count: int) -> None:
        """The integral begins at the narrow end."""
        self._base_m = np.full(count, self._range_m[0])

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`models.control.episodes.SettingPolicy`."""
        lack = self._wanted(observation) - _eccentricity_ratio(observation)
        clearance_m = observation[:, column("clearance_m")].astype(np.float64)
        # The integral never runs more than one second of its own ahead of where the bearing is.
        reach_m = np.abs(self._integral_m_s)
        base_m = self._base_m + self._integral_m_s * lack * CONTROL_S
        self._base_m = np.clip(
            np.clip(base_m, clearance_m - reach_m, clearance_m + reach_m), *self._range_m
        )
        return np.clip(self._base_m + self._gain_m * lack, *self._range_m)[:, None]

    def _wanted(self, observation: Observation) -> Floats:
        return np.full(len(observation), self._set_point)


class AdaptivePI(EccentricityPI):
    """The same with a set point that rises while the vibration leaves room, and falls fast when it
    does not.

    Parameters
    ----------
    rate_1_s
        How fast it rises.
    swing_share
        Peak-to-peak over clearance that it makes for.
    """

    def __init__(
        self,
        set_point: float,
        gain_m: float,
        integral_m_s: float,
        range_m: tuple[float, float],
        *,
        rate_1_s: float = 0.2,
        swing_share: float = 0.35,
    ) -> None:
        super().__init__(set_point, gain_m, integral_m_s, range_m)
        self._rate_1_s, self._swing_share = rate_1_s, swing_share
        self._wish: Floats = np.zeros(0)

    def start(self, count: int) -> None:
        """The set point begins where the plain controller holds it."""
        super().start(count)
        self._wish = np.full(count, self._set_point)

    def _wanted(self, observation: Observation) -> Floats:
        swing = np.maximum(
            observation[:, column("peak_to_peak_x_m")], observation[:, column("peak_to_peak_y_m")]
        )
        room = 1.0 - swing / observation[:, column("clearance_m")] / self._swing_share
        step = self._rate_1_s * CONTROL_S * np.where(room > 0, room, 5.0 * room)
        self._wish = np.clip(self._wish + step, 0.05, 0.85)
        return self._wish


def _eccentricity_ratio(observation: Observation) -> Floats:
    x, y = (observation[:, column(f"eccentricity_{axis}_m")].astype(np.float64) for axis in "xy")
    return np.asarray(np.hypot(x, y) / observation[:, column("clearance_m")])
