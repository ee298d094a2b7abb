"""The rig's environments behind the guard's own shield: clamped to its interval, safe where there
is none."""

from __future__ import annotations

from typing import Any, Final

import gymnasium
import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.config import Config
from firmware_py.guard.envelope.admissible import Envelope, EnvelopeInput, Known
from firmware_py.guard.envelope.retreat import Ramp
from models.control.commissioned import Commissioned
from sim_hil.gym.control_task import CONTROL_S, OBSERVATIONS, Episode, actions_of, targets
from sim_hil.gym.environment import RotorEnv
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.rigs import RigData

Observation = NDArray[np.float32]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

INTERVENTION_M: Final = 0.5e-6
"""The shield intervened when it moved the wish by more."""

ANNOUNCED_S: Final = 3.0
"""A ramp faster than the declared unannounced ones is told this long before it starts."""

_COLUMNS = {name: i for i, name in enumerate(OBSERVATIONS)}


_SEEN = (
    "eccentricity_x_m",
    "eccentricity_y_m",
    "peak_to_peak_x_m",
    "peak_to_peak_y_m",
    "clearance_m",
    "speed_rad_s",
    "oil_outlet_C",
    "shaft_power_W",
    "supply_pressure_bar",
)


def column(name: str) -> int:
    """Place of a named entry in an observation."""
    return _COLUMNS[name]


def config_of(rig: RigData, *, fed: bool) -> Config:
    """What the device of ``rig`` is told; where the film is fed from its groove, with what that
    adds to the load.

    Errors of the film are those of the unfed one under that load, as
    :mod:`sim_hil.film.groove_load` measures them; of its friction nothing is claimed.
    """
    config = rig.config
    if not fed:
        return config
    bearing = msgspec.structs.replace(
        config.machine.bearing,
        load_error_share=0.03,
        attitude_error_deg=2.7,
        friction_error_share=1.0,
    )
    feed = msgspec.structs.replace(
        config.machine.feed, groove_area_min_mm2=160.0, groove_area_max_mm2=320.0
    )
    return config.replaced(bearing=bearing, feed=feed)


def fast_ramps(config: Config, duty: Duty) -> list[Ramp]:
    """Ramps of ``duty`` that have to be announced, in seconds of the duty."""
    o, ramps = config.machine.operating, []
    speed_rate, load_rate = o.speed_ramp_unannounced_rpm_s, o.load_ramp_unannounced_N_s
    for i in range(1, len(duty.time_s)):
        seconds = duty.time_s[i] - duty.time_s[i - 1]
        load, speed = (abs(row[i] - row[i - 1]) for row in (duty.load_N, duty.speed_rpm))
        if load > load_rate * seconds + 1e-9 or speed > speed_rate * seconds + 1e-9:
            ramps.append(
                Ramp(
                    duty.time_s[i - 1],
                    duty.time_s[i],
                    duty.speed_rpm[i] * RAD_S_PER_RPM,
                    duty.load_N[i],
                )
            )
    return ramps


class ShieldAdapter:
    """The guard's envelope of one rotor, fed with observations.

    Parameters
    ----------
    config
        As the guard's.
    duty
        Its fast ramps are announced :data:`ANNOUNCED_S` ahead.
    commissioned
        What was measured of this machine, whose configuration then stands in the place of
        ``config``.
    """

    def __init__(
        self, config: Config, duty: Duty, commissioned: Commissioned | None = None
    ) -> None:
        config = commissioned.config if commissioned else config
        self._commissioned = commissioned
        self._envelope = Envelope(config)
        self._target_m: float | None = None
        self._safe_m = config.machine.actuator.safe_radial_clearance_um * 1e-6
        self._ramps = fast_ramps(config, duty)

    @classmethod
    def of(
        cls, config: Config, rig: RigData, episode: Episode, *, commissioned: bool
    ) -> ShieldAdapter:
        """That of an episode's machine."""
        return cls(
            config, episode.duty, Commissioned.of(config, rig, episode) if commissioned else None
        )

    def seen(self, observation: Observation) -> Observation:
        """What the device shows of ``observation``: with calibrated probes where the machine is
        commissioned."""
        return self._commissioned.corrected(observation) if self._commissioned else observation

    def interval(self, observation: Observation, time_s: float) -> tuple[float, float] | None:
        """What the guard would admit: its envelope, with every channel OK."""
        x, y, swing_x, swing_y, clearance, speed, oil, power, pressure = (
            float(observation[column(name)]) for name in _SEEN
        )
        clearance_um = clearance * 1e6
        target_um = clearance_um if self._target_m is None else self._target_m * 1e6
        seen = EnvelopeInput(
            (x, y),
            max(swing_x, swing_y),
            displacement_ok=True,
            whole=True,
            fast_rad_s=speed,
            slow_rad_s=speed,
            readings=Known(oil, clearance_um, pressure, power),
            oil_C=oil,
            narrow_um=min(clearance_um, target_um),
        )
        ahead = [
            Ramp(r.start_s - time_s, r.end_s - time_s, r.speed_rad_s, r.load_N)
            for r in self._ramps
            if r.start_s - ANNOUNCED_S <= time_s < r.end_s
        ]
        return self._envelope.step(seen, ahead, round(time_s * 1e9)).interval_m

    def admitted(self, observation: Observation, time_s: float, wish_m: float) -> float:
        """``wish_m`` within the interval, else the safe clearance."""
        interval = self.interval(observation, time_s)
        self._target_m = (
            self._safe_m if interval is None else min(max(wish_m, interval[0]), interval[1])
        )
        return self._target_m


class ShieldedRotors(gymnasium.vector.VectorWrapper[Observation, Observation, NDArray[Any]]):
    """The vectorised environment behind the shield; ``info["intervened"]`` tells whose wish it
    changed.

    Parameters
    ----------
    rotors
        The environment.
    shielded
        Whether the shield stands between wish and rotor.
    commissioned
        Whether each machine was commissioned, or is known by its drawing alone.
    """

    def __init__(
        self, rotors: RotorVectorEnv, *, shielded: bool = True, commissioned: bool = False
    ) -> None:
        super().__init__(rotors)
        self.rotors, self._commissioned = rotors, commissioned
        self._shielded, self._config = shielded, config_of(rotors.rig, fed=rotors.pressure)
        self._time_s = np.zeros(rotors.num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """As :meth:`RotorVectorEnv.reset`."""
        observation, info = self.rotors.reset(seed=seed, options=options)
        self._keepers = [self._keeper(i) for i in range(self.num_envs)]
        self._time_s[:] = 0.0
        self._observation = self._seen(observation)
        return self._observation, info

    def step(
        self, actions: Observation
    ) -> tuple[Observation, Floats, Flags, Flags, dict[str, Any]]:
        """As :meth:`RotorVectorEnv.step`, with what the shield lets through."""
        wish = targets(self.rotors.rig, actions)[:, : actions.shape[1]]
        wish_m = wish[:, 0].copy()
        target_m = wish[:, 0] = self._admitted(wish_m) if self._shielded else wish_m
        observation, reward, terminated, truncated, info = self.rotors.step(
            actions_of(self.rotors.rig, wish)
        )
        self._time_s += CONTROL_S
        ended = np.flatnonzero(terminated | truncated)
        if ended.size:
            info["final_obs"] = self._seen(info["final_obs"])
        for i in ended.tolist():
            self._keepers[i], self._time_s[i] = self._keeper(i), 0.0
        self._observation = self._seen(observation)
        info["intervened"] = np.abs(target_m - wish_m) > INTERVENTION_M
        return self._observation, reward, terminated, truncated, info

    def _keeper(self, i: int) -> ShieldAdapter:
        return ShieldAdapter.of(
            self._config, self.rotors.rig, self.rotors.episodes[i], commissioned=self._commissioned
        )

    def _seen(self, observation: Observation) -> Observation:
        return np.stack(
            [keeper.seen(row) for keeper, row in zip(self._keepers, observation, strict=True)]
        )

    def _admitted(self, wish_m: Floats) -> Floats:
        rows = zip(
            self._keepers, self._observation, self._time_s.tolist(), wish_m.tolist(), strict=True
        )
        return np.array(
            [keeper.admitted(seen, time_s, wish) for keeper, seen, time_s, wish in rows]
        )


class ShieldedRotor(gymnasium.Wrapper[Observation, Observation, Observation, Observation]):
    """``RotorEnv`` behind the shield, commissioned or not; ``info["intervened"]`` tells that it
    changed the wish."""

    def __init__(self, environment: RotorEnv, *, commissioned: bool = False) -> None:
        super().__init__(environment)
        self.rotor, self._commissioned = environment, commissioned
        self._config = config_of(environment.rig, fed=environment.pressure)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """As :meth:`RotorEnv.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._keeper = ShieldAdapter.of(
            self._config, self.rotor.rig, self.rotor.episode, commissioned=self._commissioned
        )
        self._observation, self._time_s = self._keeper.seen(observation), 0.0
        return self._observation, info

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """As :meth:`RotorEnv.step`, with what the shield lets through."""
        wish = targets(self.rotor.rig, action)[: action.size]
        wish_m = float(wish[0])
        target_m = wish[0] = self._keeper.admitted(self._observation, self._time_s, wish_m)
        executed = actions_of(self.rotor.rig, wish)
        observation, reward, terminated, truncated, info = self.env.step(executed)
        self._observation = self._keeper.seen(observation)
        self._time_s += CONTROL_S
        info["intervened"] = abs(target_m - wish_m) > INTERVENTION_M
        return self._observation, float(reward), terminated, truncated, info
