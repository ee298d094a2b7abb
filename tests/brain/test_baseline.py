"""The first order's baseline on the rig in software: it stays where the machine was healthy,
whatever a fault does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from firmware_py import config
from firmware_py.acquire.recorded_windows import iter_windows
from firmware_py.acquire.windows import Window
from firmware_py.brain.baseline import (
    FIRST_WINDOWS,
    HINDSIGHT_NS,
    REFERENCES_MAX,
    FirstOrderBaseline,
)
from firmware_py.brain.diagnosis import Diagnoser
from firmware_py.brain.store import load_models
from firmware_py.records import Diagnosis
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.runs import recording_of, run
from sim_hil.rigs import load_rig

BENCH = config.load(config.SHIPPED / "bench")[0]
MACHINE = BENCH.machine
RIG = load_rig("bench")
CLEARANCE_M = 60e-6
SECOND = 1_000_000_000

Step = tuple[float, dict[str, float], float, float]
"""Seconds, faults, speed at the start and at the end (rpm)."""


def steady(seconds: float, unbalance: float | None = None) -> Step:
    return seconds, {} if unbalance is None else {"unbalance": unbalance}, 6000.0, 6000.0


def windows(steps: list[Step], seed: int = 3) -> list[Window]:
    machine = SimulatedMachine(
        RIG, Build.of_seed(RIG, seed), seed, rate_hz=5000, clearance_m=CLEARANCE_M
    )
    run(machine, Duty.hold(steps[0][2], 100.0), 0.5, clearance=CLEARANCE_M)
    batches = []
    for seconds, faults, first_rpm, last_rpm in steps:
        machine.heal()
        for name, severity in faults.items():
            machine.inject(name, severity)
        duty = Duty((0.0, seconds), (first_rpm, last_rpm), (100.0, 100.0))
        batches.append(run(machine, duty, seconds, clearance=CLEARANCE_M))
    whole = Batch(
        *(
            np.concatenate([getattr(b, name) for b in batches])
            for name in ("counts", "truth", "marks")
        )
    )
    made = recording_of(machine, whole, np.random.default_rng(1))
    readings = np.column_stack(
        [made.status[:, 0] * 1e6, made.status[:, 3], made.status[:, 1], made.status[:, 2]]
    )
    cut = iter_windows(
        made.counts, 0, np.round(made.mark_s * 1e6).astype(np.int64), 5000, readings=readings
    )
    return [replace(w, end_ns=w.end_tick_us * 1000) for w in cut]


def diagnoses(steps: list[Step], seed: int = 3) -> list[Diagnosis]:
    diagnoser = Diagnoser(load_models(BENCH).classifier, MACHINE)
    return [diagnoser.step(window)[0] for window in windows(steps, seed)]


def first_order_um(diagnosis: Diagnosis) -> complex:
    why = diagnosis.evidence
    return complex(
        why["shaft_1x_compensated_um"] * np.exp(1j * np.radians(why["shaft_1x_phase_deg"]))
    )


def between(told: list[Diagnosis], start_s: float, end_s: float) -> list[Diagnosis]:
    return [d for d in told if start_s * SECOND <= d.t_acq_ns < end_s * SECOND]


def healthy_um(told: list[Diagnosis], end_s: float) -> complex:
    return complex(np.mean([first_order_um(d) for d in between(told, 3.0, end_s)]))


def assert_moves_are_true(told: list[Diagnosis], base_um: complex, share: float = 0.1) -> None:
    assert told, "nothing was told"
    for diagnosis in told:
        true_um = abs(first_order_um(diagnosis) - base_um)
        assert diagnosis.evidence["shaft_1x_move_um"] == pytest.approx(true_um, rel=share, abs=0.1)


@pytest.mark.parametrize("grade", [16.0, 40.0])
def test_a_sudden_unbalance_is_told_with_its_true_displacement(grade: float) -> None:
    told = diagnoses([steady(16.0), steady(9.0, grade)])
    named = [d for d in between(told, 16.0, 25.0) if d.verdict == "unbalance"]
    assert_moves_are_true(named, healthy_um(told, 15.0))
    assert named[-1].evidence["shaft_1x_move_um"] > 1.0


def test_a_growing_unbalance_stands_out_from_where_it_began() -> None:
    growing = [steady(3.0, grade) for grade in np.linspace(2.0, 40.0, 12)]
    told = diagnoses([steady(16.0), *growing])
    base_um = healthy_um(told, 15.0)
    assert_moves_are_true([d for d in told if d.verdict == "unbalance"], base_um)
    assert_moves_are_true(told[-4:], base_um)


def test_a_fault_that_comes_and_goes_does_not_become_normal() -> None:
    told = diagnoses(
        [
            steady(16.0),
            *[step for _ in range(4) for step in (steady(1.5, 40.0), steady(1.5))],
            steady(8.0, 40.0),
        ]
    )
    assert_moves_are_true(
        [d for d in between(told, 28.0, 40.0) if d.verdict == "unbalance"], healthy_um(told, 15.0)
    )


def test_a_fault_that_was_there_at_the_start_has_no_baseline() -> None:
    told = diagnoses([steady(12.0, 40.0)])
    assert told[-1].verdict == "unbalance"
    assert all("shaft_1x_move_um" not in d.evidence for d in told)


def test_a_change_of_speed_is_no_displacement() -> None:
    ramp: Step = (3.0, {}, 6000.0, 9000.0)
    told = diagnoses(
        [steady(12.0), ramp, (10.0, {}, 9000.0, 9000.0), (3.0, {}, 9000.0, 6000.0), steady(6.0)]
    )
    moves = [d.evidence["shaft_1x_move_um"] for d in told if "shaft_1x_move_um" in d.evidence]
    assert max(moves) < 0.5, "a healthy machine at another speed"
    assert_moves_are_true(told[-2:], healthy_um(told, 11.0))
    changed = abs(first_order_um(between(told, 24.0, 25.0)[0]) - healthy_um(told, 11.0))
    assert changed > 1.0, "the ramp did change the first order"


def points(count: int) -> Iterator[np.ndarray]:
    return (np.array([100.0 * 1.2**k, 60e-6, 0.5, 50.0]) for k in range(count))


def test_a_window_enters_only_when_all_verdicts_after_it_stayed_normal() -> None:
    point = next(points(1))
    for spoiled in (False, True):
        baseline = FirstOrderBaseline()
        baseline.note(0, point, 1 + 1j, normal=True)
        baseline.note(HINDSIGHT_NS - 1, point, 9 + 0j, normal=not spoiled)
        assert baseline.at(point) is None
        baseline.note(HINDSIGHT_NS, point, 9 + 0j, normal=True)
        assert baseline.at(point) == (None if spoiled else 1 + 1j)
    baseline.drop()
    baseline.note(3 * HINDSIGHT_NS, point, 9 + 0j, normal=True)
    assert baseline.at(point) is None


def test_single_wild_windows_do_not_shift_it_and_days_of_change_do() -> None:
    baseline, point, step = FirstOrderBaseline(), next(points(1)), HINDSIGHT_NS
    for k in range(FIRST_WINDOWS + 2):
        baseline.note(k * step, point, 50 + 0j if k % 5 == 2 else 1 + 0j, normal=True)
    assert baseline.at(point) == pytest.approx(1.0, abs=1e-3)
    for k in range(FIRST_WINDOWS + 2, 200_000):
        baseline.note(k * step, point, 3 + 0j, normal=True)
    assert baseline.at(point) == pytest.approx(3.0, abs=0.1)


def test_operating_points_are_bounded_and_the_least_visited_goes() -> None:
    baseline = FirstOrderBaseline()
    every = list(points(REFERENCES_MAX + 5))
    for k, point in enumerate(every):
        baseline.note(2 * k * HINDSIGHT_NS, point, complex(k), normal=True)
        baseline.note((2 * k + 1) * HINDSIGHT_NS, np.array([np.nan] * 4), 0j, normal=True)
    assert [baseline.at(point) for point in every[:5]] == [None] * 5
    assert [baseline.at(point) for point in every[5:]] == [complex(k) for k in range(5, len(every))]
    assert all(abs(a - b) > 0 for a, b in pairwise(p[0] for p in every))
