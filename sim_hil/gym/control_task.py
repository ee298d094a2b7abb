"""The control problem that the environments pose: what is seen, what is judged, what an episode
brings.

:mod:`sim_hil.gym.environment` poses it on one whole machine, :mod:`sim_hil.gym.vector_environment`
on many rotors alone; the same seed gives both the same episode.

Reward per step of :data:`CONTROL_S`: ``-P / P_ref - penalties`` with the mean power ``P`` (the
pump's counts where its pressure is an action), Petroff's power ``P_ref`` at nominal clearance and
present speed, and the :class:`EpisodeLimits` below.  A film under ``trip_film_m`` ends the episode.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from firmware_py.errors import OrbitdError
from sim_hil.plant.build import Build, unbalance_of_grade
from sim_hil.plant.duty import Duty
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats

CONTROL_S: Final = 0.1
SETTLE_STEPS: Final = 3
"""Control steps at the first operating point before an episode starts."""
WINDOW_S: Final = 0.4
"""Length of the orbit that the half-order share is taken from."""
_SUBSYNCHRONOUS_ORDERS: Final = (0.35, 0.6)

Observation = NDArray[np.float32]

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
"""Names and bounds of the observation, in order: only what a rig can measure, with the sensors'
errors."""


class ActionError(OrbitdError, ValueError):
    """An action that is not a finite number."""


@dataclass(frozen=True)
class EpisodeLimits:
    """Constraints and the weight of their violation in the reward (per step, at 100 % excess).

    Film and trip are those of rig `bench`, the swing that of the published duty.  The two of the
    oil count where the supply pressure is an action: the outlet may be as hot as the hottest film
    that the rig declares, up to which the guard's laws hold; the least flow, 0.05 L/min, is assumed
    (no reference file names one): what a flow switch in such a line tells from none.
    :meth:`of_rig` makes them for any rig.
    """

    min_film_m: float = 10e-6
    trip_film_m: float = 5e-6
    swing_share: float = 0.5
    max_outlet_C: float = 60.0
    min_flow_m3_s: float = 0.05e-3 / 60.0
    film_weight: float = 5.0
    swing_weight: float = 5.0
    oil_weight: float = 5.0
    trip_reward: float = -20.0

    @classmethod
    def of_rig(cls, rig: RigData) -> EpisodeLimits:
        """The smallest film that the device of ``rig`` is to keep, half of it as the trip, and the
        hottest film."""
        return cls(
            min_film_m=rig.min_film_m,
            trip_film_m=0.5 * rig.min_film_m,
            max_outlet_C=rig.oil.hottest_C,
        )


@dataclass(frozen=True)
class Disturbances:
    """What an episode may bring beside the spread of builds (``simulation.toml``); everything
    uniform in its range.

    Speed and load hold and ramp (:meth:`Duty.random`), no faster than the rig's may without being
    announced.  The oil inlet drifts from one temperature in ``inlet_C`` to another over the
    episode.  None: that of the rig.  In a share ``developing`` of the episodes one fault
    grows from nothing at a random instant to its end: unbalance to a grade in ``unbalance_G``, or
    radial wear to a length in ``wear_m``.
    """

    hold_s: tuple[float, float] = (3.0, 8.0)
    load_rate_N_s: float | None = None
    speed_rate_rpm_s: float | None = None
    inlet_C: tuple[float, float] | None = None
    developing: float = 0.2
    unbalance_G: tuple[float, float] = (6.3, 16.0)
    wear_m: tuple[float, float] = (0.0, 3e-6)

    def ramps(self, rig: RigData) -> tuple[float, float]:
        """Fastest ramps of load, N/s, and speed, rpm/s."""
        load, speed = self.load_rate_N_s, self.speed_rate_rpm_s
        return (
            rig.load_ramp_N_s if load is None else load,
            rig.speed_ramp_rpm_s if speed is None else speed,
        )


@dataclass(frozen=True)
class Growth:
    """A quantity that rises evenly from nothing at ``start_s`` by ``rate`` per second."""

    start_s: float = 0.0
    rate: float = 0.0

    def at(self, time_s: float) -> float:
        """Present size."""
        return self.rate * max(0.0, time_s - self.start_s)


@dataclass(frozen=True)
class Episode:
    """One machine with what happens to it."""

    build: Build
    duty: Duty
    clearance_m: float
    inlet_C: tuple[float, float]
    seconds: float
    power_error_W: float
    oil_error_C: float
    unbalance_kg_m: Growth = field(default_factory=Growth)
    wear_m: Growth = field(default_factory=Growth)

    @classmethod
    def draw(
        cls,
        rig: RigData,
        rng: np.random.Generator,
        seconds: float,
        disturbances: Disturbances,
        duty: Duty | None = None,
        build: Build | None = None,
    ) -> Episode:
        """An episode of the declared set; the start is a clearance from the smallest to the nominal
        one."""
        d, b, most = disturbances, rig.bearing, rig.errors
        ramps, inlet_C = disturbances.ramps(rig), disturbances.inlet_C or rig.oil.episodes_C
        build = build or Build.draw(rig, rng)
        duty = duty or Duty.random(
            rig,
            rng,
            seconds,
            hold_s=d.hold_s,
            load_rate_N_s=ramps[0],
            speed_rate_rpm_s=ramps[1],
        )
        growths = {"unbalance_kg_m": Growth(), "wear_m": Growth()}
        if rng.random() < d.developing:
            start_s, name = float(rng.uniform(0, seconds)), str(rng.choice(list(growths)))
            unbalance = (
                unbalance_of_grade(rig, float(rng.uniform(*d.unbalance_G))) - build.unbalance_kg_m
            )
            size = (
                max(0.0, unbalance) if name == "unbalance_kg_m" else float(rng.uniform(*d.wear_m))
            )
            growths[name] = Growth(start_s, size / (seconds - start_s))
        return cls(
            build=build,
            duty=duty,
            clearance_m=float(rng.uniform(b.clearance_min_m, b.clearance_nominal_m)),
            inlet_C=(float(rng.uniform(*inlet_C)), float(rng.uniform(*inlet_C))),
            seconds=seconds,
            power_error_W=float(rng.uniform(-most.shaft_power_W, most.shaft_power_W)),
            oil_error_C=float(rng.uniform(-most.oil_C, most.oil_C)),
            **growths,
        )

    def inlet_at(self, time_s: float) -> float:
        """Oil inlet temperature, Celsius."""
        return self.inlet_C[0] + (self.inlet_C[1] - self.inlet_C[0]) * min(
            1.0, time_s / self.seconds
        )


def spaces(pressure: bool) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Observation space, and action space: clearance, and supply pressure as a second one."""
    low, high = np.array(list(OBSERVATIONS.values()), dtype=np.float32).T
    actions = gymnasium.spaces.Box(-1.0, 1.0, (1 + pressure,), dtype=np.float32)
    return gymnasium.spaces.Box(low, high, dtype=np.float32), actions


def targets(rig: RigData, action: Observation) -> Floats:
    """Clearance, m, and supply pressure, Pa, of actions in [-1, 1] (cut there), shape (..., 1 or 2)
    to (..., 2).

    Raises
    ------
    ActionError
        An action that is not finite.
    """
    if not np.isfinite(action).all():
        raise ActionError(f"action = {action.tolist()}: not finite; give numbers in [-1, 1]")
    share = 0.5 * (np.clip(action, -1.0, 1.0).astype(np.float64) + 1.0)
    setpoints = np.empty((*share.shape[:-1], 2))
    setpoints[..., 0] = rig.bearing.clearance_min_m + share[..., 0] * (
        rig.bearing.clearance_max_m - rig.bearing.clearance_min_m
    )
    setpoints[..., 1] = rig.supply.nominal_Pa
    if share.shape[-1] == 2:
        setpoints[..., 1] = rig.supply.min_Pa + share[..., 1] * (
            rig.supply.max_Pa - rig.supply.min_Pa
        )
    return setpoints


def actions_of(rig: RigData, setpoints: Floats) -> Observation:
    """Actions in [-1, 1] that ask for clearances, m, and supply pressures, Pa: :func:`targets`
    undone.

    Shape (..., 1 or 2) in and out.
    """
    b, supply = rig.bearing, rig.supply
    low = np.array([b.clearance_min_m, supply.min_Pa])[: setpoints.shape[-1]]
    high = np.array([b.clearance_max_m, supply.max_Pa])[: setpoints.shape[-1]]
    actions: Observation = (2.0 * (setpoints - low) / (high - low) - 1.0).astype(np.float32)
    return actions


def judge(
    rig: RigData, limits: EpisodeLimits, true: Mapping[str, Floats], *, pressure: bool
) -> dict[str, Floats]:
    """True figures of a step, the penalty for violated limits, and the reward, each of the shape of
    its inputs.

    Parameters
    ----------
    true
        Means ``speed_rad_s``, ``load_N``, ``clearance_m``, ``shaft_power_W``, ``pump_power_W``, the
        smallest film ``min_film_m``, the larger ``peak_to_peak_m`` of the two axes, ``flow_m3_s``
        and ``outlet_C``.
    """
    b = rig.bearing
    petroff = (
        2
        * math.pi
        * rig.oil.viscosity_Pa_s
        * true["speed_rad_s"] ** 2
        * b.radius_m**3
        * b.length_m
        / b.clearance_nominal_m
    )
    power = true["shaft_power_W"] + (true["pump_power_W"] if pressure else 0.0)
    lack = np.maximum(0.0, 1 - true["min_film_m"] / limits.min_film_m)
    excess = np.maximum(
        0.0, true["peak_to_peak_m"] / (limits.swing_share * true["clearance_m"]) - 1
    )
    dry = np.maximum(0.0, pressure * (1 - true["flow_m3_s"] / limits.min_flow_m3_s))
    hot = np.maximum(0.0, pressure * (true["outlet_C"] / limits.max_outlet_C - 1))
    penalty = (
        limits.film_weight * lack + limits.swing_weight * excess + limits.oil_weight * (dry + hot)
    )
    tripped = true["min_film_m"] < limits.trip_film_m
    return {
        **true,
        "power_W": power,
        "power_share": power / petroff,
        "penalty": penalty,
        "violated": (lack > 0) | (excess > 0) | (dry > 0) | (hot > 0),
        "tripped": tripped,
        "reward": np.where(tripped, limits.trip_reward, -power / petroff - penalty),
    }


def shaft_xy(look: Floats, probes: Floats) -> Floats:
    """Probe signals, shape (..., 2), as x (right) and y (up); ``look`` are the probes' directions,
    a row each."""
    return np.asarray(probes @ np.linalg.inv(look).T)


def subsynchronous_share(orbit: Floats, rate_hz: float, speed_rad_s: Floats) -> Floats:
    """Share of the alternating energy of both axes between 0.35 and 0.6 orders, shapes (..., n, 2),
    (...) to (...)."""
    alternating = (orbit - orbit.mean(axis=-2, keepdims=True)) * np.hanning(orbit.shape[-2])[
        :, None
    ]
    energy = (np.abs(np.fft.rfft(alternating, axis=-2)) ** 2).sum(axis=-1)
    per_order = 2 * math.pi / np.maximum(speed_rad_s, 1.0)
    order = np.fft.rfftfreq(orbit.shape[-2], 1 / rate_hz) * np.asarray(per_order)[..., None]
    inside = (order >= _SUBSYNCHRONOUS_ORDERS[0]) & (order <= _SUBSYNCHRONOUS_ORDERS[1])
    share: Floats = (energy * inside).sum(axis=-1) / np.maximum(energy.sum(axis=-1), 1e-30)
    return share
