"""The rig's environment behind the guard's own shield, and policies that choose a clearance in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from firmware_py import config as configuration
from firmware_py.guard.load_estimate import LoadEstimator
from firmware_py.guard.shield import Shield
from sim_hil.environment import OBSERVATIONS, RotorEnv

Floats = NDArray[np.float64]
Observation = NDArray[np.float32]
Policy = Callable[[Observation], float]
"""Observation (SI) to the radial clearance wished for, m."""

_INDEX = {name: i for i, name in enumerate(OBSERVATIONS)}


def value(observation: Observation, name: str) -> float:
    """One named entry of an observation."""
    return float(observation[_INDEX[name]])


class ShieldedRotor(gymnasium.Wrapper[Observation, Observation, Observation, Observation]):
    """``RotorEnv`` whose action passes the guard's shield: clamped to its interval, safe where there is none.

    ``info["intervened"]`` tells that the shield changed the wish.
    """

    def __init__(self, environment: RotorEnv) -> None:
        super().__init__(environment)
        self.rotor = environment
        file = resources.files("firmware_py").joinpath(f"configs/{environment.rig.name}.toml")
        config, _ = configuration.load(Path(str(file)))
        self._shield, self._loads = Shield(config), LoadEstimator(config)
        self._safe_m = config.actuator.safe_radial_clearance_um * 1e-6
        self._observation = np.zeros(len(OBSERVATIONS), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """As :meth:`RotorEnv.reset`."""
        self._observation, info = self.env.reset(seed=seed, options=options)
        return self._observation, info

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """As :meth:`RotorEnv.step`, with what the shield lets through."""
        wish_m = self.rotor.clearance_of(float(np.clip(action[0], -1.0, 1.0)))
        target_m = self.admitted(wish_m)
        executed = np.array([self.action_of(target_m)], np.float32)
        self._observation, reward, terminated, truncated, info = self.env.step(executed)
        info["intervened"] = abs(target_m - wish_m) > 0.5e-6
        return self._observation, float(reward), terminated, truncated, info

    def action_of(self, clearance_m: float) -> float:
        """Action in [-1, 1] that asks for ``clearance_m``."""
        bearing = self.rotor.rig.bearing
        return 2.0 * (clearance_m - bearing.clearance_min_m) / (bearing.clearance_max_m - bearing.clearance_min_m) - 1.0

    def admitted(self, wish_m: float) -> float:
        """``wish_m`` within the shield's interval of the newest observation."""
        o = self._observation
        speed, clearance, oil = value(o, "speed_rad_s"), value(o, "clearance_m"), value(o, "oil_outlet_C")
        swing = max(value(o, "peak_to_peak_x_m"), value(o, "peak_to_peak_y_m"))
        x, y = value(o, "eccentricity_x_m"), value(o, "eccentricity_y_m")
        load = self._loads.estimate(x, y, clearance, speed, oil, swing)
        interval = self._shield.interval(speed, load.low_N, load.high_N, oil, swing)
        return self._safe_m if interval is None else min(max(wish_m, interval[0]), interval[1])


@dataclass(frozen=True)
class Score:
    """What a policy did over a set of episodes."""

    power_W: float
    violation_s: float
    violated_share: float
    min_film_um: float
    intervention_share: float
    travel_um_per_s: float
    episode_power_W: tuple[float, ...]


def episodes(policy: Policy, seeds: range, seconds: float, *, shielded: bool, rig: str = "bench") -> Score:
    """Mean figures of ``policy`` over the episodes of ``seeds``."""
    environment = ShieldedRotor(RotorEnv(rig, episode_s=seconds))
    rows: list[tuple[float, bool, float, bool, float]] = []
    means: list[float] = []
    for seed in seeds:
        observation, _ = environment.reset(seed=seed)
        first, before, done = len(rows), value(observation, "clearance_m"), False
        while not done:
            action = np.array([environment.action_of(policy(observation))], np.float32)
            inner: Any = environment if shielded else environment.env
            observation, _, terminated, truncated, info = inner.step(action)
            moved, before = abs(info["clearance_m"] - before), info["clearance_m"]
            rows.append((info["power_W"], info["violated"], info["min_film_m"], info.get("intervened", False), moved))
            done = terminated or truncated
        means.append(float(np.mean([row[0] for row in rows[first:]])))
    table = np.array(rows, dtype=np.float64)
    return Score(
        power_W=float(np.mean(means)),
        violation_s=0.1 * float(table[:, 1].sum()),
        violated_share=float(table[:, 1].mean()),
        min_film_um=1e6 * float(table[:, 2].min()),
        intervention_share=float(table[:, 3].mean()),
        travel_um_per_s=1e7 * float(table[:, 4].mean()),
        episode_power_W=tuple(means),
    )
