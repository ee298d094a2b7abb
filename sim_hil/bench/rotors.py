"""One rotor and many: how much faster than real time, and how far from the step-converged orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Final

import numba
import numpy as np

from sim_hil.bench.film import repeat_of_reference
from sim_hil.bench.reference_kernel import spread_reference
from sim_hil.bench.timing import ROUNDS, Timing, beside, wall
from sim_hil.film.table import FilmTable
from sim_hil.gym.control_task import CONTROL_S
from sim_hil.gym.fleet import STEP_S as FLEET_STEP_S
from sim_hil.gym.fleet import advance_fleet, records
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.machine import Batch, SimulatedMachine
from sim_hil.plant.response import equilibrium_at
from sim_hil.rigs import RigData, load_rig
from sim_hil.rotor.assembly import assemble
from sim_hil.rotor.film_law import DirectLaw, Law
from sim_hil.rotor.parameters import Floats, Plant, new_state
from sim_hil.rotor.rigid import COLUMNS, advance_rotor, advance_rotors

LOAD_N: Final = 100.0
CLEARANCE_M: Final = 60e-6
RPM: Final = 6000.0
STEP_S: Final = 100e-6
RENEW: Final = 8
"""A turn at 10000 rpm is cut into 60 steps; the film's slopes are renewed every eighth."""
WHIRL_RPM: Final = 12000.0
WHIRL_N: Final = 30.0
WHIRL_STEP_S: Final = 60.0 / WHIRL_RPM / 60

_WHIRL_S = 0.6
_SETTLE_S = 0.4
_COMPARED_S = 0.1
_CONVERGED = 8


@dataclass(frozen=True)
class ReadyRotor:
    """A machine at one speed, ready to run: everything `advance_rotor` takes but the state."""

    plant: Plant
    law: Law
    start_m: Floats
    speed_rad_s: float
    load_N: float = LOAD_N
    clearance_m: float = CLEARANCE_M
    whirl_rad_s: float = 0.0
    """Rate at which it whirls about the middle at the start."""

    def state(self) -> tuple[Floats, Floats]:
        """Rotor at its equilibrium, and its scalars."""
        s = self.plant.shaft
        w = np.zeros(8)
        w[2:4] = self.start_m / (s.to_bearing + s.to_coupling)
        w[0:2] = s.to_coupling * w[2:4]
        w[4], w[5], w[6], w[7] = self.whirl_rad_s * np.array([-w[1], w[0], -w[3], w[2]])
        return w, new_state(1, self.clearance_m, 1e5, self.plant.film.inlet_C, 0.0).scalar

    def run(self, seconds: float, refine: int = 1, step_s: float = STEP_S) -> Callable[[], Floats]:
        """A call that runs `seconds` from the start in steps of `step_s`, each cut into
        `refine`."""
        n = round(seconds / step_s)
        drive = np.tile([self.speed_rad_s, self.load_N], (n + 1, 1))
        target = np.tile([self.clearance_m, 1e5], (n, 1))
        out = np.empty((n, len(COLUMNS)))

        def call() -> Floats:
            w, scalar = self.state()
            p = self.plant
            renew = RENEW if refine == 1 else 1
            advance_rotor(
                p.shaft,
                p.film,
                p.act,
                self.law,
                w,
                scalar,
                drive,
                target,
                step_s,
                refine,
                renew,
                out,
            )
            return out

        return call

    def error(self) -> float:
        """Largest distance from the orbit at an eighth of the step, over the radius of that
        orbit."""
        last = round(_COMPARED_S / STEP_S)
        coarse = self.run(_SETTLE_S + _COMPARED_S)()[-last:, :2].copy()
        fine = self.run(_SETTLE_S + _COMPARED_S, _CONVERGED)()[-last:, :2]
        return float(np.hypot(*(coarse - fine).T).max() / (np.ptp(fine, axis=0).max() / 2))


@cache
def _bench() -> RigData:
    return load_rig("bench")


def orbit(force: str, rpm: float) -> ReadyRotor:
    """The rig `bench` at `rpm`, 100 N, 60 um, oil at its inlet temperature."""
    rig = _bench()
    plant = assemble(rig, Build.nominal(rig), STEP_S, thermal=False)
    table = FilmTable.load(rig.bearing.length_m / (2 * rig.bearing.radius_m)).coefficients
    law = DirectLaw.make(table) if force == "direct" else table
    start = equilibrium_at(rig, plant, rpm * RAD_S_PER_RPM, LOAD_N, CLEARANCE_M)
    return ReadyRotor(plant, law, start.position_m, rpm * RAD_S_PER_RPM)


@dataclass(frozen=True)
class Whirl:
    """Mean radius of the journal, m, and mean power, W, over the second half of a run."""

    radius_m: float
    power_W: float


def whirling(clearance_m: float, start: float | None = None) -> ReadyRotor:
    """The fastest and lightest machine of the rig `bench`, which whirls in wide clearances.

    It starts at its equilibrium, or whirling at half its speed at the eccentricity ratio `start`.
    """
    rig, speed = _bench(), WHIRL_RPM * RAD_S_PER_RPM
    plant = assemble(rig, Build.nominal(rig), WHIRL_STEP_S, thermal=False)
    law = FilmTable.load(rig.bearing.length_m / (2 * rig.bearing.radius_m)).coefficients
    if start is None:
        place = equilibrium_at(rig, plant, speed, WHIRL_N, clearance_m).position_m
        return ReadyRotor(plant, law, place, speed, WHIRL_N, clearance_m)
    place = np.array([start * clearance_m, 0.0])
    return ReadyRotor(plant, law, place, speed, WHIRL_N, clearance_m, 0.5 * speed)


def whirl(clearance_m: float, step_s: float, start: float | None = None) -> Whirl:
    """What :func:`whirling` settles to in steps of `step_s`."""
    rows = whirling(clearance_m, start).run(_WHIRL_S, step_s=step_s)()
    last = rows[len(rows) // 2 :]
    radius_m = np.hypot(last[:, 0], last[:, 1]).mean()
    return Whirl(float(radius_m), float(last[:, COLUMNS.index("power_W")].mean()))


def whole_rig(seconds: float) -> Callable[[], Batch]:
    """A call that runs the machine of the rig `bench` for `seconds`, with sensors at 5 kHz."""
    rig = _bench()
    machine = SimulatedMachine(rig, Build.nominal(rig), seed=0)
    drive = np.tile([RPM * RAD_S_PER_RPM, LOAD_N], (round(seconds / machine.period_s) + 1, 1))
    return lambda: machine.advance(drive, CLEARANCE_M, rig.supply.nominal_Pa)


def fleet(count: int, seconds: float) -> Callable[[int], None]:
    """A call that runs `count` rotors on the table film for `seconds`, with the number of threads
    to use."""
    one = orbit("table", 10000)
    w, scalar = (np.stack(each) for each in zip(*(one.state() for _ in range(count)), strict=True))
    n = round(seconds / STEP_S)
    drive = np.tile([one.speed_rad_s, LOAD_N], (count, n + 1, 1))
    target = np.tile([CLEARANCE_M, 1e5], (count, n, 1))
    out = np.empty((count, n, len(COLUMNS)))
    p, law = one.plant, np.asarray(one.law)

    def call(threads: int) -> None:
        numba.set_num_threads(threads)
        advance_rotors(p.shaft, p.film, p.act, law, w, scalar, drive, target, STEP_S, 1, RENEW, out)

    return call


def speed_ups(count: int, threads: int, seconds: float) -> tuple[float, float]:
    """How much faster `threads` are than one, by the wall clock: the reference kernel, and `count`
    rotors.

    The reference says what the machine has to give just now: other programs may sit on its cores.
    """
    rotors, reference = fleet(count, seconds), spread_reference(8 * threads, 500)
    gains = []
    for _ in range(ROUNDS):
        for work in (reference, rotors):
            work(threads)
        gains.append(
            [wall(partial(work, 1)) / wall(partial(work, threads)) for work in (reference, rotors)]
        )
    found = np.median(gains, axis=0)
    return float(found[0]), float(found[1])


def kernel_share(count: int) -> float:
    """Processor time of `count` rotors advanced together for a control step, over as many calls for
    one each."""
    single, many = _together(1), _together(count)
    return beside(lambda: [single() for _ in range(count)], many, (1, 1)).ratio


def _together(count: int) -> Callable[[], object]:
    """A call that advances `count` rotors by a control step as training does, without anything
    around it."""
    one = orbit("table", 10000)
    w, scalar = (np.stack(each) for each in zip(*(one.state() for _ in range(count)), strict=True))
    n = round(CONTROL_S / FLEET_STEP_S)
    drive = np.tile([one.speed_rad_s, LOAD_N], (count, n + 1, 1))
    target = np.tile([CLEARANCE_M, 1e5], (count, n, 1))
    out = np.empty((count, n, len(COLUMNS)))
    parts = []
    for part in (one.plant.shaft, one.plant.film, one.plant.act):
        parts.append(records(part._fields, count))
        parts[-1][:] = tuple(part)
    return partial(
        advance_fleet, *parts, np.asarray(one.law), w, scalar, drive, target, np.arange(count), out
    )


def environment_steps(rotors: int) -> tuple[Timing, float]:
    """Processor time of a step of one of `rotors` in one environment, and that over the step of one
    alone in its own.

    Both are what a user pays: compiled kernel, Python and call, at the same duty and build.
    """
    many, single = _training(rotors), _training(1)
    return beside(repeat_of_reference(2000), many, (2000, rotors)), beside(
        single, many, (1, rotors)
    ).ratio


def _training(rotors: int) -> Callable[[], object]:
    """A call that makes one step of an environment of that many rotors."""
    duty, build = Duty.hold(6000, LOAD_N, 30.0), Build.nominal(_bench())
    envs = RotorVectorEnv(rotors, duty=duty, build=build)
    envs.reset(seed=0)
    action = np.full((rotors, 1), -0.7, np.float32)
    return lambda: envs.step(action)
