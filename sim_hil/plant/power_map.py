"""Steady power, film and orbit over speed, load and clearance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_hil.plant.duty import Duty
from sim_hil.plant.response import SAMPLES_PER_TURN, Force, simulate
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats


@dataclass(frozen=True)
class PowerMap:
    """Steady figures over speed x load x clearance: shape (rpm, load, clearance) each.

    ``warnings`` says what of any point is not proven.
    """

    power_W: Floats
    min_film_m: Floats
    peak_to_peak_m: Floats
    warnings: tuple[str, ...] = ()


def power_map(
    rig: RigData,
    rpm: Floats,
    load_N: Floats,
    clearance_m: Floats,
    *,
    seconds: float = 1.0,
    thermal: bool = False,
    force: Force = "table",
    pressure_Pa: float | None = None,
) -> PowerMap:
    """Mean power, smallest film and larger peak-to-peak of the last half of `seconds` at each
    point.

    With `pressure_Pa` the film is the one fed from the groove at that supply pressure, and the
    pump's power counts.

    The journal starts at rest at its equilibrium, so that whirl shows where it grows by itself;
    close to its threshold it takes longer than a second (at 12000 rpm, 30 N of rig `bench` the
    peak-to-peak after 1 s is 3 % short).
    """
    rpm, load_N, clearance_m = (
        np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in (rpm, load_N, clearance_m)
    )
    shape = (rpm.size, load_N.size, clearance_m.size)
    figures = np.empty((3, *shape))
    unproven: list[str] = []
    for i, j, k in np.ndindex(shape):
        duty = Duty.hold(float(rpm[i]), float(load_N[j]), seconds)
        rate_hz = max(5000.0, SAMPLES_PER_TURN * abs(float(rpm[i])) / 60)
        run = simulate(
            rig,
            duty,
            clearance=float(clearance_m[k]),
            thermal=thermal,
            force=force,
            rate_hz=rate_hz,
            pressure=pressure_Pa,
            fed=pressure_Pa is not None,
        ).last(seconds / 2)
        unproven += run.warnings
        pumped = 0.0 if pressure_Pa is None else run.pump_power_W(rig.supply.pump_efficiency).mean()
        figures[:, i, j, k] = (
            run.power_W.mean() + pumped,
            run.min_film_m.min(),
            run.peak_to_peak_m(),
        )
    power_W, film_m, swing_m = figures
    return PowerMap(power_W, film_m, swing_m, tuple(dict.fromkeys(unproven)))
