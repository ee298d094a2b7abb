"""What fixed clearances would have burnt: the recorded duty again, with the clearance held.

Same rig, build (unbalance included), seed, speed and load as recorded; only the clearance differs.
"Best feasible" is the cheapest fixed clearance whose film and orbit keep the limits throughout,
found on a grid.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Final

import numpy as np

from sim_hil.bound.limits import path_share
from sim_hil.demo.observer import StoryTruth
from sim_hil.demo.setting import Setting
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.runs import run
from sim_hil.processes import end_with_parent
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats

GRID_STEP_UM: Final = 5.0
SETTLE_S: Final = 1.0
"""Held at the first point before the comparison starts."""


@dataclass(frozen=True)
class FixedClearanceRun:
    """One fixed clearance over the whole run."""

    clearance_um: float
    mean_power_W: float
    feasible: bool


@dataclass(frozen=True)
class Counterfactual:
    """Watts of the nominal and of the best feasible fixed clearance."""

    nominal_fixed_W: float
    best_feasible_fixed_W: float | None
    best_um: float | None
    method: str


@dataclass(frozen=True)
class _Rerun:
    """Everything a worker needs to run the recorded stretch again."""

    rig: RigData
    build: Build
    seed: int
    duty: Duty
    min_film_m: float
    clearance_share: float

    def at(self, clearance_um: float) -> FixedClearanceRun:
        """Mean power and feasibility with the clearance held at ``clearance_um``."""
        clearance_m = clearance_um * 1e-6
        machine = SimulatedMachine(self.rig, self.build, self.seed, clearance_m=clearance_m)
        run(
            machine,
            Duty.hold(self.duty.speed_rpm[0], self.duty.load_N[0]),
            SETTLE_S,
            clearance=clearance_m,
        )
        truth = run(machine, self.duty, self.duty.seconds, clearance=clearance_m).truth
        return FixedClearanceRun(
            clearance_um, float(_column(truth, "shaft_power_W").mean()), self._feasible(truth)
        )

    def _feasible(self, truth: Floats) -> bool:
        film = float(_column(truth, "min_film_m").min())
        position_m = np.column_stack(
            [_column(truth, "eccentricity_x_m"), _column(truth, "eccentricity_y_m")]
        )
        share = path_share(position_m, _column(truth, "angle_rad"), _column(truth, "clearance_m"))
        return film >= self.min_film_m and float(share.max()) <= self.clearance_share


def rerun_fixed(truth: list[StoryTruth], setting: Setting, seed: int) -> Counterfactual:
    """Re-run the speed and load of ``truth`` at fixed clearances, on all cores."""
    config = setting.config
    duty = _recorded_duty(truth)
    limits = config.limits
    again = _Rerun(
        setting.rig, setting.build, seed, duty, limits.min_film_um * 1e-6, limits.clearance_share
    )
    bearing = config.machine.bearing
    nominal_um, low_um = bearing.radial_clearance_nominal_um, bearing.radial_clearance_min_um
    steps = int((bearing.radial_clearance_max_um - low_um) / GRID_STEP_UM)
    grid = sorted({nominal_um, *(low_um + GRID_STEP_UM * step for step in range(steps + 1))})
    with ProcessPoolExecutor(mp_context=get_context("spawn"), initializer=end_with_parent) as pool:
        results = list(pool.map(again.at, grid))
    nominal = next(fixed for fixed in results if fixed.clearance_um == nominal_um)
    best = min((f for f in results if f.feasible), key=lambda f: f.mean_power_W, default=None)
    return Counterfactual(
        round(nominal.mean_power_W, 2),
        round(best.mean_power_W, 2) if best else None,
        best.clearance_um if best else None,
        f"speed and load of the duty act again with the same build and seed at fixed clearances, "
        f"{GRID_STEP_UM:g} um grid; feasible: film and orbit (windows of 20 turns) within their "
        f"limits throughout",
    )


def _recorded_duty(truth: list[StoryTruth]) -> Duty:
    start_s = truth[0].t_s
    return Duty(
        tuple(each.t_s - start_s for each in truth),
        tuple(each.speed_rad_s * 30 / math.pi for each in truth),
        tuple(each.load_N for each in truth),
    )


def _column(truth: Floats, name: str) -> Floats:
    column: Floats = truth[:, TRUTH_COLUMNS.index(name)]
    return column
