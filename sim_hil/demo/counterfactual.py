"""What fixed clearances would have burnt: the recorded run again, with the clearance held.

Same rig, build, seed, speed, load and faults as the run; only the clearance differs.  "Best feasible" is
the cheapest fixed clearance whose film and orbit keep the limits through the whole run, found on a grid.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_py.config import Config
from sim_hil.build import Build
from sim_hil.demo.observer import Observer
from sim_hil.duty import Duty
from sim_hil.machine import Machine
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats
from sim_hil.simulate import run

GRID_STEP_UM: Final = 5.0
ORBIT_WINDOW_TURNS: Final = 20
TURNS_PER_SWING: Final = 4
"""Turns over which one swing is taken: two periods of half-order whirl."""

SETTLE_S: Final = 1.0
"""Left out at the start: the rig runs up."""


@dataclass(frozen=True)
class Fixed:
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
    """Everything a worker needs to run the recorded minutes again."""

    rig: RigData
    build: Build
    seed: int
    duty: Duty
    faults: tuple[tuple[float, str, float], ...]
    min_film_m: float
    clearance_share: float

    def at(self, clearance_um: float) -> Fixed:
        """Mean power and feasibility with the clearance held at ``clearance_um``."""
        clearance_m = clearance_um * 1e-6
        machine = Machine(self.rig, self.build, self.seed, clearance_m=clearance_m)
        pieces, start = [], 0.0
        for t_s, name, severity in (*self.faults, (self.duty.seconds, "", 0.0)):
            if t_s > start:
                pieces.append(run(machine, self.duty, t_s - start, clearance=clearance_m, start_s=start).truth)
                start = t_s
            if name:
                machine.inject(name, severity)
            else:
                machine.heal()
        truth = np.concatenate(pieces)[round(SETTLE_S / machine.period_s) :]
        return Fixed(clearance_um, float(_column(truth, "shaft_power_W").mean()), self._feasible(truth, clearance_m))

    def _feasible(self, truth: Floats, clearance_m: float) -> bool:
        film = float(_column(truth, "min_film_m").min())
        return film >= self.min_film_m and _largest_orbit_m(truth) <= self.clearance_share * clearance_m


def rerun_fixed(observer: Observer, rig: RigData, build: Build, seed: int, config: Config) -> Counterfactual:
    """Re-run the observed speed, load and faults at fixed clearances, on all cores."""
    again = _Rerun(
        rig,
        build,
        seed,
        _recorded_duty(observer),
        _recorded_faults(observer),
        config.limits.min_film_um * 1e-6,
        config.limits.clearance_share,
    )
    nominal_um = config.bearing.radial_clearance_nominal_um
    low, high = config.bearing.radial_clearance_min_um, config.bearing.radial_clearance_max_um
    grid = [low + GRID_STEP_UM * i for i in range(int((high - low) / GRID_STEP_UM) + 1)]
    with ProcessPoolExecutor() as pool:
        nominal = pool.submit(again.at, nominal_um).result() if nominal_um not in grid else None
        results = list(pool.map(again.at, grid))
    nominal = nominal or next(fixed for fixed in results if fixed.clearance_um == nominal_um)
    best = min((f for f in results if f.feasible), key=lambda f: f.mean_power_W, default=None)
    return Counterfactual(
        round(nominal.mean_power_W, 2),
        round(best.mean_power_W, 2) if best else None,
        best.clearance_um if best else None,
        f"the run's speed, load, faults, build and seed again at fixed clearances, {GRID_STEP_UM:g} um grid",
    )


def _recorded_duty(observer: Observer) -> Duty:
    return Duty(
        tuple(truth.t_s for truth in observer.truth),
        tuple(truth.speed_rad_s * 30 / math.pi for truth in observer.truth),
        tuple(truth.load_N for truth in observer.truth),
    )


def _recorded_faults(observer: Observer) -> tuple[tuple[float, str, float], ...]:
    return tuple(
        (t, beat.fault if beat.verb == "inject" else "", beat.severity)
        for t, beat in observer.beats
        if beat.verb in ("inject", "clear")
    )


def _column(truth: Floats, name: str) -> Floats:
    column: Floats = truth[:, TRUTH_COLUMNS.index(name)]
    return column


def _largest_orbit_m(truth: Floats) -> float:
    """Largest peak-to-peak of either axis over windows of :data:`ORBIT_WINDOW_TURNS` turns.

    The static position drifts with load and speed, so a window counts as the mean swing of its groups of
    :data:`TURNS_PER_SWING` turns.
    """
    turns = np.floor(_column(truth, "angle_rad") / (2 * np.pi)).astype(np.int64)
    starts = np.flatnonzero(np.diff(turns, prepend=turns[0] - 1))[::TURNS_PER_SWING]
    largest = 0.0
    for name in ("eccentricity_x_m", "eccentricity_y_m"):
        values = _column(truth, name)
        swing = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
        groups = ORBIT_WINDOW_TURNS // TURNS_PER_SWING
        kernel = np.ones(groups) / groups
        if len(swing) > groups + 2:
            largest = max(largest, float(np.convolve(swing[1:-1], kernel, "valid").max()))
    return largest
