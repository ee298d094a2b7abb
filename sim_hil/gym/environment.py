"""Gymnasium environment ``orbitd/Rotor-v0``: choose the bearing clearance of a running machine.

Gymnasium imports what stands before the colon:
``gymnasium.make("sim_hil.gym.environment:orbitd/Rotor-v0")``.

The whole plant with its sensors is integrated in time with the table film.  One step is 0.1 s.  The
observation (:data:`OBSERVATIONS`) is what a rig can measure, from the quantised, noisy displacement
channels and the status readings.  Action: clearance target in [-1, 1], linear over the bearing's
range, which the actuator follows at its rate limit; with ``pressure=True`` a second one for the
supply pressure.  :mod:`sim_hil.gym.control_task` declares reward, limits and episodes;
``gymnasium.make_vec`` gives many rotors at once (:mod:`sim_hil.gym.vector_environment`).
"""

from __future__ import annotations

from typing import Any, Final

import gymnasium
import numpy as np

from sim_hil.faults.machine import WEAR_M
from sim_hil.gym.control_task import (
    CONTROL_S,
    OBSERVATIONS,
    SETTLE_STEPS,
    WINDOW_S,
    Disturbances,
    Episode,
    EpisodeLimits,
    Observation,
    judge,
    shaft_xy,
    spaces,
    subsynchronous_share,
    targets,
)
from sim_hil.plant.build import Build, unbalance_of_grade
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats
from sim_hil.sensors.chain import scales_of, units

__all__ = [
    "CONTROL_S",
    "ENVIRONMENT_ID",
    "OBSERVATIONS",
    "Disturbances",
    "EpisodeLimits",
    "RotorEnv",
    "register",
]

ENVIRONMENT_ID: Final = "orbitd/Rotor-v0"


class RotorEnv(gymnasium.Env[Observation, Observation]):
    """One machine with random build, duty and oil temperature per episode.

    Parameters
    ----------
    rig
        A shipped rig, a rig folder, or its figures.
    episode_s
        Length of an episode, s.
    duty, build
        Fixed ones instead of random.
    pressure
        The supply pressure is a second action, on the film that it feeds from the groove; the
        pump's power counts.
    """

    def __init__(
        self,
        rig: str | RigData = "bench",
        episode_s: float = 30.0,
        duty: Duty | None = None,
        build: Build | None = None,
        limits: EpisodeLimits | None = None,
        pressure: bool = False,
        disturbances: Disturbances | None = None,
    ) -> None:
        self.rig = rig if isinstance(rig, RigData) else load_rig(rig)
        self.limits = limits or EpisodeLimits.of_rig(self.rig)
        self.disturbances = disturbances or Disturbances()
        self.pressure = pressure
        self._steps = round(episode_s / CONTROL_S)
        self._fixed_duty, self._fixed_build = duty, build
        self.observation_space, self.action_space = spaces(pressure)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw an episode; the machine has settled at its first operating point."""
        super().reset(seed=seed)
        self.episode = Episode.draw(
            self.rig,
            self.np_random,
            self._steps * CONTROL_S,
            self.disturbances,
            self._fixed_duty,
            self._fixed_build,
        )
        e = self.episode
        self._machine = SimulatedMachine(
            self.rig,
            e.build,
            int(self.np_random.integers(2**31)),
            clearance_m=e.clearance_m,
            inlet_C=e.inlet_C[0],
            fed=self.pressure,
        )
        self._step = 0
        self._history = np.zeros((0, 2))
        start = Duty.hold(e.duty.speed_rpm[0], e.duty.load_N[0])
        for _ in range(SETTLE_STEPS):
            seen = self._observe(run(self._machine, start, CONTROL_S, clearance=e.clearance_m))
        return seen, {}

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by :data:`CONTROL_S`; ``info`` holds the true power, film, clearance and
        violations."""
        clearance, supply = targets(self.rig, action).tolist()
        now_s = self._step * CONTROL_S
        self._develop(now_s)
        batch = run(
            self._machine,
            self.episode.duty,
            CONTROL_S,
            clearance=clearance,
            pressure=supply,
            start_s=now_s,
        )
        self._step += 1
        info: dict[str, Any] = {name: value.item() for name, value in self._judge(batch).items()}
        reward, tripped = info.pop("reward"), info.pop("tripped")
        return self._observe(batch), reward, tripped, self._step >= self._steps, info

    def clearance_of(self, action: float) -> float:
        """Radial clearance in metres of an action in [-1, 1]."""
        return float(targets(self.rig, np.array([action], np.float32))[0])

    def _develop(self, now_s: float) -> None:
        """Oil inlet and growing faults of the episode at this time."""
        e, machine = self.episode, self._machine
        machine.set_inlet(e.inlet_at(now_s))
        unbalance, wear = e.unbalance_kg_m.at(now_s), e.wear_m.at(now_s)
        if unbalance > 0:
            machine.inject(
                "unbalance",
                (e.build.unbalance_kg_m + unbalance) / unbalance_of_grade(self.rig, 1.0),
            )
        if wear > 0:
            machine.inject("wear", wear / WEAR_M)

    def _judge(self, batch: Batch) -> dict[str, Floats]:
        """What the last step was worth (:func:`judge`)."""
        truth = {name: batch.truth[:, i] for i, name in enumerate(TRUTH_COLUMNS)}
        true = {
            name: truth[name].mean()
            for name in ("speed_rad_s", "load_N", "clearance_m", "shaft_power_W")
        }
        pumped = truth["pressure_Pa"] * truth["side_flow_m3_s"] / self.rig.supply.pump_efficiency
        swings = [np.ptp(truth[f"eccentricity_{axis}_m"]) for axis in "xy"]
        true |= {
            "pump_power_W": pumped.mean(),
            "min_film_m": truth["min_film_m"].min(),
            "peak_to_peak_m": max(swings),
        }
        true |= {"flow_m3_s": truth["side_flow_m3_s"].mean(), "outlet_C": truth["oil_C"][-1]}
        return judge(self.rig, self.limits, true, pressure=self.pressure)

    def _observe(self, batch: Batch) -> Observation:
        """What the device would know after this step."""
        noise = self.rig.actuator.position_noise_rms_m * self.np_random.standard_normal()
        speed = float(batch.truth[-1, TRUTH_COLUMNS.index("speed_rad_s")])
        clearance = (
            float(batch.truth[-1, TRUTH_COLUMNS.index("clearance_m")])
            - self._machine.wear_m
            + noise
        )
        oil_C = float(batch.truth[-1, TRUTH_COLUMNS.index("oil_C")]) + self.episode.oil_error_C
        power = (
            float(batch.truth[:, TRUTH_COLUMNS.index("shaft_power_W")].mean())
            + self.episode.power_error_W
        )
        measured = units(batch.counts, scales_of(self.rig))
        orbit = shaft_xy(self.rig.probes, measured[:, :2])
        self._history = np.concatenate([self._history, orbit])[
            -round(WINDOW_S * self._machine.rate_hz) :
        ]
        mean, swing = orbit.mean(axis=0), np.ptp(orbit, axis=0)
        load = self._machine.static_load(float(mean[0]), float(mean[1]), speed, clearance, oil_C)
        values = np.array(
            [
                speed,
                mean[0],
                mean[1],
                swing[0],
                swing[1],
                clearance,
                measured[:, 6].mean(),
                power,
                oil_C,
                load,
                float(subsynchronous_share(self._history, self._machine.rate_hz, np.array(speed))),
            ]
        )
        seen: Observation = np.clip(
            values, self.observation_space.low, self.observation_space.high
        ).astype(np.float32)
        return seen


def register() -> None:
    """Make :data:`ENVIRONMENT_ID` known to Gymnasium."""
    if ENVIRONMENT_ID not in gymnasium.registry:
        gymnasium.register(
            id=ENVIRONMENT_ID,
            entry_point="sim_hil.gym.environment:RotorEnv",
            vector_entry_point="sim_hil.gym.vector_environment:RotorVectorEnv",
        )


register()
