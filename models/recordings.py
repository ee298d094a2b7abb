"""Recordings of rigs in software as labelled windows: builds, operating points and clearances drawn from a seed."""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES, features
from firmware_py.acquire.windows import iter_windows
from firmware_py.records import Quality
from models.dataset import Dataset, join
from sim_hil.build import Build
from sim_hil.duty import Duty
from sim_hil.rigs import RigData, load_rig
from sim_hil.runs import Recording, Schedule, record

FAULT_OF_CLASS: Final = (
    "",
    "pedestal_bolt",
    "pedestal_two_bolts",
    "motor_bolt",
    "unbalance",
    "pedestal_and_motor_bolt",
)
"""The rig's fault for each class of :data:`models.dataset.CLASSES`."""

UNBALANCE_GRADES: Final = (6.3, 16.0, 40.0)
BOLT_PRELOADS: Final = (75.0, 50.0, 25.0, 0.0)
"""The severities of classes.json."""

UNKNOWNS: Final = ("misalignment", "rub", "starvation", "wear")
"""Faults that are never taught."""

UNKNOWN_KIND: Final = -1
JUDGED_SECONDS = 4.0
"""Long enough for one decision of ten windows at any speed."""

RAW_POINTS = 800
_MICROSECONDS = 1e6

Case = tuple[int, float]
"""Class and severity (for :data:`UNKNOWN_KIND` the index into :data:`UNKNOWNS`)."""


@dataclass(frozen=True)
class Plan:
    """What is recorded of every build: ``draw`` chooses the cases, each of ``seconds``."""

    rig: str
    seed: int
    rate_hz: int
    seconds: float
    draw: Callable[[np.random.Generator], list[Case]]


@dataclass(frozen=True)
class Views:
    """The same recordings twice: order features of every window, and one raw window of 800 points each."""

    orders: Dataset
    raw: Dataset


def training_cases(rng: np.random.Generator) -> list[Case]:
    """Two healthy recordings and three faults a build, half preload and worse, grade G16 and worse."""
    kinds = rng.permutation(np.arange(1, 6))[:3]
    return [(0, 100.0), (0, 100.0), *((int(k), _severity(int(k), rng, slice(1, None))) for k in kinds)]


def judged_cases(rng: np.random.Generator) -> list[Case]:
    """One healthy recording and one of every fault, over the whole severity grid."""
    return [(0, 100.0), *((k, _severity(k, rng, slice(None))) for k in range(1, 6))]


def unknown_cases(rng: np.random.Generator) -> list[Case]:
    """One healthy recording and one of every fault that was never taught, at full severity."""
    return [(0, 100.0), *((UNKNOWN_KIND, float(k)) for k in range(len(UNKNOWNS)))]


def record_builds(plan: Plan, builds: range, workers: int, progress: Callable[[int], None]) -> Views:
    """Every recording that ``plan`` asks of ``builds``.

    The result follows from the plan alone, whatever the number of workers.
    """
    parts = []
    for done, part in enumerate(_parts(plan, builds, workers), 1):
        parts.append(part)
        progress(done)
    return _joined(parts)


def _joined(parts: list[Views]) -> Views:
    return Views(join([part.orders for part in parts]), join([part.raw for part in parts]))


def _parts(plan: Plan, builds: range, workers: int) -> Iterator[Views]:
    if workers == 1:
        yield from (_record_build(plan, build) for build in builds)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield from pool.map(_record_build, [plan] * len(builds), builds, chunksize=2)


def _record_build(plan: Plan, build_number: int) -> Views:
    rng = np.random.default_rng([plan.seed, build_number])
    rig = load_rig(plan.rig)
    build = Build.draw(rig, rng)
    parts = []
    for index, (kind, severity) in enumerate(plan.draw(rng)):
        recording = _record(rig, build, kind, severity, plan, rng)
        rows = windows_of(recording)
        number = 100 * build_number + index
        raw = recording.counts[-RAW_POINTS:].reshape(1, -1)
        parts.append(
            Views(*(_labelled(x, kind, severity, build_number, number) for x in (rows, raw.astype(np.float32))))
        )
    return _joined(parts)


def _labelled(rows: NDArray[np.floating], kind: int, severity: float, build: int, number: int) -> Dataset:
    n = len(rows)
    labels = (np.full(n, kind), np.full(n, severity), np.full(n, build), np.full(n, number))
    return Dataset(rows, *labels)


def _record(rig: RigData, build: Build, kind: int, severity: float, plan: Plan, rng: np.random.Generator) -> Recording:
    name, level = (UNKNOWNS[int(severity)], 1.0) if kind == UNKNOWN_KIND else (FAULT_OF_CLASS[kind], severity)
    return record(
        rig, build, _duty(rig, plan.seconds, rng), plan.seconds, clearance=_clearance(rig, plan.seconds, rng),
        pressure=float(rng.uniform(rig.supply.min_Pa, rig.supply.max_Pa)), faults={name: level} if name else {},
        rate_hz=plan.rate_hz, inlet_C=float(rng.uniform(20.0, 60.0)), seed=int(rng.integers(2**31)),
    )  # fmt: skip


def windows_of(recording: Recording) -> NDArray[np.float64]:
    """Features ``(n, F)`` of every usable window of ``recording``, by the device's own code."""
    status = recording.status
    readings = np.column_stack([status[:, 0] * _MICROSECONDS, status[:, 3], status[:, 1], status[:, 2]])
    start_us = round(float(recording.time_s[0]) * _MICROSECONDS)
    marks_us = np.round(recording.mark_s * _MICROSECONDS).astype(np.int64)
    windows = iter_windows(recording.counts, start_us, marks_us, recording.rate_hz, readings=readings)
    rows = [features(window) for window in windows if not window.quality & Quality.NO_MARK]
    return np.array(rows, np.float64).reshape(-1, len(FEATURE_NAMES))


def _severity(kind: int, rng: np.random.Generator, of_grid: slice) -> float:
    grid = UNBALANCE_GRADES if FAULT_OF_CLASS[kind] == "unbalance" else BOLT_PRELOADS
    return float(rng.choice(grid[of_grid]))


def _duty(rig: RigData, seconds: float, rng: np.random.Generator) -> Duty:
    """A hold, or (one in three) a ramp of speed and load over the whole recording."""
    speeds = np.exp(rng.uniform(math.log(rig.speed_min_rpm), math.log(rig.speed_max_rpm), 2))
    loads = np.exp(rng.uniform(math.log(rig.load_min_N), math.log(rig.load_max_N), 2))
    if rng.random() < 2.0 / 3.0:
        return Duty.hold(float(speeds[0]), float(loads[0]))
    step = np.clip(speeds[1] - speeds[0], -400.0 * seconds, 400.0 * seconds)
    return Duty((0.0, seconds), (float(speeds[0]), float(speeds[0] + step)), (float(loads[0]), float(loads[1])))


def _clearance(rig: RigData, seconds: float, rng: np.random.Generator) -> Schedule:
    """A fixed clearance, or (one in three) a random actor that chooses another every second."""
    chosen = rng.uniform(rig.bearing.clearance_min_m, rig.bearing.clearance_max_m, 1 + math.ceil(seconds))
    if rng.random() < 2.0 / 3.0:
        return float(chosen[0])
    return lambda time_s: float(chosen[min(int(time_s), len(chosen) - 1)])
