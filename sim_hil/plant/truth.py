"""The rig's own record of the truth, one entry per tenth of a second."""

from __future__ import annotations

from collections import deque
from typing import Final

import msgspec
import numpy as np

from sim_hil.plant.machine import SimulatedMachine
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats

TRUTH_S: Final = 0.1
TRUTH_KEPT: Final = 36_000
"""Entries kept: one hour."""

_COLUMN: Final = {name: i for i, name in enumerate(TRUTH_COLUMNS)}


class RigTruth(msgspec.Struct, frozen=True):
    """What was true over a tenth of a second; ``t_ns`` is the host time of its end."""

    t_ns: int
    speed_rad_s: float
    load_N: float
    clearance_um: float
    target_clearance_um: float
    pressure_bar: float
    pump_power_W: float
    power_W: float
    min_film_um: float
    peak_to_peak_um: float
    viscosity_Pa_s: float
    oil_C: float
    unbalance_kg_m: float
    coasting: bool
    faults: dict[str, float]


def pump_power_W(rig: RigData, truth: Floats) -> Floats:
    """Power of the oil pump, ``p_s Q / efficiency``, for truth rows (n, 14): it feeds what runs off
    at the ends."""
    rows: Floats = truth[:, _COLUMN["pressure_Pa"]] * truth[:, _COLUMN["side_flow_m3_s"]]
    return rows / rig.supply.pump_efficiency


class TruthKeeper:
    """Collects truth rows into :class:`RigTruth` entries (the oldest are dropped after an hour)."""

    def __init__(self, machine: SimulatedMachine) -> None:
        self._machine = machine
        self._recent: list[Floats] = []
        self.entries: deque[RigTruth] = deque(maxlen=TRUTH_KEPT)

    def add(self, rows: Floats, now_ns: int, target_clearance_um: float, coasting: bool) -> None:
        """Truth rows of the last sampling periods."""
        self._recent.append(rows)
        if sum(map(len, self._recent)) * self._machine.period_s < TRUTH_S - 1e-9:
            return
        truth = np.concatenate(self._recent)
        self._recent.clear()
        mean, last = truth.mean(axis=0), truth[-1]
        swing = max(
            np.ptp(truth[:, _COLUMN["eccentricity_x_m"]]),
            np.ptp(truth[:, _COLUMN["eccentricity_y_m"]]),
        )
        self.entries.append(
            RigTruth(
                t_ns=now_ns,
                speed_rad_s=float(last[_COLUMN["speed_rad_s"]]),
                load_N=float(last[_COLUMN["load_N"]]),
                clearance_um=float(mean[_COLUMN["clearance_m"]]) * 1e6,
                target_clearance_um=target_clearance_um,
                pressure_bar=float(mean[_COLUMN["pressure_Pa"]]) * 1e-5,
                pump_power_W=float(pump_power_W(self._machine.rig, truth).mean()),
                power_W=float(mean[_COLUMN["shaft_power_W"]]),
                min_film_um=float(truth[:, _COLUMN["min_film_m"]].min()) * 1e6,
                peak_to_peak_um=float(swing) * 1e6,
                viscosity_Pa_s=float(mean[_COLUMN["viscosity_Pa_s"]]),
                oil_C=float(mean[_COLUMN["oil_C"]]),
                unbalance_kg_m=self._machine.unbalance_kg_m,
                coasting=coasting,
                faults=self._machine.faults,
            )
        )
