"""Who moves the clearance while a recording is made: nobody, a random actor, or the agent behind
its shield."""

from __future__ import annotations

import math
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_py import config as configuration
from firmware_py.acquire.windows import ChannelMap
from firmware_py.guard.envelope.load_estimate import LoadEstimator, Look
from firmware_py.guard.envelope.shield import Shield
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS

LOOPS: Final = ("fixed", "random actor", "agent")
STEP_S: Final = 0.1
"""The agent chooses this often."""

_POWER: Final = TRUTH_COLUMNS.index("shaft_power_W")


class Loop(Protocol):
    """Runs a machine through a duty with the clearance in somebody's hands."""

    start_m: float

    def run(
        self, machine: SimulatedMachine, duty: Duty, seconds: float, pressure_Pa: float
    ) -> Batch:
        """What the machine did."""


def loop_of(kind: int, rig: RigData, seconds: float, rng: np.random.Generator) -> Loop:
    """The loop ``LOOPS[kind]``; a random actor chooses another clearance every second."""
    steps = 1 + math.ceil(seconds)
    chosen = rng.uniform(rig.bearing.clearance_min_m, rig.bearing.clearance_max_m, steps)
    if LOOPS[kind] == "agent":
        return AgentLoop(rig, float(rng.uniform(0.5, 1.0)))
    return OpenLoop(chosen if LOOPS[kind] == "random actor" else np.repeat(chosen[:1], steps))


class OpenLoop:
    """A clearance for each second, m."""

    def __init__(self, chosen_m: NDArray[np.float64]) -> None:
        self._chosen_m = chosen_m
        self.start_m = float(chosen_m[0])

    def run(
        self, machine: SimulatedMachine, duty: Duty, seconds: float, pressure_Pa: float
    ) -> Batch:
        """As :class:`Loop`."""

        def clearance(time_s: float) -> float:
            return float(self._chosen_m[min(int(time_s), len(self._chosen_m) - 1)])

        return run(machine, duty, seconds, clearance=clearance, pressure=pressure_Pa)


class AgentLoop:
    """The guard's shield in the loop, wishing for a share of the widest clearance that it admits.

    The trained agents wish for nearly the widest one (see the card of the actor), so that share 1
    stands for them; smaller shares for agents to come.  Speed, shaft position, swing and readings
    are the measured ones.
    """

    def __init__(self, rig: RigData, wish: float) -> None:
        config, _ = configuration.load(configuration.SHIPPED / rig.name)
        self._shield, self._loads = Shield(config), LoadEstimator(config)
        self._channels, self._wish = ChannelMap.wire(), wish
        self.start_m = config.machine.actuator.safe_radial_clearance_um * 1e-6

    def run(
        self, machine: SimulatedMachine, duty: Duty, seconds: float, pressure_Pa: float
    ) -> Batch:
        """As :class:`Loop`."""
        batches, target_m = [], self.start_m
        for step in range(round(seconds / STEP_S)):
            now_s = step * STEP_S
            batches.append(
                run(machine, duty, STEP_S, clearance=target_m, pressure=pressure_Pa, start_s=now_s)
            )
            target_m = self._choose(
                machine, batches[-1], now_s + STEP_S, duty.point(now_s + STEP_S)[0]
            )
        return Batch(
            *(
                np.concatenate([getattr(b, name) for b in batches])
                for name in ("counts", "truth", "marks")
            )
        )

    def _choose(
        self, machine: SimulatedMachine, batch: Batch, now_s: float, speed_rad_s: float
    ) -> float:
        shaft = self._channels.to_si(batch.counts)[:, :2]
        (x, y), swing = shaft.mean(axis=0).tolist(), float(np.ptp(shaft, axis=0).max())
        seen, power_W = machine.readings(), float(batch.truth[:, _POWER].mean())
        load = self._loads.estimate(
            Look(now_s, x, y, swing, seen.clearance_m, speed_rad_s, seen.oil_C, power_W)
        )
        interval = self._shield.interval(
            speed_rad_s,
            load.low_N,
            load.film_N,
            seen.oil_C,
            swing,
            oil=self._loads.oil_range(seen.oil_C),
        )
        if interval is None:
            return self.start_m
        return interval[0] + self._wish * (interval[1] - interval[0])
