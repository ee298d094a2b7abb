"""Gymnasium environment ``orbitd/Rotor-v0``: choose the bearing clearance of a running machine.

The whole plant is integrated in time with the table film (no quasi-static map).  One step is 0.1 s.

Observation (:data:`OBSERVATIONS`, SI where the name says no other unit): only what a rig can measure, from
the quantised, noisy displacement channels and the status readings.  Action: clearance target in [-1, 1],
linear over the bearing's range; the actuator follows at its rate limit.

Reward per step: ``-P / P_ref - penalties`` with the mean shaft power ``P``, Petroff's power ``P_ref`` at
nominal clearance and present speed, and the :class:`Limits` below.  A film under ``trip_film_m`` ends the
episode.

Randomised per episode (declared here): the build (``classes.json``), the duty (:meth:`Duty.random`), the oil
inlet temperature (35 to 45 degC), the starting clearance (smallest to nominal, where a machine starts).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from sim_hil.build import Build
from sim_hil.duty import Duty
from sim_hil.machine import Batch, Machine
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats
from sim_hil.runs import CLEARANCE_NOISE_M, OIL_ERROR_C, POWER_ERROR_W, run
from sim_hil.sensors.chain import units

ENVIRONMENT_ID: Final = "orbitd/Rotor-v0"
CONTROL_S: Final = 0.1
INLET_C: Final = (35.0, 45.0)
SETTLE_S: Final = 0.3
_WINDOW_S: Final = 0.4
_SUBSYNCHRONOUS_ORDERS: Final = (0.35, 0.6)

OBSERVATIONS: Final = {
    "speed_rad_s": (0.0, 1400.0),
    "eccentricity_x_m": (-2e-4, 2e-4),
    "eccentricity_y_m": (-2e-4, 2e-4),
    "peak_to_peak_x_m": (0.0, 4e-4),
    "peak_to_peak_y_m": (0.0, 4e-4),
    "clearance_m": (0.0, 2e-4),
    "supply_pressure_bar": (0.0, 10.0),
    "shaft_power_W": (-50.0, 2000.0),
    "oil_outlet_C": (0.0, 120.0),
    "load_estimate_N": (0.0, 2000.0),
    "subsync_share": (0.0, 1.0),
}
"""Names and bounds of the observation, in order."""


@dataclass(frozen=True)
class Limits:
    """Constraints and the weight of their violation in the reward (per step, at 100 % excess)."""

    min_film_m: float = 10e-6
    trip_film_m: float = 5e-6
    swing_share: float = 0.5
    film_weight: float = 5.0
    swing_weight: float = 5.0
    trip_reward: float = -20.0


class RotorEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One machine with random build, duty and oil temperature per episode.

    Parameters
    ----------
    rig
        ``bench`` or ``seed``.
    episode_s
        Length of an episode, s.
    duty, build
        Fixed ones instead of random.
    """

    def __init__(
        self, rig: str = "bench", episode_s: float = 30.0, duty: Duty | None = None, build: Build | None = None,
        limits: Limits | None = None,
    ) -> None:
        self.rig: RigData = load_rig(rig)
        self.limits = limits or Limits()
        self._steps = round(episode_s / CONTROL_S)
        self._fixed_duty, self._fixed_build = duty, build
        low, high = np.array(list(OBSERVATIONS.values()), dtype=np.float32).T
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw an episode; the machine has settled at its first operating point."""
        super().reset(seed=seed)
        rng, rig = self.np_random, self.rig
        build = self._fixed_build or Build.draw(rig, rng)
        self._duty = self._fixed_duty or Duty.random(rig, rng, self._steps * CONTROL_S)
        clearance = float(rng.uniform(rig.bearing.clearance_min_m, rig.bearing.clearance_nominal_m))
        self._machine = Machine(
            rig, build, int(rng.integers(2**31)), clearance_m=clearance, inlet_C=float(rng.uniform(*INLET_C))
        )
        self._power_error_W = float(rng.uniform(-POWER_ERROR_W, POWER_ERROR_W))
        self._oil_error_C = float(rng.uniform(-OIL_ERROR_C, OIL_ERROR_C))
        self._step = 0
        self._history = np.zeros((0, 2))
        start = Duty.hold(self._duty.speed_rpm[0], self._duty.load_N[0])
        batch = run(self._machine, start, SETTLE_S, clearance=clearance)
        return self._observe(batch), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by :data:`CONTROL_S`; ``info`` holds the true power, film, clearance and violations."""
        target = self.clearance_of(float(np.clip(action[0], -1.0, 1.0)))
        batch = run(self._machine, self._duty, CONTROL_S, clearance=target, start_s=self._step * CONTROL_S)
        self._step += 1
        info = self._judge(batch)
        tripped = info["min_film_m"] < self.limits.trip_film_m
        reward = self.limits.trip_reward if tripped else -info["power_share"] - info["penalty"]
        return self._observe(batch), float(reward), tripped, self._step >= self._steps, info

    def clearance_of(self, action: float) -> float:
        """Radial clearance in metres of an action in [-1, 1]."""
        low, high = self.rig.bearing.clearance_min_m, self.rig.bearing.clearance_max_m
        return low + 0.5 * (action + 1) * (high - low)

    def _judge(self, batch: Batch) -> dict[str, Any]:
        """True figures of the last step and the penalty for violated limits."""
        truth = {name: batch.truth[:, i] for i, name in enumerate(TRUTH_COLUMNS)}
        limits, bearing = self.limits, self.rig.bearing
        speed, clearance = float(truth["speed_rad_s"].mean()), float(truth["clearance_m"].mean())
        petroff = (
            2 * math.pi * self.rig.oil.viscosity_Pa_s * speed**2 * bearing.radius_m**3 * bearing.length_m
            / bearing.clearance_nominal_m
        )  # fmt: skip
        power, film = float(truth["shaft_power_W"].mean()), float(truth["min_film_m"].min())
        swing = float(max(np.ptp(truth["eccentricity_x_m"]), np.ptp(truth["eccentricity_y_m"])))
        lack = max(0.0, 1 - film / limits.min_film_m)
        excess = max(0.0, swing / (limits.swing_share * clearance) - 1)
        return {
            "power_W": power, "power_share": power / petroff, "min_film_m": film, "clearance_m": clearance,
            "peak_to_peak_m": swing, "load_N": float(truth["load_N"].mean()), "speed_rad_s": speed,
            "penalty": limits.film_weight * lack + limits.swing_weight * excess,
            "violated": lack > 0 or excess > 0,
        }  # fmt: skip

    def _observe(self, batch: Batch) -> NDArray[np.float32]:
        """What the device would know after this step."""
        noise = CLEARANCE_NOISE_M * self.np_random.standard_normal()
        speed = float(batch.truth[-1, TRUTH_COLUMNS.index("speed_rad_s")])
        clearance = float(batch.truth[-1, TRUTH_COLUMNS.index("clearance_m")]) - self._machine.wear_m + noise
        oil_C = float(batch.truth[-1, TRUTH_COLUMNS.index("oil_C")]) + self._oil_error_C
        power = float(batch.truth[:, TRUTH_COLUMNS.index("shaft_power_W")].mean()) + self._power_error_W
        measured = units(batch.counts)
        orbit = shaft_xy(measured[:, :2])
        self._history = np.concatenate([self._history, orbit])[-round(_WINDOW_S * self._machine.rate_hz) :]
        mean, swing = orbit.mean(axis=0), np.ptp(orbit, axis=0)
        load = self._machine.static_load(float(mean[0]), float(mean[1]), speed, clearance, oil_C)
        values = np.array([
            speed, mean[0], mean[1], swing[0], swing[1], clearance, measured[:, 6].mean(), power, oil_C, load,
            subsynchronous_share(self._history, self._machine.rate_hz, speed),
        ])  # fmt: skip
        low, high = self.observation_space.low, self.observation_space.high
        clipped: NDArray[np.float32] = np.clip(values, low, high).astype(np.float32)
        return clipped


def shaft_xy(probes: Floats) -> Floats:
    """Probe signals at 45 and 135 degrees, shape (n, 2), as x (right) and y (up)."""
    return np.column_stack([probes[:, 0] - probes[:, 1], probes[:, 0] + probes[:, 1]]) * math.sqrt(0.5)


def subsynchronous_share(orbit: Floats, rate_hz: float, speed_rad_s: float) -> float:
    """Share of the alternating energy of both axes between 0.35 and 0.6 orders."""
    alternating = (orbit - orbit.mean(axis=0)) * np.hanning(len(orbit))[:, None]
    energy = (np.abs(np.fft.rfft(alternating, axis=0)) ** 2).sum(axis=1)
    order = np.fft.rfftfreq(len(orbit), 1 / rate_hz) * 2 * math.pi / max(speed_rad_s, 1.0)
    inside = (order >= _SUBSYNCHRONOUS_ORDERS[0]) & (order <= _SUBSYNCHRONOUS_ORDERS[1])
    return float(energy[inside].sum() / max(energy.sum(), 1e-30))


def register() -> None:
    """Make :data:`ENVIRONMENT_ID` known to Gymnasium."""
    if ENVIRONMENT_ID not in gymnasium.registry:
        gymnasium.register(id=ENVIRONMENT_ID, entry_point="sim_hil.environment:RotorEnv")


register()
