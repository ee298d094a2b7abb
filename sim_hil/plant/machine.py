"""One machine in time: the compiled plant, its random excitation and its sensors, behind two
methods."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_py.errors import OrbitdError
from sim_hil.faults import FaultSet, apply_machine_faults, check_fault, sensor_fault
from sim_hil.film.bore import PadBore
from sim_hil.plant.build import Build
from sim_hil.plant.response import on_the_wall
from sim_hil.plant.validity import refusal, step_for
from sim_hil.rigs import RigData
from sim_hil.rotor.assembly import assemble, rig_film
from sim_hil.rotor.film_law import film_law
from sim_hil.rotor.kernel import GRAVITY
from sim_hil.rotor.parameters import (
    CLEARANCE,
    N_SENSORS,
    N_TRUTH,
    OIL,
    POWER,
    PRESSURE,
    Floats,
    new_state,
)
from sim_hil.sensors.antialias import antialias_taps
from sim_hil.sensors.chain import Counts, SensorChain
from sim_hil.sensors.kernel import advance

MAX_STEP_S = 40e-6
"""A sampling period is cut into equal steps no longer than this."""

LONGEST_STEP_S = 50e-6
"""Verified: orbits within 0.5 % and mean power within 1 % of an eighth of the step, also in whirl
that fills the clearance."""

SLOPES_KEPT_S = 200e-6
"""How long slopes of a film that does not know its own are kept where it is smooth."""

SLOWEST_RATE_HZ = 1000

_N_AMBIENT = 4
_ROUNDING_M = 1e-9
_NO_FAULTS = np.zeros((0, N_SENSORS))


class MachineError(OrbitdError, ValueError):
    """What the machine is asked to do is outside what it is built for, or has no finite answer."""


def _check_steps(rate_hz: int, max_step_s: float) -> None:
    """Refuse what the integration is not verified for."""
    if not 0.0 < max_step_s <= LONGEST_STEP_S:
        raise MachineError(
            f"max_step_s = {max_step_s:g}: above zero and at most {LONGEST_STEP_S:g} s, up to "
            f"where the film is "
            f"verified; {MAX_STEP_S:g} s is the default"
        )
    if not (rate_hz >= SLOWEST_RATE_HZ and 1e6 % rate_hz == 0):
        raise MachineError(
            f"rate_hz = {rate_hz}: a period is a whole number of microseconds, and the rate at "
            f"least "
            f"{SLOWEST_RATE_HZ} Hz; take 5000 or 10000"
        )


@dataclass(frozen=True)
class Batch:
    """``n`` sampling instants: counts (n, 8), truth (n, 14, see ``TRUTH_COLUMNS``), marks (n,).

    ``marks`` holds the time of a once-per-turn edge from the start of the sampling period, s, else
    -1. ``counts`` and the truth differ by the delay of the anti-alias filter
    (``SimulatedMachine.delay_s``).
    """

    counts: Counts
    truth: Floats
    marks: Floats


@dataclass(frozen=True)
class TrueReadings:
    """Slow quantities as they are, without reading errors."""

    clearance_m: float
    pressure_Pa: float
    power_W: float
    oil_C: float


class SimulatedMachine:
    """A rotor rig without its wires.

    Parameters
    ----------
    rig, build
        What is fixed, and how this example differs.
    rate_hz
        Sampling rate of the channels.
    clearance_m, pressure_Pa
        Start of the actuator; the rig's nominal values when None.
    inlet_C, thermal
        Oil inlet temperature, and whether the film warms up by its own friction.
    fed
        Whether the supply pressure acts in the film: the rig's groove, instead of the unfed
        periodic film. In the film of a rig with feed ports it always does.
    max_step_s
        Longest integration step, at most :data:`LONGEST_STEP_S`; shorter where the rig's greatest
        speed asks for it (:mod:`sim_hil.plant.validity`).

    Raises
    ------
    MachineError
        A rate or a step outside what the integration is verified for, or a start outside the
        actuator's range.
    AssemblyError
        A rig or a build that no machine can have.
    FilmError
        ``fed``, and the rig's feed is not tabulated.
    """

    def __init__(
        self,
        rig: RigData,
        build: Build,
        seed: int,
        *,
        rate_hz: int = 5000,
        clearance_m: float | None = None,
        pressure_Pa: float | None = None,
        inlet_C: float | None = None,
        thermal: bool = True,
        fed: bool = False,
        max_step_s: float = MAX_STEP_S,
    ) -> None:
        _check_steps(rate_hz, max_step_s)
        self.rig, self.build, self.rate_hz = rig, build, rate_hz
        clearance_m = rig.bearing.clearance_nominal_m if clearance_m is None else clearance_m
        pressure_Pa = rig.supply.nominal_Pa if pressure_Pa is None else pressure_Pa
        self._check_targets(clearance_m, pressure_Pa)
        self.period_s = 1.0 / rate_hz
        self._substeps = max(1, math.ceil(self.period_s / step_for(rig, max_step_s) - 1e-9))
        step_s = self.period_s / self._substeps
        self._kept_steps = max(1, round(SLOPES_KEPT_S / step_s))
        self._healthy = assemble(rig, build, step_s, inlet_C=inlet_C, thermal=thermal)
        self._taps = antialias_taps(self._substeps)
        self.delay_s = (self._taps.size - 1) / 2 * step_s
        self._resting = rig_film(rig, fed=False)
        self._film = rig_film(rig, fed=True) if fed else self._resting
        self._rng = np.random.default_rng(seed)
        self._fault_rng = np.random.default_rng([seed, 4])
        self._state = new_state(
            self._taps.size,
            clearance_m,
            pressure_Pa,
            self._healthy.film.inlet_C,
            float(self._rng.uniform(0, 2 * math.pi)),
        )
        self._chain = SensorChain(rig, build)
        self._faults: dict[str, tuple[float, float]] = {}
        self._plant = self._healthy
        self._instants = 0

    @property
    def time_s(self) -> float:
        """Time since the start, s."""
        return self._instants * self.period_s

    @property
    def faults(self) -> FaultSet:
        """Present faults and their severities."""
        return {name: severity for name, (severity, _) in self._faults.items()}

    @property
    def wear_m(self) -> float:
        """Radial clearance beyond what the actuator reports, m."""
        return self._plant.film.wear

    @property
    def unbalance_kg_m(self) -> float:
        """Present unbalance at the bearing."""
        return self._plant.shaft.unbalance

    def readings(self) -> TrueReadings:
        """Slow quantities now."""
        scalar = self._state.scalar
        return TrueReadings(
            float(scalar[CLEARANCE]),
            float(scalar[PRESSURE]),
            float(scalar[POWER]),
            float(scalar[OIL]),
        )

    def set_inlet(self, inlet_C: float) -> None:
        """Oil inlet temperature from now on."""
        self._healthy = self._healthy._replace(film=self._healthy.film._replace(inlet_C=inlet_C))
        self._plant = apply_machine_faults(self._healthy, self.rig, self.build, self.faults)

    def inject(self, name: str, severity: float) -> None:
        """Set a fault from now on; see :mod:`sim_hil.faults` for names and severities.

        Raises
        ------
        UnknownFault
            No such fault, or severity outside its range.
        """
        check_fault(name, severity)
        self._faults[name] = (severity, self.time_s)
        self._plant = apply_machine_faults(self._healthy, self.rig, self.build, self.faults)

    def heal(self) -> None:
        """Remove all faults."""
        self._faults.clear()
        self._plant = self._healthy

    def advance(self, drive: Floats, clearance_m: float, pressure_Pa: float) -> Batch:
        """Advance by ``len(drive) - 1`` sampling periods.

        Parameters
        ----------
        drive
            Speed, rad/s, of any sign, and static bearing load, N, at the borders of the periods,
            shape (n + 1, 2).
        clearance_m, pressure_Pa
            Targets of the actuator.

        Raises
        ------
        MachineError
            A target outside the actuator's range, a speed or load that is not finite, a speed far
            beyond the rig's or with too few steps a turn, or no finite answer.
        """
        drive = np.ascontiguousarray(drive, dtype=np.float64)
        self._check_drive(drive)
        self._check_targets(clearance_m, pressure_Pa)
        if self._instants == 0 and drive[0, 0] == 0.0:
            self._lie_down(float(drive[0, 1]))
        n = len(drive) - 1
        normal = self._rng.standard_normal((n, N_SENSORS + _N_AMBIENT))
        signals, truth, marks = np.empty((n, N_SENSORS)), np.empty((n, N_TRUTH)), np.empty(n)
        ambient = np.ascontiguousarray(normal[:, N_SENSORS:]) * self._plant.excite.ambient
        advance(
            self._plant,
            self._state,
            self._film,
            self._taps,
            drive,
            np.array([clearance_m, pressure_Pa]),
            ambient,
            self.period_s,
            self._substeps,
            self._kept_steps,
            signals,
            truth,
            marks,
        )
        if not (math.isfinite(truth.sum()) and math.isfinite(signals.sum())):
            raise MachineError(
                f"machine {self.rig.name}: no finite answer at {self.time_s:.3f} s with speed "
                f"{drive[0, 0]:g} rad/s, "
                f"load {drive[0, 1]:g} N, clearance {clearance_m * 1e6:g} um, faults "
                f"{self.faults}; use a shorter "
                f"max_step_s or smaller loads"
            )
        time_s = (self._instants + np.arange(n, dtype=np.float64)) * self.period_s
        angle = truth[:, 0] - truth[:, 1] * self.delay_s
        counts = self._chain.counts(
            signals, normal[:, :N_SENSORS], self._uniform(n), time_s, angle, self._faults
        )
        self._instants += n
        return Batch(counts, truth, marks)

    def static_load(
        self, ex_m: float, ey_m: float, speed_rad_s: float, clearance_m: float, oil_C: float
    ) -> float:
        """Film force, N, of a journal resting at ``(ex, ey)`` of the nominal bearing: a load
        estimate."""
        b, mu = self.rig.bearing, self.rig.oil.viscosity_at(oil_C)
        fx, fy, _, _ = film_law(
            self._resting,
            ex_m,
            ey_m,
            0.0,
            0.0,
            speed_rad_s,
            clearance_m,
            mu,
            b.radius_m,
            b.length_m,
            0.0,
            float(self._state.scalar[PRESSURE]),
        )
        return math.hypot(fx, fy)

    def _lie_down(self, load_N: float) -> None:
        """A machine that begins at standstill lies on the wall, in a pedestal that has settled."""
        shaft, pedestal, q = self._healthy.shaft, self._healthy.pedestal, self._state.q
        c = float(self._state.scalar[CLEARANCE]) + self.wear_m
        q[5] = -(pedestal.mass * GRAVITY + load_N) / sum(pedestal.stiffness)
        lies = on_the_wall(c, load_N, PadBore.of(self.rig.bearing.pads))
        place = lies.position_m + np.array([0.0, q[5]])
        q[2:4] = place / (shaft.to_bearing + shaft.to_coupling)
        q[:2] = shaft.to_coupling * q[2:4]

    def _check_drive(self, drive: Floats) -> None:
        if drive.ndim != 2 or drive.shape[1] != 2 or len(drive) < 2:
            raise MachineError(
                f"drive of shape {drive.shape}: (n + 1, 2) with n >= 1, columns speed and load"
            )
        if not math.isfinite(drive.sum()):
            raise MachineError(
                f"speed or load at {self.time_s:.3f} s is not finite: {drive[0]} to {drive[-1]}"
            )
        low, high = sorted((float(drive[0, 0]), float(drive[-1, 0])))
        if why := refusal(self.rig, low, high, self.period_s / self._substeps):
            raise MachineError(why)

    def _check_targets(self, clearance_m: float, pressure_Pa: float) -> None:
        """Refuse what no actuator could follow."""
        bearing = self.rig.bearing
        if (
            not bearing.clearance_min_m - _ROUNDING_M
            <= clearance_m
            <= bearing.clearance_max_m + _ROUNDING_M
        ):
            raise MachineError(
                f"clearance = {clearance_m * 1e6:g} um: outside the radial range "
                f"{bearing.clearance_min_m * 1e6:g} to "
                f"{bearing.clearance_max_m * 1e6:g} um of rig {self.rig.name}"
            )
        if not 0.0 <= pressure_Pa < math.inf:
            raise MachineError(
                f"pressure = {pressure_Pa:g} Pa: a supply pressure is finite and not negative"
            )

    def _uniform(self, n: int) -> Floats:
        """Random numbers for sensor faults: a stream of their own, so that a fault changes no other
        noise."""
        if any(sensor_fault(name) for name in self._faults):
            return self._fault_rng.random((n, N_SENSORS))
        return _NO_FAULTS
