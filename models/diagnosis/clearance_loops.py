"""Who moves the clearance while a recording is made: nobody, a random actor, or the agent behind
its shield."""

from __future__ import annotations

import math
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.guard.envelope.admissible import Envelope, EnvelopeInput, Known
from firmware_py.records import CHANNELS
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS

LOOPS: Final = ("fixed", "random actor", "agent")
STEP_S: Final = 0.1
"""The agent chooses this often."""

_PRESSURE: Final = CHANNELS.index("supply_pressure")
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
        self._envelope = Envelope(rig.config)
        self._channels, self._wish = ChannelMap.wire(), wish
        self.start_m = rig.config.machine.actuator.safe_radial_clearance_um * 1e-6

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
            speed_rad_s = duty.point(now_s + STEP_S)[0]
            target_m = self._choose(machine, batches[-1], now_s + STEP_S, speed_rad_s, target_m)
        return Batch(
            *(
                np.concatenate([getattr(b, name) for b in batches])
                for name in ("counts", "truth", "marks")
            )
        )

    def _choose(
        self,
        machine: SimulatedMachine,
        batch: Batch,
        now_s: float,
        speed_rad_s: float,
        target_m: float,
    ) -> float:
        si = self._channels.to_si(batch.counts)
        (x, y), swing = si[:, :2].mean(axis=0).tolist(), float(np.ptp(si[:, :2], axis=0).max())
        reading, power_W = machine.readings(), float(batch.truth[:, _POWER].mean())
        clearance_um, pressure_bar = reading.clearance_m * 1e6, float(si[:, _PRESSURE].mean())
        seen = EnvelopeInput(
            (x, y),
            swing,
            displacement_ok=True,
            whole=True,
            fast_rad_s=speed_rad_s,
            slow_rad_s=speed_rad_s,
            readings=Known(reading.oil_C, clearance_um, pressure_bar, power_W),
            oil_C=reading.oil_C,
            narrow_um=min(clearance_um, target_m * 1e6),
        )
        interval = self._envelope.step(seen, (), round(now_s * 1e9)).interval_m
        if interval is None:
            return self.start_m
        return interval[0] + self._wish * (interval[1] - interval[0])
