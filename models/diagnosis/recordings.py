"""Recordings of rigs in software: builds, faults, operating points and clearance loops drawn from a
seed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.clearance_loops import LOOPS, Loop, loop_of
from sim_hil.faults.machine import RUB_GAP_M
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import recording_of, run
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import RUB_CLEARANCE_M
from sim_hil.rotor.parameters import TRUTH_COLUMNS

Floats = NDArray[np.float64]

FAULT_OF_CLASS: Final = (
    "",
    "pedestal_bolt",
    "pedestal_two_bolts",
    "motor_bolt",
    "unbalance",
    "pedestal_and_motor_bolt",
)
"""The rig's fault for each class of :data:`models.diagnosis.dataset.CLASSES`."""

UNBALANCE_GRADES: Final = (6.3, 16.0, 40.0)
BOLT_PRELOADS: Final = (75.0, 50.0, 25.0, 0.0)
"""The severities that the task fixes: balance grade G, and percent of preload left."""

UNKNOWNS: Final = ("misalignment", "rub", "starvation", "wear", "pedestal_bolt_c")
"""Faults that are never taught; the last is a bolt that is no class."""

UNKNOWN_LABELS: Final = (*UNKNOWNS, "rub that the shaft has left")
"""What an unknown recording is called: a seal that the shaft no longer touches after it has moved
is apart."""

UNKNOWN_KIND: Final = -1
JUDGED_SECONDS: Final = 4.0
"""Long enough for one decision of ten windows at any speed."""

WATCH_SECONDS: Final = 10.0
"""Length of a healthy run on which false alarms are counted."""

COLDER_C: Final = 15.0
"""Of a tank in the morning, below the coldest inlet that a machine declares."""

DUTIES: Final = ("hold", "ramp", "run-up", "load step")
SLOW_SHARE: Final = 0.2
SETTLE_S: Final = 0.4
DRIFTING: Final = ("disp_x", "disp_y", "acc_bearing_vertical", "acc_motor", "supply_pressure")
DRIFT_MOST: Final = 0.3
"""Zero drift of a healthy machine's sensor: this share of 20 % of the range a minute."""
DRIFT_SHARE: Final = 0.3
DRIFTED_S: Final = 10.0
"""Share of the training recordings with a drifting sensor, and how long it may have drifted
before."""
TOUCH_BLOCK_S: Final = 0.1
MEMORY_S: Final = 0.1
"""A rub: how finely contact is looked for, and the time in which the rig's seal learns where the
shaft runs."""
_MICROSECONDS: Final = 1e6
_ECCENTRICITY: Final = [TRUTH_COLUMNS.index(f"eccentricity_{axis}_m") for axis in "xy"]


@dataclass(frozen=True)
class RecordingCase:
    """One recording to make: class, severity (of an unknown: index into :data:`UNKNOWN_LABELS`),
    the rig's faults."""

    kind: int
    severity: float
    faults: dict[str, float]


@dataclass(frozen=True)
class RecordingPlan:
    """What is recorded of every build: ``draw`` chooses the cases, each of ``seconds``."""

    rig: str
    seed: int
    rate_hz: int
    seconds: float
    draw: Callable[[np.random.Generator], list[RecordingCase]]


@dataclass(frozen=True)
class Raw:
    """One recording as the device would have received it, and what is true of it.

    ``counts`` int16 (n, 8); ``start_us`` tick of the first row; ``marks_us`` ticks of the
    once-per-turn edges; ``readings`` (m, 4): tick, clearance (m), shaft power (W), oil outlet
    (degC).  ``loop`` and ``duty`` index :data:`LOOPS` and :data:`DUTIES`.
    """

    counts: NDArray[np.int16]
    start_us: int
    marks_us: NDArray[np.int64]
    readings: Floats
    rate_hz: int
    kind: int
    severity: float
    loop: int
    duty: int


def training_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """Three healthy recordings and three faults a build, half preload and worse, grade G16 and
    worse.

    Some with a drifting sensor, which says nothing about the machine.
    """
    kinds = rng.permutation(np.arange(1, 6))[:3]
    cases = [
        _healthy(),
        _healthy(),
        _healthy(),
        *(_taught(int(k), rng, slice(1, None)) for k in kinds),
    ]
    return [_drifting(case, rng) if rng.random() < DRIFT_SHARE else case for case in cases]


def judged_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy recording and one of every fault, over the whole severity grid."""
    return [_healthy(), *(_taught(k, rng, slice(None)) for k in range(1, 6))]


def unknown_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy recording and one of every fault that was never taught, at full severity."""
    return [
        _healthy(),
        *(
            RecordingCase(UNKNOWN_KIND, k, {name: 0.0 if name == "pedestal_bolt_c" else 1.0})
            for k, name in enumerate(UNKNOWNS)
        ),
    ]


def watch_cases(rng: np.random.Generator) -> list[RecordingCase]:
    """One healthy run with the zero of one sensor drifting."""
    return [_drifting(_healthy(), rng)]


def record_build(plan: RecordingPlan, build_number: int) -> list[Raw]:
    """All recordings of one build; they follow from the plan and the number alone."""
    rng = np.random.default_rng([plan.seed, build_number])
    rig = load_rig(plan.rig)
    build = Build.draw(rig, rng)
    readings = [plan.seed, build_number, 1]
    return [_record(rig, build, case, plan, rng, readings) for case in plan.draw(rng)]


def _record(
    rig: RigData,
    build: Build,
    case: RecordingCase,
    plan: RecordingPlan,
    rng: np.random.Generator,
    reading_seed: list[int],
) -> Raw:
    """One recording; the errors of the readings are those of the build."""
    duty_kind, duty = _duty(rig, plan.seconds, rng)
    loop_kind = int(rng.integers(len(LOOPS)))
    pressure = float(rng.uniform(rig.supply.min_Pa, rig.supply.max_Pa))
    loop = loop_of(loop_kind, rig, plan.seconds, rng)
    seed = int(rng.integers(2**31))
    machine = SimulatedMachine(
        rig,
        build,
        seed,
        rate_hz=plan.rate_hz,
        inlet_C=float(rng.uniform(*_inlets_C(rig))),
        clearance_m=loop.start_m,
        pressure_Pa=pressure,
    )
    ran_m = _settle(machine, duty, loop, pressure, case)
    batch = loop.run(machine, duty, plan.seconds, pressure)
    severity = case.severity
    if "rub" in case.faults and not _touches(batch, ran_m, machine.period_s):
        severity = float(UNKNOWN_LABELS.index("rub that the shaft has left"))
    taken = recording_of(machine, batch, np.random.default_rng(reading_seed))
    readings = np.column_stack(
        [taken.status[:, 0] * _MICROSECONDS, taken.status[:, 3], taken.status[:, 1:3]]
    )
    return Raw(
        taken.counts,
        round(float(taken.time_s[0]) * _MICROSECONDS),
        np.round(taken.mark_s * _MICROSECONDS).astype(np.int64),
        readings,
        plan.rate_hz,
        case.kind,
        severity,
        loop_kind,
        duty_kind,
    )


def _inlets_C(rig: RigData) -> tuple[float, float]:
    """Inlet temperatures: from a cold tank to oil as hot as the machine's film may be."""
    oil = rig.config.machine.lubricant
    return oil.inlet_min_C - COLDER_C, oil.film_max_C


def _settle(
    machine: SimulatedMachine, duty: Duty, loop: Loop, pressure: float, case: RecordingCase
) -> Floats:
    """Run healthy, then as long with the faults; where the rig takes the shaft to have run healthy
    (2,), m."""
    start = Duty.hold(duty.speed_rpm[0], duty.load_N[0])
    healthy = run(machine, start, SETTLE_S, clearance=loop.start_m, pressure=pressure)
    for name, severity in case.faults.items():
        machine.inject(name, severity)
    run(machine, start, SETTLE_S, clearance=loop.start_m, pressure=pressure)
    remembered = 1.0 - math.exp(-SETTLE_S / MEMORY_S)
    return np.asarray(
        remembered * healthy.truth[len(healthy.truth) // 2 :, _ECCENTRICITY].mean(axis=0)
    )


def _touches(batch: Batch, ran_m: Floats, period_s: float) -> bool:
    """Whether the shaft touches the seal of a full rub in most of the blocks of a run."""
    away = batch.truth[:, _ECCENTRICITY] - ran_m
    reach = np.hypot(away[:, 0], away[:, 1] + RUB_CLEARANCE_M - RUB_GAP_M[1])
    block = round(TOUCH_BLOCK_S / period_s)
    deepest = reach[: len(reach) // block * block].reshape(-1, block).max(axis=1)
    return bool(np.mean(deepest > RUB_CLEARANCE_M) > 0.5)


def _healthy() -> RecordingCase:
    return RecordingCase(0, 100.0, {})


def _drifting(case: RecordingCase, rng: np.random.Generator) -> RecordingCase:
    """``case`` with the zero of one sensor drifting, since up to :data:`DRIFTED_S` before it."""
    name, a_minute = str(rng.choice(DRIFTING)), float(rng.uniform(0.0, DRIFT_MOST))
    before = float(rng.uniform(0.0, DRIFTED_S)) / 60.0
    drift = {f"sensor_drift:{name}": a_minute, f"sensor_offset:{name}": a_minute * before}
    return replace(case, faults=case.faults | drift)


def _taught(kind: int, rng: np.random.Generator, of_grid: slice) -> RecordingCase:
    name = FAULT_OF_CLASS[kind]
    grid = UNBALANCE_GRADES if name == "unbalance" else BOLT_PRELOADS
    severity = float(rng.choice(grid[of_grid]))
    return RecordingCase(kind, severity, {name: severity})


def _duty(rig: RigData, seconds: float, rng: np.random.Generator) -> tuple[int, Duty]:
    """Index into :data:`DUTIES` and the duty: half of all hold; run-ups as fast as the machine's
    speed changes unannounced, ramps a fifth of that."""
    low, high = rig.speed_min_rpm, rig.speed_max_rpm
    first, last = np.exp(rng.uniform(math.log(low), math.log(high), 2)).tolist()
    light, heavy = np.exp(
        rng.uniform(math.log(rig.load_min_N), math.log(rig.load_max_N), 2)
    ).tolist()
    kind = int(rng.choice(len(DUTIES), p=(0.5, 0.2, 0.15, 0.15)))
    if DUTIES[kind] == "hold":
        return kind, Duty.hold(first, light)
    if DUTIES[kind] == "load step":
        half = 0.5 * seconds
        return kind, Duty(
            (0.0, half, half + 0.05, seconds), (first,) * 4, (light, light, heavy, heavy)
        )
    fastest = rig.speed_ramp_rpm_s
    slow = SLOW_SHARE * fastest
    rate = slow if DUTIES[kind] == "ramp" else float(rng.uniform(slow, fastest))
    reach = rate * seconds
    end = (
        min(max(last, first - reach), first + reach)
        if DUTIES[kind] == "ramp"
        else min(first + reach, high)
    )
    return kind, Duty((0.0, seconds), (first, end), (light, heavy))
