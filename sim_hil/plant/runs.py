"""Runs of the whole machine faster than real time: what it does at given duties and clearances,
what it would measure.

The rotor alone, with steady maps and other films: `sim_hil.plant.response`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.response import PlayedSchedule
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats
from sim_hil.sensors.chain import Counts

CONTROL_S = 0.02
"""The targets of the actuator are read this often, as the node reads its commands."""


def _value(schedule: PlayedSchedule, time_s: float) -> float:
    return schedule(time_s) if callable(schedule) else schedule


def run(
    machine: SimulatedMachine,
    duty: Duty,
    seconds: float,
    *,
    clearance: PlayedSchedule,
    pressure: PlayedSchedule | None = None,
    start_s: float = 0.0,
) -> Batch:
    """Advance ``machine`` through ``duty`` from ``start_s`` of the duty on.

    Parameters
    ----------
    clearance, pressure
        Targets, m and Pa, as :data:`PlayedSchedule` over the duty's time; pressure is nominal when
        None.
    """
    supply = machine.rig.supply.nominal_Pa if pressure is None else pressure
    period = machine.period_s
    total, step = round(seconds / period), max(1, round(CONTROL_S / period))
    batches = []
    for first in range(0, total, step):
        n = min(step, total - first)
        time_s = start_s + (first + np.arange(n + 1, dtype=np.float64)) * period
        now = float(time_s[0])
        batches.append(
            machine.advance(duty.at(time_s), _value(clearance, now), _value(supply, now))
        )
    return Batch(
        *(
            np.concatenate([getattr(b, name) for b in batches])
            for name in ("counts", "truth", "marks")
        )
    )


@dataclass(frozen=True)
class SimulatedRecording:
    """What the device would have received.

    ``counts``: int16 (n, 8); instant ``i`` was measured at ``time_s[i]``.  ``mark_s``:
    once-per-turn edges on the same time.  ``status``: every 0.05 s, columns time_s, shaft_power_W,
    oil_C, clearance_m, pressure_Pa, with the reading errors of the rig.  ``truth``: (n,
    14), ``TRUTH_COLUMNS``.
    """

    rate_hz: int
    time_s: Floats
    counts: Counts
    mark_s: Floats
    status: Floats
    truth: Floats

    def column(self, name: str) -> Floats:
        """One column of the truth."""
        column: Floats = self.truth[:, TRUTH_COLUMNS.index(name)]
        return column


STATUS_S = 0.05


def record(
    rig: RigData,
    build: Build,
    duty: Duty,
    seconds: float,
    *,
    clearance: PlayedSchedule,
    seed: int,
    pressure: PlayedSchedule | None = None,
    faults: Mapping[str, float] | None = None,
    rate_hz: int = 5000,
    inlet_C: float | None = None,
    settle_s: float = 0.4,
) -> SimulatedRecording:
    """Measure ``seconds`` of a machine after it has run for ``settle_s`` healthy and as long with
    ``faults``."""
    supplied = None if pressure is None else _value(pressure, 0.0)
    machine = SimulatedMachine(
        rig,
        build,
        seed,
        rate_hz=rate_hz,
        inlet_C=inlet_C,
        clearance_m=_value(clearance, 0.0),
        pressure_Pa=supplied,
    )
    start, present = Duty.hold(duty.speed_rpm[0], duty.load_N[0]), _value(clearance, 0.0)
    run(machine, start, settle_s, clearance=present, pressure=supplied)
    for name, severity in (faults or {}).items():
        machine.inject(name, severity)
    run(machine, start, settle_s, clearance=present, pressure=supplied)
    batch = run(machine, duty, seconds, clearance=clearance, pressure=pressure)
    return recording_of(machine, batch, np.random.default_rng([seed, 1]))


def recording_of(
    machine: SimulatedMachine, batch: Batch, rng: np.random.Generator
) -> SimulatedRecording:
    """Put samples, marks and status of a run on one time axis."""
    period = machine.period_s
    start = np.arange(len(batch.counts), dtype=np.float64) * period
    marked = batch.marks >= 0
    every = max(1, round(STATUS_S / period))
    n = len(batch.truth) // every
    slow = batch.truth[: n * every].reshape(n, every, -1).mean(axis=1)
    columns = {name: slow[:, i] for i, name in enumerate(TRUTH_COLUMNS)}
    most, noise_m = machine.rig.errors, machine.rig.actuator.position_noise_rms_m
    power_error, oil_error = (
        rng.uniform(-most.shaft_power_W, most.shaft_power_W),
        rng.uniform(-most.oil_C, most.oil_C),
    )
    reported = columns["clearance_m"] - machine.wear_m + noise_m * rng.standard_normal(n)
    status = np.column_stack(
        [
            np.arange(1, n + 1) * every * period,
            columns["shaft_power_W"] + power_error,
            columns["oil_C"] + oil_error,
            reported,
            columns["pressure_Pa"],
        ]
    )
    time_s = start + period - machine.delay_s
    return SimulatedRecording(
        machine.rate_hz, time_s, batch.counts, (start + batch.marks)[marked], status, batch.truth
    )
