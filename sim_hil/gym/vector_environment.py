"""Many rotors at once for training: ``gymnasium.make_vec`` with the same name.

The task is that of :mod:`sim_hil.gym.environment` (:mod:`sim_hil.gym.control_task`), the plant is
less: the rotor of equation (2) alone on its film and coupling (:mod:`sim_hil.rotor.rigid`, steps of
0.2 ms), without pedestal, motor and what shakes them.  Actuator, oil temperature, build spread,
drifting inlet and growing faults are the same. The sensors are reduced to what the observation
shows: probes with gain, zero, runout and noise of the rig, status readings with their errors; no
filter delay, no quantisation, no housing motion. On the same episodes the mean power of both agrees
within 0.5 % and the smallest film within 0.5 um (tested).

An episode that ends starts anew in the same step (``AutoresetMode.SAME_STEP``): its last
observation stands in ``infos["final_obs"]``.  Rotor ``i`` sees the same for a given seed, whatever
stands beside it.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from firmware_py.records import CHANNELS
from sim_hil.faults.machine import worn_bore
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
    spaces,
    subsynchronous_share,
    targets,
)
from sim_hil.gym.fleet import (
    FIGURES,
    STEP_S,
    Numbers,
    advance_fleet,
    measure_orbits,
    records,
    static_loads,
)
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import assemble, rig_film
from sim_hil.rotor.film_law import Law
from sim_hil.rotor.parameters import (
    CLEARANCE,
    FLOW,
    N_SCALARS,
    OIL,
    PRESSURE,
    ActuatorParameters,
    FilmParameters,
    Floats,
    Shaft,
    new_state,
)
from sim_hil.rotor.rigid import COLUMNS

_PRESSURE_CHANNEL = CHANNELS.index("supply_pressure")
_PERIODS = round(CONTROL_S / STEP_S)
_SPECTRUM_EVERY = 4
"""The half-order share looks at every fourth instant of the orbit: 1250 Hz."""

Flags = NDArray[np.bool_]


class VectorRunError(RuntimeError):
    """A rotor left the finite numbers."""


class RotorVectorEnv(gymnasium.vector.VectorEnv[Observation, Observation, NDArray[Any]]):
    """``num_envs`` rotors; parameters as :class:`sim_hil.gym.environment.RotorEnv`.

    Parameters
    ----------
    law
        Another film than the tabulated one of the rig, which is fed from the groove where
        ``pressure`` is an action.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": [],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 8,
        rig: str | RigData = "bench",
        episode_s: float = 30.0,
        duty: Duty | None = None,
        build: Build | None = None,
        limits: EpisodeLimits | None = None,
        pressure: bool = False,
        disturbances: Disturbances | None = None,
        law: Law | None = None,
    ) -> None:
        self.num_envs, self.pressure = num_envs, pressure
        self.rig = rig if isinstance(rig, RigData) else load_rig(rig)
        self._look = self.rig.probes
        self._probe_noise_m = np.array([c.noise_rms for c in self.rig.channels[:2]])
        self.limits = limits or EpisodeLimits.of_rig(self.rig)
        self.disturbances = disturbances or Disturbances()
        self.single_observation_space, self.single_action_space = spaces(pressure)
        self.observation_space = gymnasium.vector.utils.batch_space(
            self.single_observation_space, num_envs
        )
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self._steps = round(episode_s / CONTROL_S)
        self._fixed_duty, self._fixed_build = duty, build
        n = num_envs
        self._resting = rig_film(self.rig, fed=False)
        self._law = rig_film(self.rig, fed=pressure) if law is None else law
        self._shaft, self._film, self._act = (
            records(kind._fields, n) for kind in (Shaft, FilmParameters, ActuatorParameters)
        )
        self._w, self._scalar = np.zeros((n, 8)), np.zeros((n, N_SCALARS))
        self._drive, self._target = np.zeros((n, _PERIODS + 1, 2)), np.zeros((n, _PERIODS, 2))
        self._out = np.zeros((n, _PERIODS, len(COLUMNS)))
        self._probe, self._pressure_gain = np.zeros((n, 2, 8)), np.ones(n)
        self._orbit, self._figures = np.zeros((n, _PERIODS, 2)), np.zeros((n, len(FIGURES)))
        self._history = np.zeros((n, round(WINDOW_S / STEP_S) // _SPECTRUM_EVERY, 2))
        self._step = np.zeros(n, np.intp)
        self._random = [np.random.default_rng() for _ in range(n)]
        self.episodes: list[Episode] = []

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw every episode anew; an integer seeds rotor ``i`` with ``seed + i``."""
        seeds = (
            seed
            if isinstance(seed, list)
            else [None if seed is None else seed + i for i in range(self.num_envs)]
        )
        for i, each in enumerate(seeds):
            if each is not None or not self.episodes:
                self._random[i] = seeding.np_random(each)[0]
        self.episodes = [self._draw(i) for i in range(self.num_envs)]
        return self._start(np.arange(self.num_envs)), {}

    def step(
        self, actions: Observation
    ) -> tuple[Observation, NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Advance all by :data:`CONTROL_S`; ``infos`` holds arrays of what ``RotorEnv.step`` tells
        of one."""
        everyone = np.arange(self.num_envs)
        self._target[:] = targets(self.rig, actions)[:, None, :]
        within = np.arange(_PERIODS + 1, dtype=np.float64) * STEP_S
        for i, episode in enumerate(self.episodes):
            now_s = float(self._step[i] * CONTROL_S)
            self._drive[i] = episode.duty.at(now_s + within)
            self._film["inlet_C"][i] = episode.inlet_at(now_s)
            wear = episode.wear_m.at(now_s)
            self._film["wear"][i] = episode.build.clearance_error_m + wear
            self._film["drop"][i] = worn_bore(wear, self.rig.bearing.clearance_nominal_m)[1]
            self._shaft["unbalance"][i] = episode.build.unbalance_kg_m + episode.unbalance_kg_m.at(
                now_s
            )
        self._advance(everyone)
        self._step += 1
        infos: dict[str, Any] = dict(self._judge())
        reward, terminated = infos.pop("reward"), infos.pop("tripped")
        truncated = self._step >= self._steps
        seen = self._observe(everyone)
        ended = np.flatnonzero(terminated | truncated)
        if ended.size:
            infos["final_obs"], infos["_final_obs"] = seen.copy(), terminated | truncated
            for i in ended.tolist():
                self.episodes[i] = self._draw(i)
            seen[ended] = self._start(ended)
        return seen, reward, terminated, truncated, infos

    def _draw(self, i: int) -> Episode:
        """Next episode of rotor ``i``, and its machine at rest."""
        rng = self._random[i]
        episode = Episode.draw(
            self.rig,
            rng,
            self._steps * CONTROL_S,
            self.disturbances,
            self._fixed_duty,
            self._fixed_build,
        )
        build = episode.build
        plant = assemble(self.rig, build, STEP_S, inlet_C=episode.inlet_C[0])
        for rows, part in (
            (self._shaft, plant.shaft),
            (self._film, plant.film),
            (self._act, plant.act),
        ):
            rows[i] = tuple(part)
        self._w[i] = 0.0
        angle, supply = float(rng.uniform(0, 2 * math.pi)), self.rig.supply.nominal_Pa
        self._scalar[i] = new_state(
            1, episode.clearance_m, supply, plant.film.inlet_C, angle
        ).scalar
        runout = build.runout_m * np.exp(1j * build.runout_phase_rad)
        self._probe[i] = np.column_stack([build.gain[:2], build.zero[:2], runout.real, runout.imag])
        self._pressure_gain[i] = build.gain[_PRESSURE_CHANNEL]
        self._history[i], self._step[i] = 0.0, 0
        return episode

    def _start(self, which: Numbers) -> Observation:
        """Let rotors settle at their first operating points."""
        for i in which.tolist():
            self._drive[i] = self.episodes[i].duty.point(0.0)
            self._target[i] = self.episodes[i].clearance_m, self.rig.supply.nominal_Pa
        for _ in range(SETTLE_STEPS):
            self._advance(which)
            seen = self._observe(which)
        return seen

    def _advance(self, which: Numbers) -> None:
        """Move and measure rotors for a control step."""
        advance_fleet(
            self._shaft,
            self._film,
            self._act,
            self._law,
            self._w,
            self._scalar,
            self._drive,
            self._target,
            which,
            self._out,
        )
        for i in which[~np.isfinite(self._w[which]).all(axis=1)]:
            time_s = self._step[i] * CONTROL_S
            raise VectorRunError(
                f"rotor {i}: no finite answer at {time_s:.1f} s of {self.episodes[i]}"
            )
        noise = np.stack([self._random[i].standard_normal((_PERIODS, 2)) for i in which])
        noise *= self._probe_noise_m
        measure_orbits(self._out, self._look, self._probe, noise, which, self._orbit, self._figures)

    def _figure(self, name: str) -> Floats:
        return self._figures[:, FIGURES.index(name)].copy()

    def _judge(self) -> dict[str, Floats]:
        """What the last step was worth (:func:`judge`)."""
        pumped = self._scalar[:, PRESSURE] * self._scalar[:, FLOW] / self.rig.supply.pump_efficiency
        true = {
            name: self._figure(name) for name in ("clearance_m", "shaft_power_W", "min_film_m")
        } | {
            "speed_rad_s": self._drive[:, :-1, 0].mean(axis=1),
            "load_N": self._drive[:, :-1, 1].mean(axis=1),
            "peak_to_peak_m": self._figure("true_swing_m"),
            "pump_power_W": pumped,
            "flow_m3_s": self._scalar[:, FLOW].copy(),
            "outlet_C": self._scalar[:, OIL].copy(),
        }
        return judge(self.rig, self.limits, true, pressure=self.pressure)

    def _observe(self, which: Numbers) -> Observation:
        """What the device would know of ``which`` after this step."""
        speed, scalar = self._drive[which, -1, 0], self._scalar[which]
        noise = np.array([self._random[i].standard_normal() for i in which])
        clearance = scalar[:, CLEARANCE] + self.rig.actuator.position_noise_rms_m * noise
        oil_C = scalar[:, OIL] + [self.episodes[i].oil_error_C for i in which]
        values = {name: self._figure(name)[which] for name in FIGURES[:4]} | {
            "speed_rad_s": speed,
            "clearance_m": clearance,
            "oil_outlet_C": oil_C,
            "supply_pressure_bar": 1e-5 * self._pressure_gain[which] * scalar[:, PRESSURE],
            "shaft_power_W": self._figure("shaft_power_W")[which]
            + [self.episodes[i].power_error_W for i in which],
            "load_estimate_N": self._load(which, speed, clearance, oil_C),
            "subsync_share": self._half_order(which, speed),
        }
        space = self.single_observation_space
        seen: Observation = np.clip(
            np.stack([values[name] for name in OBSERVATIONS], axis=1), space.low, space.high
        )
        return seen.astype(np.float32)

    def _load(self, which: Numbers, speed: Floats, clearance: Floats, oil_C: Floats) -> Floats:
        """Film force, N, where the journals seem to rest."""
        bearing, oil = self.rig.bearing, self.rig.oil
        mu = oil.viscosity_Pa_s * np.exp(-oil.slope_per_K * (oil_C - oil.reference_C))
        rest = self._figures[which, :2]
        load: Floats = static_loads(
            self._resting,
            rest,
            speed,
            clearance,
            mu,
            bearing.radius_m,
            bearing.length_m,
            self._scalar[which, PRESSURE],
        )
        return load

    def _half_order(self, which: Numbers, speed: Floats) -> Floats:
        """Share of the half order in the orbits of the last WINDOW_S."""
        newest = self._orbit[which, ::_SPECTRUM_EVERY]
        self._history[which] = np.concatenate([self._history[which], newest], axis=1)[
            :, newest.shape[1] :
        ]
        return subsynchronous_share(self._history[which], 1 / (STEP_S * _SPECTRUM_EVERY), speed)
