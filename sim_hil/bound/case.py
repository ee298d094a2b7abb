"""One duty of one machine, run in time under a plan of the actuators and gathered into bins."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim_hil.bound.limits import ORBIT_SHARE, BoundLimits, orbit_share
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import SAMPLES_PER_TURN, PlayedSchedule, Trajectory, simulate
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats
from sim_hil.rotor.rigid import COLUMNS

BIN_S = 0.1
STEP_S, COARSE_STEP_S = 100e-6, 200e-6
"""Longest steps where a schedule is judged, and where a map is made to find it."""
SETTLE_S = 2.0
"""The start of the duty is held this long before it counts."""


@dataclass(frozen=True)
class TargetPlan:
    """Targets of the actuators at the starts of the bins: clearance, m, and supply pressure, Pa,
    shape (bins,).

    Between the starts the clearance target is linear and the pressure target held. The clearance is
    read `lead_s` ahead, for the lag of the actuator. `expected_W` is the mean power that the map
    promises.
    """

    clearance_m: Floats
    pressure_Pa: Floats
    lead_s: float = 0.0
    expected_W: float = math.nan

    @classmethod
    def fixed(cls, clearance_m: float, pressure_Pa: float) -> TargetPlan:
        """Both held."""
        return cls(np.array([clearance_m]), np.array([pressure_Pa]))

    def clearance(self, time_s: float) -> float:
        """Clearance target at a time of the duty, m; the first before it, the last after it."""
        return float(
            np.interp(
                (time_s + self.lead_s) / BIN_S, np.arange(self.clearance_m.size), self.clearance_m
            )
        )

    def pressure(self, time_s: float) -> float:
        """Pressure target at a time of the duty, Pa."""
        last = self.pressure_Pa.size - 1
        return float(self.pressure_Pa[min(max(int(time_s / BIN_S + 1e-6), 0), last)])


@dataclass(frozen=True)
class Profile:
    """What a run did in each bin: mean power, W, smallest film, m, largest orbit share, time in
    violation, s."""

    power_W: Floats
    min_film_m: Floats
    orbit_share: Floats
    violation_s: Floats


@dataclass(frozen=True)
class LimitVerdict:
    """How near a run came to its limits; `orbit_share` is over the present clearance."""

    mean_power_W: float
    min_film_m: float
    orbit_share: float
    violation_s: float

    @property
    def feasible(self) -> bool:
        """No sample broke a limit."""
        return self.violation_s == 0.0

    @classmethod
    def of(cls, profile: Profile) -> LimitVerdict:
        """Over the whole run."""
        return cls(
            float(profile.power_W.mean()),
            float(profile.min_film_m.min()),
            float(profile.orbit_share.max()),
            float(profile.violation_s.sum()),
        )


@dataclass(frozen=True)
class BoundCase:
    """A machine on a duty with its limits.

    Parameters
    ----------
    build
        The example of the rig; the drawing when None.
    thermal
        Whether the film warms the oil.
    inlet_C
        Temperature of the oil that comes in; the rig's own when None.
    fed
        The film with the rig's groove: supply pressure carries load, and the pump's power counts.
    """

    rig: RigData
    duty: Duty
    limits: BoundLimits
    thermal: bool
    build: Build | None = None
    inlet_C: float | None = None
    fed: bool = False
    step_s: float = STEP_S

    @property
    def coarse(self) -> BoundCase:
        """The same with coarse steps, half as many rows a turn, for a map."""
        return replace(self, step_s=COARSE_STEP_S)

    @property
    def bins(self) -> int:
        """Bins of the duty; a last one that is not full is filled by holding its end."""
        return math.ceil(self.duty.seconds / BIN_S - 1e-9)

    def run(self, plan: TargetPlan) -> Trajectory:
        """The duty in time, after some settling at its start, sampled often enough for its
        orbits."""
        d = self.duty
        led = Duty(
            (0.0, *(t + SETTLE_S for t in d.time_s)),
            (d.speed_rpm[0], *d.speed_rpm),
            (d.load_N[0], *d.load_N),
        )
        run = simulate(
            self.rig,
            led,
            clearance=_schedule(plan.clearance_m, plan.clearance),
            pressure=_schedule(plan.pressure_Pa, plan.pressure),
            seconds=SETTLE_S + self.bins * BIN_S,
            thermal=self.thermal,
            build=self.build,
            inlet_C=self.inlet_C,
            rate_hz=self._rate_hz(),
            dt_s=self.step_s,
            fed=self.fed,
        )
        counted = round(self.bins * BIN_S * self._rate_hz())
        return replace(run, time_s=run.time_s[-counted:], rows=run.rows[-counted:])

    def _rate_hz(self) -> float:
        """`SAMPLES_PER_TURN` at the highest speed, half as many for a map, and whole samples in a
        bin."""
        turns_per_s = max(abs(rpm) for rpm in self.duty.speed_rpm) / 60
        wanted_hz = SAMPLES_PER_TURN * turns_per_s * STEP_S / self.step_s
        return math.ceil(max(wanted_hz, 1 / COARSE_STEP_S) * BIN_S) / BIN_S

    def profile(self, plan: TargetPlan) -> Profile:
        """That run in bins; the pump's power counts in a fed film."""
        run = self.run(plan)
        if self.fed:
            run.rows[:, COLUMNS.index("power_W")] += run.pump_power_W(
                self.rig.supply.pump_efficiency
            )
        return gather(run, self.limits)


def _schedule(values: Floats, target: Callable[[float], float]) -> PlayedSchedule:
    """A plan's target for a run that settles first; one that never changes is a number, which is
    sooner read."""
    return float(values[0]) if values.size == 1 else partial(_delayed, target)


def _delayed(target: Callable[[float], float], time_s: float) -> float:
    return target(time_s - SETTLE_S)


def gather(run: Trajectory, limits: BoundLimits) -> Profile:
    """A run in bins of `BIN_S`."""
    period_s = float(run.time_s[1] - run.time_s[0])
    starts = np.arange(0, run.time_s.size, round(BIN_S / period_s))
    share, film = orbit_share(run), run.min_film_m
    broken = (film < limits.min_film_m) | (share > ORBIT_SHARE)
    return Profile(
        np.add.reduceat(run.power_W, starts) / np.diff(np.append(starts, run.time_s.size)),
        np.minimum.reduceat(film, starts),
        np.maximum.reduceat(share, starts),
        np.add.reduceat(broken.astype(np.float64), starts) * period_s,
    )
