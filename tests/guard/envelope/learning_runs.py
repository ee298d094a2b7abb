"""What the guard learns beside the truth, on machines of the rig in software whose clearance, speed
or load moves."""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import numpy as np

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import LoadEstimator, Look
from firmware_py.machine.lubricant import CredibleOil
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.plant.runs import SimulatedRecording, recording_of, run
from sim_hil.rigs import load_rig
from sim_hil.rotor.parameters import TRUTH_COLUMNS, Floats

from ..scripted_node import bench

LOOK: Final = 100
STATUS: Final = 250
WINDOW: Final = 500
"""In samples of 5 kHz: the guard looks every 20 ms at a mean over 100 ms; readings come every 50
ms."""

SECONDS: Final = 4.0
ROUNDING: Final = 1e-6
KINDS: Final = ("opening", "closing", "speed", "load", "hold")


class Learnt(NamedTuple):
    """Looks at which something had been learnt, and at which oil or load were excluded that were
    the true ones."""

    looks: int
    oil_excluded: int
    load_excluded: int


@cache
def config() -> Config:
    """The bench rig's."""
    return bench()


def learnt(seed: int, kind: str) -> Learnt:
    """One build that does ``kind`` after about a second: its clearance opens or closes at 50 um/s,
    and so on."""
    rng = np.random.default_rng([seed, 77])
    recording = _recording(seed, kind, rng)
    x, y = recording.counts[:, 0] * 1e-8, recording.counts[:, 1] * 1e-8
    loads, law = LoadEstimator(config()), CredibleOil(config().machine)
    column = {name: recording.truth[:, i] for i, name in enumerate(TRUTH_COLUMNS)}
    looks = oil_excluded = load_excluded = 0
    for i in range(WINDOW + LOOK, len(x), LOOK):
        _, power_W, oil_C, clearance_m, pressure_Pa = recording.status[i // STATUS - 1]
        first, second = x[i - WINDOW : i], y[i - WINDOW : i]
        found = loads.estimate(
            Look(
                i * 2e-4,
                float(first.mean() - second.mean()) / 2**0.5,
                float(first.mean() + second.mean()) / 2**0.5,
                max(float(np.ptp(first)), float(np.ptp(second))),
                clearance_m,
                float(column["speed_rad_s"][i - 1]),
                oil_C,
                power_W,
                pressure_Pa * 1e-5,
            )
        )
        oil, true = loads.state.oil, column["viscosity_Pa_s"][i - 1] / law.law(oil_C)
        load_N = column["load_N"][i - WINDOW // 2]
        looks += oil.thinnest > law.thinnest + ROUNDING or oil.thickest < law.thickest - ROUNDING
        oil_excluded += not oil.thinnest * (1 - ROUNDING) <= true <= oil.thickest * (1 + ROUNDING)
        load_excluded += found.measured and not (
            found.low_N * (1 - ROUNDING) <= load_N <= found.high_N * (1 + ROUNDING)
        )
    return Learnt(int(looks), int(oil_excluded), int(load_excluded))


def _recording(seed: int, kind: str, rng: np.random.Generator) -> SimulatedRecording:
    """What the device receives of it, with readings of the instant at which they are sent."""
    rig = load_rig("bench")
    narrow, wide = (40.0, 70.0), (70.0, 120.0)
    start_m = float(rng.uniform(*(wide if kind == "closing" else narrow))) * 1e-6
    end_m = {"closing": 42e-6, "opening": 120e-6}.get(kind, start_m)
    rpm, load_N, at_s = (
        float(rng.uniform(*ends)) for ends in ((7000.0, 12000.0), (60.0, 250.0), (0.7, 1.5))
    )
    machine = SimulatedMachine(
        rig,
        Build.of_seed(rig, seed),
        seed,
        clearance_m=start_m,
        inlet_C=float(rng.uniform(36.0, 42.0)),
    )
    run(machine, Duty.hold(rpm, load_N), 0.5, clearance=start_m)
    end_rpm = rpm - 4000.0 if kind == "speed" else rpm
    end_N = load_N + 50.0 if kind == "load" else load_N
    duty = Duty(
        (0.0, at_s, at_s + 2.0, 100.0), (rpm, rpm, end_rpm, end_rpm), (load_N, load_N, end_N, end_N)
    )
    batch = run(machine, duty, SECONDS, clearance=lambda t: start_m if t < at_s else end_m)
    recording = recording_of(machine, batch, rng)
    for name, row in (("clearance_m", 3), ("oil_C", 2)):
        recording.status[:, row] += _last_less_mean(recording.truth[:, TRUTH_COLUMNS.index(name)])
    return recording


def _last_less_mean(values: Floats) -> Floats:
    """Of each reading's period."""
    rows = values[: len(values) // STATUS * STATUS].reshape(-1, STATUS)
    difference: Floats = rows[:, -1] - rows.mean(axis=1)
    return difference
