"""One machine behind the whole device: guard and brain that ship, every frame over its codec.

Search and ablation run on rotors behind the guard's shield alone (:mod:`models.control.shielded`)
and on features (:mod:`models.diagnosis.alarms`); what is claimed of a shipped model is measured
once more here, where channels may fall out, the predictor may overrule and the guard has the last
word.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import Models
from firmware_py.config import Config
from firmware_py.guard.core import GuardCore
from firmware_py.guard.envelope.shield import Shield
from firmware_py.records import (
    CommandReply,
    Diagnosis,
    Event,
    GuardState,
    Mode,
    PeerRecord,
    PlannedRamp,
)
from firmware_py.wire.link import codec_for
from models.control.shielded import fast_ramps
from sim_hil.closed_loop import ClosedLoop
from sim_hil.hil.rig import Rig, node_limits
from sim_hil.plant.build import Build
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.truth import RigTruth
from sim_hil.rigs import RigData

START_NS: Final = 1_000_000_000
SESSION: Final = 0x5EED0002
"""Nonce of the guard: fixed, so that runs repeat bit for bit."""
ARM_S: Final = 2.0
"""The device is armed this long after the first frame."""
SETTLED_S: Final = 10.0
"""Figures are taken from here on: authority is there and the clearance where it goes."""
ANNOUNCE_MARGIN_S: Final = 0.1
"""Beyond the lead that the guard asks for."""


@dataclass(frozen=True)
class Scenario:
    """One machine and what it does: after :data:`SETTLED_S` at its first point it follows ``duty``.

    ``fault`` stands from the first sample on: name and severity, or none.
    """

    seed: int
    build: Build
    duty: Duty
    seconds: float
    fault: tuple[str, float] | None = None


@dataclass
class Flight:
    """What came of a scenario after :data:`SETTLED_S`; times in seconds since the first frame."""

    truth: list[RigTruth] = field(default_factory=list)
    diagnoses: list[tuple[float, Diagnosis]] = field(default_factory=list)
    authority: list[bool] = field(default_factory=list)
    events: Counter[str] = field(default_factory=Counter)
    refused: list[str] = field(default_factory=list)

    def take(self, record: PeerRecord, now_ns: int) -> None:
        """Listen to the device."""
        time_s = (now_ns - START_NS) * 1e-9
        if isinstance(record, Event):
            self.events[record.name] += 1
        elif isinstance(record, CommandReply) and not record.accepted:
            self.refused += record.reasons
        if time_s < SETTLED_S:
            return
        if isinstance(record, Diagnosis):
            self.diagnoses.append((time_s, record))
        elif isinstance(record, GuardState):
            self.authority.append(record.authority)


def fly(
    scenario: Scenario,
    rig: RigData,
    config: Config,
    models: Models,
    clearance_um: float | None = None,
) -> Flight:
    """Run a scenario through the whole device.

    Parameters
    ----------
    models
        What the brain runs.
    clearance_um
        None: the model acts (auto).  Else a person's set point (manual), narrowed by the guard to
        what it admits.
    """
    flight, codec = Flight(), codec_for(config)
    plant = Rig(
        rig,
        codec,
        node_limits(rig, config),
        scenario.seed,
        build=scenario.build,
        duty=_later(scenario.duty, SETTLED_S),
        rate_hz=config.sampling.rate_hz,
    )
    if scenario.fault is not None:
        plant.inject(*scenario.fault)
    loop = ClosedLoop(
        plant,
        GuardCore(config, codec, SESSION),
        lambda: BrainCore(config, models),
        (flight.take,),
        START_NS,
    )
    end_s, ramps, armed = SETTLED_S + scenario.seconds, _announced(scenario, config), False
    while (time_s := (loop.now_ns - START_NS) * 1e-9) < end_s:
        if not armed and time_s >= ARM_S:
            armed = True
            _arm(loop, clearance_um)
        while ramps and time_s >= ramps[0][0]:
            loop.command("announce", ramp=ramps.pop(0)[1])
        loop.step()
    flight.truth = [t for t in plant.truth if t.t_ns - START_NS > SETTLED_S * 1e9]
    return flight


def _arm(loop: ClosedLoop, clearance_um: float | None) -> None:
    loop.command("mode", mode=Mode.AUTO if clearance_um is None else Mode.MANUAL)
    loop.command("arm")
    if clearance_um is not None:
        loop.command("set_clearance", clearance_um)


def _later(duty: Duty, seconds: float) -> Duty:
    return Duty(tuple(t + seconds for t in duty.time_s), duty.speed_rpm, duty.load_N)


def _announced(scenario: Scenario, config: Config) -> list[tuple[float, PlannedRamp]]:
    """When each fast ramp is announced, s, and how."""
    lead_s = Shield(config).lead_s + ANNOUNCE_MARGIN_S
    found = []
    for ramp in fast_ramps(config, scenario.duty):
        start_s = SETTLED_S + ramp.start_s
        at_s = max(ARM_S, start_s - lead_s)
        rpm = ramp.speed_rad_s / RAD_S_PER_RPM
        plan = PlannedRamp(start_s - at_s, SETTLED_S + ramp.end_s - at_s, rpm, ramp.load_N)
        found.append((at_s, plan))
    return found


def power_figures(flight: Flight, config: Config) -> dict[str, float]:
    """Mean power, W, time with a limit broken, s, smallest film, um, and share of authority."""
    film = np.array([t.min_film_um for t in flight.truth])
    swing = np.array([t.peak_to_peak_um / t.clearance_um for t in flight.truth])
    broken = (film < config.limits.min_film_um) | (swing > config.limits.clearance_share)
    return {
        "power_W": float(np.mean([t.power_W for t in flight.truth])),
        "violation_s": 0.1 * float(broken.sum()),
        "min_film_um": float(film.min()),
        "swing_share": float(swing.max()),
        "authority_share": float(np.mean(flight.authority or [False])),
        "coasted_share": float(np.mean([t.coasting for t in flight.truth])),
        "tripped": float(flight.events["tripped"]),
        "refused": float(len(flight.refused)),
    }
