"""Random machines in the closed loop of rig, guard and brain.

What ``check`` calls good runs :data:`RUN_S` there: every stage alive, no trip of a healthy machine,
and no command outside the envelope, neither of the guard's own nor of the film that the Reynolds
solver finds in the true machine.
"""

from __future__ import annotations

import random
import tempfile
import warnings
from pathlib import Path
from typing import Final

import numpy as np

from firmware_py import launch
from firmware_py.brain.core import BrainCore
from firmware_py.commands import building
from firmware_py.config import Config, ConfigError
from firmware_py.config.simulation import load_simulation
from firmware_py.guard.core import GuardCore
from firmware_py.machine.parts import monitor_only
from firmware_py.records import (
    ArmState,
    Block,
    Command,
    CommandReply,
    Diagnosis,
    GuardState,
    Mode,
    PeerRecord,
    RawFrame,
    RigReading,
)
from firmware_py.wire.link import codec_for
from sim_hil.closed_loop import ClosedLoop
from sim_hil.film import FilmError, equilibrium
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.plant.build import Build
from sim_hil.plant.truth import RigTruth
from sim_hil.rigs import RigData, load_rig

from .config_cases import Files, written
from .configurations import _complaint, _models
from .machine_cases import machine_case
from .outcome import Outcome

RUN_S: Final = 5.0
ARM_S: Final = 2.0
MOVES_S: Final = (2.3, 3.2, 4.1)
"""When a person asks for another clearance, and the machine for another speed and load."""

BORDER_UM: Final = 0.06
"""Commands cross the wire in tenths of a micrometre."""

FILM_SHARE: Final = 0.9
"""Of the least film: the rest is the grain of table and solver, and the way of the orbit."""


def run(seed: int, n: int, folder: Path, first: int = 0) -> Outcome:
    """Judge ``n`` machines from ``first`` on, with files in ``folder``."""
    outcome = Outcome()
    for i in range(first, first + n):
        good, wrong = judge(machine_case(seed, i), folder, i)
        outcome.add(f"seed {seed} machine {i}", good, wrong)
    return outcome


def judge(files: Files, folder: Path, seed: int) -> tuple[bool, list[str]]:
    """Whether the machine is called good, and what is wrong with that; empty when nothing is."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        path = written(files, Path(place))
        try:
            config = launch.verified(path)[0]
            load_simulation(path)
            building.build(config, _models(config))
        except ConfigError as error:
            complaint = _complaint(error)
            return False, [complaint] if complaint else []
        except Exception as error:  # noqa: BLE001 -- any other exception is what is looked for
            return False, [f"check: {type(error).__name__}: {error}"]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)  # a figure that is no number
                return True, Loop(config, load_rig(path), seed).judged()
        except Exception as error:  # noqa: BLE001 -- the same
            return True, [f"called good, but running: {type(error).__name__}: {error}"]


class Loop:
    """One machine in the closed loop, and what was seen of it."""

    def __init__(self, config: Config, rig: RigData, seed: int) -> None:
        self.config, self.rig = config, rig
        self._rng = random.Random(seed)
        self._codec = codec_for(config)
        self.plant = Rig(
            rig,
            self._codec,
            node_limits(rig, config),
            seed,
            build=Build.of_seed(rig, seed),
            rate_hz=config.sampling.rate_hz,
        )
        models = _models(config)
        self.told: list[PeerRecord] = []
        self.commands: list[tuple[int, Command]] = []
        self.loop = ClosedLoop(
            self.plant,
            GuardCore(config, self._codec, 7),
            lambda: BrainCore(config, models),
            [lambda record, now_ns: self.told.append(record)],
        )
        self.only = bool(monitor_only(config.machine))

    def judged(self) -> list[str]:
        """Run, and say what is wrong."""
        moves, armed = list(MOVES_S), self.only
        for cycle in range(round(RUN_S * 1000)):
            if not armed and cycle == round(ARM_S * 1000):
                armed = True
                self.loop.command("mode", mode=Mode.MANUAL)
                self.loop.command("arm")
            if moves and cycle == round(moves[0] * 1000):
                self._move(moves.pop(0))
            decision = self.loop.step()
            self._read(decision.frames_out)
        return [*self._alive(), *self._inside(), *self._true()]

    def _move(self, at_s: float) -> None:
        """Another clearance, and another speed and load at half of the unannounced ramps."""
        o, b = self.config.machine.operating, self.config.machine.bearing
        if not self.only:
            low, high = b.radial_clearance_min_um, b.radial_clearance_max_um
            self.loop.command("set_clearance", self._rng.uniform(low, high))
        seconds = RUN_S - at_s
        rpm, load_N = self.plant.drive.local_rpm, self.plant.drive.local_N
        far_rpm = 0.5 * o.speed_ramp_unannounced_rpm_s * seconds
        far_N = 0.5 * o.load_ramp_unannounced_N_s * seconds
        rpm = min(max(rpm + self._rng.uniform(-1, 1) * far_rpm, o.speed_min_rpm), o.speed_max_rpm)
        load_N = min(max(load_N + self._rng.uniform(-1, 1) * far_N, o.load_min_N), o.load_max_N)
        self.plant.set_operating(rpm, load_N, seconds)

    def _read(self, frames: list[RawFrame]) -> None:
        for frame in frames:
            message = self._codec.decode(frame)
            if isinstance(message, Command):
                self.commands.append((self.loop.now_ns, message))

    def _alive(self) -> list[str]:
        """Guard, brain and rig say what they should say, and nobody stops a healthy machine."""
        found = []
        for kind, least in ((GuardState, 40), (RigReading, 40), (Block, 100), (Diagnosis, 2)):
            count = sum(isinstance(record, kind) for record in self.told)
            if count < least:
                found.append(f"{count} {kind.__name__} in {RUN_S:g} s, at least {least}")
        if not self.loop.brain_runs:
            found.append("the brain does not run")
        states = [record for record in self.told if isinstance(record, GuardState)]
        stopped = next((state for state in states if state.trip_request), None)
        if stopped:
            why = [f"{a.name} {a.value:g} over {a.limit:g}" for a in stopped.alarms]
            found.append(f"a healthy machine tripped: {why}")
        if self.plant.drive.coasting:
            found.append(f"the drive coasts: {self.plant.drive.reason}")
        return found

    def _inside(self) -> list[str]:
        """Commands inside the actuator's range and inside what the guard says that it admits."""
        if self.only:
            return [f"{len(self.commands)} commands of a machine that is monitor only"][
                : len(self.commands)
            ]
        b, feed = self.config.machine.bearing, self.config.machine.feed
        states = [record for record in self.told if isinstance(record, GuardState)]
        times = np.array([state.t_ns for state in states])
        found = []
        for now_ns, command in self.commands:
            um, bar = command.clearance_um, command.pressure_bar
            if (
                not b.radial_clearance_min_um - BORDER_UM
                <= um
                <= b.radial_clearance_max_um + BORDER_UM
            ):
                found.append(f"command of {um:g} um outside the actuator's range")
            if not feed.pressure_min_bar - 0.01 <= bar <= feed.pressure_max_bar + 0.01:
                found.append(f"command of {bar:g} bar outside the supply's range")
            at = int(np.searchsorted(times, now_ns))
            near = states[max(0, at - 1) : at + 1]
            low = min(state.clearance_low_um for state in near) - BORDER_UM
            high = max(state.clearance_high_um for state in near) + BORDER_UM
            if near[-1].arm_state == ArmState.ARMED and not low <= um <= high:
                found.append(f"command of {um:g} um outside the envelope {low:g} .. {high:g} um")
        return found[:3]

    def _true(self) -> list[str]:
        """The film at rest in the true machine, each half second while it is armed."""
        states = {record.t_ns: record for record in self.told if isinstance(record, GuardState)}
        armed = (t for t, state in states.items() if state.arm_state == ArmState.ARMED)
        since_ns = min(armed, default=None)
        if since_ns is None:
            return []
        least_um = FILM_SHARE * self.config.limits.min_film_um
        return [
            f"film at rest {film_um:.3g} um at {truth.clearance_um:.4g} um, "
            f"{truth.speed_rad_s:.4g} rad/s, {truth.load_N:.4g} N: below {least_um:.3g}"
            for truth in list(self.plant.truth)[::5]
            if truth.t_ns >= since_ns and (film_um := self._film_um(truth)) < least_um
        ][:1]

    def _film_um(self, truth: RigTruth) -> float:
        try:
            state = equilibrium(
                load_N=truth.load_N,
                radius_m=self.rig.bearing.radius_m,
                length_m=self.rig.bearing.length_m,
                clearance_m=truth.clearance_um * 1e-6,
                viscosity_Pa_s=truth.viscosity_Pa_s,
                speed_rad_s=truth.speed_rad_s,
                grid=(96, 12),
            )
        except FilmError:
            return 0.0
        return float(state.film.min_film_m) * 1e6

    @property
    def refused(self) -> list[str]:
        """Why commands were refused."""
        replies = (record for record in self.told if isinstance(record, CommandReply))
        return [reason for reply in replies if not reply.accepted for reason in reply.reasons]
