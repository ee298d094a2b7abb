"""Fixed clearances through a duty: what each costs and where it is admissible, over time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import TypeVar

import numpy as np

from sim_hil.bound.limits import ORBIT_SHARE, SAMPLES_PER_TURN, Limits, Verdict, judge, orbit_share
from sim_hil.duty import Duty
from sim_hil.response import Schedule, Trajectory, simulate
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats

T = TypeVar("T")
BIN_S = 0.1
STEP_S = 100e-6
_SETTLE_S = 2.0


@dataclass(frozen=True)
class Case:
    """A rig on a duty with its limits; `thermal` lets the film warm the oil."""

    rig: RigData
    duty: Duty
    limits: Limits
    thermal: bool

    def run(self, clearance: Schedule) -> Trajectory:
        """The duty in time, after some settling at its start, sampled often enough for its orbits."""
        d = self.duty
        led = Duty((0.0, *(t + _SETTLE_S for t in d.time_s)), (d.speed_rpm[0], *d.speed_rpm), (d.load_N[0], *d.load_N))
        target = partial(_delayed, clearance) if callable(clearance) else clearance
        rate = SAMPLES_PER_TURN * max(d.speed_rpm) / 60
        run = simulate(self.rig, led, clearance=target, thermal=self.thermal, rate_hz=rate, dt_s=STEP_S)
        return run.last(d.seconds)

    def judged(self, clearance: Schedule) -> Verdict:
        """The verdict over that run."""
        return judge(self.run(clearance), self.limits)


def _delayed(clearance: Callable[[float], float], time_s: float) -> float:
    return clearance(max(0.0, time_s - _SETTLE_S))


@dataclass(frozen=True)
class Profile:
    """A fixed clearance over time bins: mean power, W, smallest film, m, largest orbit share, shape (bins,)."""

    power_W: Floats
    min_film_m: Floats
    orbit_share: Floats


def profile(case: Case, clearance_m: float) -> Profile:
    """Run one fixed clearance and gather it into bins."""
    run = case.run(clearance_m)
    each = round(BIN_S / float(run.time_s[1] - run.time_s[0]))
    starts = np.arange(0, run.time_s.size - each // 2, each)
    return Profile(
        np.add.reduceat(run.power_W, starts) / np.diff(np.append(starts, run.time_s.size)),
        np.minimum.reduceat(run.min_film_m, starts),
        np.maximum.reduceat(orbit_share(run), starts),
    )


@dataclass(frozen=True)
class Map:
    """Profiles over clearances on a 1 um grid: shape (clearances, bins); margins are above zero where admissible.

    `stage` numbers the stages of the duty, a ramp and the hold at its end, that the bins lie on; shape (bins,).
    """

    clearance_m: Floats
    stage: np.ndarray
    power_W: Floats
    film_margin_m: Floats
    orbit_margin: Floats

    @property
    def admissible(self) -> np.ndarray:
        """Where both limits hold."""
        return np.asarray((self.film_margin_m >= 0) & (self.orbit_margin >= 0))


def build_map(case: Case, spacing_um: int) -> Map:
    """Run a clearance every `spacing_um` on all cores, and interpolate to 1 um."""
    b = case.rig.bearing
    low, high = round(b.clearance_min_m * 1e6), round(b.clearance_max_m * 1e6)
    known = sorted({*range(low, high + 1, spacing_um), high})
    profiles = in_parallel(partial(profile, case), [c * 1e-6 for c in known])
    grid = np.arange(low, high + 1, dtype=np.float64)

    def spread(rows: list[Floats]) -> Floats:
        columns = np.stack(rows, axis=1)
        return np.stack([np.interp(grid, known, column) for column in columns], axis=1)

    bins = profiles[0].power_W.size
    return Map(
        grid * 1e-6,
        stages(case.duty, bins),
        spread([p.power_W for p in profiles]),
        spread([p.min_film_m for p in profiles]) - case.limits.min_film_m,
        ORBIT_SHARE - spread([p.orbit_share for p in profiles]),
    )


def stages(duty: Duty, bins: int) -> np.ndarray:
    """Stage of each bin: a new one starts with every ramp."""
    ramps = [
        before != after
        for before, after in pairwise(zip(duty.speed_rpm, duty.load_N, strict=True))
    ]  # fmt: skip
    piece = np.searchsorted(duty.time_s, (np.arange(bins) + 0.5) * BIN_S) - 1
    return np.asarray(np.cumsum(ramps)[np.clip(piece, 0, len(ramps) - 1)])


def in_parallel(work: Callable[[float], T], items: Iterable[float]) -> list[T]:
    """`work` over `items` on all cores."""
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        return list(pool.map(work, items))
