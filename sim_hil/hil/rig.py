"""The whole rig behind the bus: machine, sensors, actuator node and drive, as one pure stage.

``rig.step(now_ns, frames_in)`` advances the physics to ``now_ns`` and returns every frame due since
the last call, exactly as it would cross the wire.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final

import msgspec
import numpy as np

from firmware_py.config import Config
from firmware_py.records import (
    Command,
    DeviceHeartbeat,
    DriveState,
    NodeFigures,
    NodeInfo,
    NodeState,
    RawFrame,
    ReadingQuality,
    ReadingsFrame,
    RigStatus,
    WireMessage,
)
from firmware_py.wire.layout_fields import SampleFlag
from firmware_py.wire.link import Codec
from sim_hil.faults import ACTUATOR_FAULTS, NODE_FAULTS, FaultSet, check_fault
from sim_hil.faults.actuator import Reach, reached
from sim_hil.hil.drive_link import DriveLink
from sim_hil.hil.node import Node, NodeLimits
from sim_hil.hil.sampler import COUNTERS, TICKS, Sampler
from sim_hil.plant.build import Build
from sim_hil.plant.drive import HEARTBEAT_LIMIT_DEFAULT_S, SimulatedDrive
from sim_hil.plant.duty import RAD_S_PER_RPM, Duty
from sim_hil.plant.machine import Batch, SimulatedMachine, TrueReadings
from sim_hil.plant.truth import RigTruth, TruthKeeper
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import TRUTH_COLUMNS

STATE_US: Final = 50_000
INFO_US: Final = 1_000_000
CLOCK_PPM: Final = 50.0
BEHIND_MS: Final = 20.0
"""Later than this, sample frames carry the flag that says so."""

GIVE_UP_MS: Final = 500.0
"""A rig that was stopped longer than this leaves the time out instead of catching up."""

CHUNK_PERIODS: Final = 50
ARRIVED_M: Final = 1.5e-6
"""Backlash and half a micrometre."""

ARRIVED_PA: Final = 2e3
_POWER: Final = TRUTH_COLUMNS.index("shaft_power_W")


def node_limits(rig: RigData, config: Config) -> NodeLimits:
    """The node that belongs to ``rig``, set up for the retreat value of ``config``."""
    return NodeLimits(
        boot_clearance_um=config.machine.actuator.safe_radial_clearance_um,
        boot_pressure_bar=config.machine.actuator.safe_pressure_bar,
        clearance_um=(rig.bearing.clearance_min_m * 1e6, rig.bearing.clearance_max_m * 1e6),
        pressure_bar=(rig.supply.min_Pa * 1e-5, rig.supply.max_Pa * 1e-5),
        time_to_live_ms=config.machine.actuator.time_to_live_ms,
        rate_um_s=rig.actuator.rate_m_per_s * 1e6,
    )


class Rig:
    """One rig on one wire.

    Parameters
    ----------
    rig, build
        What is fixed, and how this example differs (the drawing itself when None).
    codec, limits
        The wire's codec; the node's boot values and ranges.
    seed
        Of noise, clock offset and drift, reading errors.
    duty
        Speed and load from the first step on (the rig's start when None).
    rate_hz
        Sampling rate.
    coast_on_silence
        Whether a lost device heartbeat stops the drive.
    heartbeat_limit_s
        How long the device may be silent before it does.
    fed
        Whether the supply pressure acts in the film (``SimulatedMachine``).

    Attributes
    ----------
    lag_ms_max, periods_left_out
        How far a step ever lay behind real time, and sampling periods skipped because it was too
        far.
    """

    def __init__(
        self,
        rig: RigData,
        codec: Codec,
        limits: NodeLimits,
        seed: int,
        *,
        build: Build | None = None,
        duty: Duty | None = None,
        rate_hz: int = 5000,
        coast_on_silence: bool = True,
        fed: bool = False,
        heartbeat_limit_s: float = HEARTBEAT_LIMIT_DEFAULT_S,
    ) -> None:
        self._rng = np.random.default_rng([seed, 2])
        self._codec, self._layout = codec, codec.layout
        self.node = Node(limits)
        self.drive = SimulatedDrive(
            rig.drive,
            duty or Duty.hold(rig.start_rpm, rig.start_load_N),
            coast_on_silence=coast_on_silence,
            heartbeat_limit_s=heartbeat_limit_s,
        )
        self.machine = SimulatedMachine(
            rig,
            Build.nominal(rig) if build is None else build,
            seed,
            rate_hz=rate_hz,
            clearance_m=limits.boot_clearance_um * 1e-6,
            pressure_Pa=limits.boot_pressure_bar * 1e5,
            fed=fed,
        )
        self._drive_faults: FaultSet = {}
        self.lag_ms_max = 0.0
        self.periods_left_out = 0
        self._period_us = round(1e6 / rate_hz)
        self._drift = float(self._rng.uniform(-CLOCK_PPM, CLOCK_PPM)) * 1e-6
        self._tick0 = int(self._rng.integers(TICKS))
        self._power_error_W = float(
            self._rng.uniform(-rig.errors.shaft_power_W, rig.errors.shaft_power_W)
        )
        self._oil_error_C = float(self._rng.uniform(-rig.errors.oil_C, rig.errors.oil_C))
        self._sampler = Sampler(
            codec.layout, self._period_us, round(self.machine.delay_s * 1e6), self._tick0
        )
        self._truth = TruthKeeper(self.machine)
        self._drive_link = DriveLink(self.drive, limits.time_to_live_ms, rig)
        self._start_ns: int | None = None
        self._periods = 0
        self._counters: Counter[type] = Counter()
        self._power_W: list[float] = []

    @property
    def time_s(self) -> float:
        """Simulated time, s, on the node's clock."""
        return self._elapsed_us * 1e-6

    @property
    def truth(self) -> deque[RigTruth]:
        """What was true, one entry per tenth of a second of the last hour."""
        return self._truth.entries

    @property
    def _elapsed_us(self) -> int:
        return self._periods * self._period_us

    def inject(self, fault: str, severity: float) -> None:
        """Set a fault of :mod:`sim_hil.faults` from now on; UnknownFault when there is no such."""
        if fault in ACTUATOR_FAULTS or fault in NODE_FAULTS:
            check_fault(fault, severity)
            self._drive_faults[fault] = severity
        else:
            self.machine.inject(fault, severity)

    @property
    def faults(self) -> FaultSet:
        """Present faults of machine, sensors, actuators and node, and their severities."""
        return self.machine.faults | self._drive_faults

    def clear(self) -> None:
        """Remove all faults."""
        self.machine.heal()
        self._drive_faults.clear()

    def set_operating(self, speed_rpm: float, load_N: float, ramp_s: float = 0.0) -> None:
        """Go to a speed and a static bearing load in ``ramp_s`` and stay."""
        self.drive.operate(speed_rpm, load_N, ramp_s, self.time_s)

    def follow(self, duty: Duty) -> None:
        """Follow ``duty`` from now on."""
        self.drive.follow(duty, self.time_s)

    def step(self, now_ns: int, frames_in: list[RawFrame]) -> list[RawFrame]:
        """Advance to ``now_ns``; everything in ``frames_in`` arrived at the node just now.

        Returns
        -------
        All frames due since the last call, in the order in which they go out.
        """
        if self._start_ns is None:
            self._start_ns = now_ns
        now_us = round((now_ns - self._start_ns) * (1 + self._drift)) // 1000
        self._take(frames_in, self._tick0 + now_us)
        due, behind = self._account(now_us // self._period_us - self._periods)
        out: list[RawFrame] = []
        while due > 0:
            n = min(due, CHUNK_PERIODS)
            out += [
                self._codec.encode(message, now_ns) for message in self._advance(n, now_ns, behind)
            ]
            due -= n
        return out

    def _account(self, due: int) -> tuple[int, bool]:
        """Periods to simulate and whether they are late; beyond :data:`GIVE_UP_MS` whole frames are
        left out."""
        lag_ms = due * self._period_us * 1e-3
        self.lag_ms_max = max(self.lag_ms_max, lag_ms)
        if lag_ms > GIVE_UP_MS:
            instants = self._sampler.instants
            frames = due // instants
            self._sampler.skip(frames)
            self._periods += frames * instants
            self.periods_left_out += frames * instants
            due -= frames * instants
        return due, lag_ms > BEHIND_MS

    def _take(self, frames_in: list[RawFrame], tick_us: int) -> None:
        """Hand what arrived to node and drive."""
        messages = [self._codec.decode(frame) for frame in frames_in]
        for message in messages:
            if isinstance(message, DeviceHeartbeat):
                self.drive.hear(message, tick_us)
        self._drive_link.receive(messages, tick_us, self.time_s)
        if self._drive_faults.get("node_refuses"):
            messages = [_outdated(m, tick_us) if isinstance(m, Command) else m for m in messages]
        self.node.receive(messages, tick_us)

    def _reached(self) -> tuple[float, float]:
        """Where the actuators are sent: the node's targets, unless they are ill."""
        targets = self.node.clearance_um * 1e-6, self.node.pressure_bar * 1e5
        if not self._drive_faults:
            return targets
        limits = self.node.limits
        lead_m = limits.rate_um_s * 1e-6 * self.machine.rig.actuator.time_constant_s
        low_m, high_m = (um * 1e-6 for um in limits.clearance_um)
        return reached(
            Reach(
                *targets,
                self.machine.readings().clearance_m,
                limits.boot_clearance_um * 1e-6,
                (low_m, high_m),
                lead_m,
            ),
            self._drive_faults,
        )

    def _advance(self, n: int, now_ns: int, behind: bool) -> list[WireMessage]:
        """``n`` sampling periods, and what is to be said after them."""
        start_us = self._elapsed_us
        self.node.expire(self._tick0 + start_us)
        self.drive.watch(self._tick0 + start_us)
        self._drive_link.expire(self._tick0 + start_us)
        drive = self.drive.advance(self.time_s, self.machine.period_s, n)
        batch = self.machine.advance(drive, *self._reached())
        self._periods += n
        self._truth.add(batch.truth, now_ns, self.node.clearance_um, self.drive.coasting)
        return [
            *self._sampler.frames(batch, start_us, self._flags(behind)),
            *self._slow(batch, start_us),
        ]

    def _flags(self, behind: bool) -> int:
        return behind * SampleFlag.BEHIND.value + self.drive.coasting * SampleFlag.COASTING.value

    def _slow(self, batch: Batch, before_us: int) -> list[WireMessage]:
        """Status, state and info when their time has come."""
        messages: list[WireMessage] = []
        self._power_W.extend(batch.truth[:, _POWER].tolist())
        if self._elapsed_us // STATE_US > before_us // STATE_US:
            now = self.machine.readings()
            messages += [*self._readings(self._status(now)), self._state(now)]
            if self._layout.schema > 1:
                messages.append(self._drive_link.state(self._count(DriveState), self._tick))
        if self._elapsed_us // INFO_US > before_us // INFO_US:
            if self._layout.schema > 1:
                messages.append(self._figures())
            messages.append(self._info())
        return messages

    def _readings(self, status: RigStatus) -> list[WireMessage]:
        """The status as the layout's schema carries it."""
        if self._layout.schema == 1:
            return [status]
        told = self._slow_values(status)
        pages: list[WireMessage] = []
        for number in range(self._layout.pages):
            page = [told.get(row.name) for row in self._layout.page(number)]
            pages.append(
                ReadingsFrame(
                    self._count(ReadingsFrame),
                    status.tick_us,
                    number,
                    tuple(0.0 if value is None else value for value in page),
                    tuple(2550 if value is None else 0 for value in page),
                    tuple(
                        int(ReadingQuality.ABSENT if value is None else ReadingQuality.OK)
                        for value in page
                    ),
                )
            )
        return pages

    def _slow_values(self, status: RigStatus) -> dict[str, float]:
        """The readings that this rig has, by name: the standard ones, and what the drive knows."""
        return {
            "shaft_power": status.shaft_power_W,
            "oil_outlet": status.oil_outlet_C,
            "clearance_actual": status.clearance_actual_um,
            "pressure_actual": status.pressure_actual_bar,
            "drive_speed": self.drive.speed_rad_s / RAD_S_PER_RPM,
            "drive_load": self.drive.load_N,
            "drive_torque": status.shaft_power_W / max(self.drive.speed_rad_s, 1.0),
        }

    def _figures(self) -> NodeFigures:
        limits, rig = self.node.limits, self.machine.rig
        return NodeFigures(
            counter=self._count(NodeFigures),
            tick_us=self._tick,
            heartbeat_limit_ms=round(self.drive.heartbeat_limit_s * 1e3),
            coasts_on_silence=self.drive.coasts_on_silence,
            drive_commandable=True,
            clearance_min_um=limits.clearance_um[0],
            clearance_max_um=limits.clearance_um[1],
            pressure_min_bar=limits.pressure_bar[0],
            pressure_max_bar=limits.pressure_bar[1],
            clearance_lag_ms=round(rig.actuator.time_constant_s * 1e3),
            pressure_lag_ms=round((rig.supply.dead_time_s + rig.supply.time_constant_s) * 1e3),
            drive_time_to_live_ms=self._drive_link.time_to_live_ms,
            speed_min_rpm=self._drive_link.speed_rpm[0],
            speed_max_rpm=self._drive_link.speed_rpm[1],
            load_min_N=self._drive_link.load_N[0],
            load_max_N=self._drive_link.load_N[1],
        )

    def _status(self, now: TrueReadings) -> RigStatus:
        noise_m = self.machine.rig.actuator.position_noise_rms_m
        clearance_m = now.clearance_m + noise_m * float(self._rng.standard_normal())
        power_W = sum(self._power_W) / len(self._power_W)
        self._power_W.clear()
        return RigStatus(
            counter=self._count(RigStatus),
            tick_us=self._tick,
            shaft_power_W=power_W + self._power_error_W,
            oil_outlet_C=now.oil_C + self._oil_error_C,
            clearance_actual_um=max(0.0, clearance_m * 1e6),
            pressure_actual_bar=max(0.0, now.pressure_Pa * 1e-5),
        )

    def _state(self, now: TrueReadings) -> NodeState:
        there = abs(now.clearance_m - self.node.clearance_um * 1e-6) <= ARRIVED_M
        there &= abs(now.pressure_Pa - self.node.pressure_bar * 1e5) <= ARRIVED_PA
        return self.node.state(self._count(NodeState), self._tick, there)

    def _info(self) -> NodeInfo:
        limits = self.node.limits
        return NodeInfo(
            counter=self._count(NodeInfo),
            tick_us=self._tick,
            schema=self._layout.schema,
            sample_period_us=self._period_us,
            boot_clearance_um=limits.boot_clearance_um,
            boot_pressure_bar=limits.boot_pressure_bar,
            time_to_live_ms=limits.time_to_live_ms,
            rate_um_s=limits.rate_um_s,
            layout_hash=self._layout.hash,
        )

    @property
    def _tick(self) -> int:
        return (self._tick0 + self._elapsed_us) % TICKS

    def _count(self, kind: type) -> int:
        count = self._counters[kind]
        self._counters[kind] += 1
        return count % COUNTERS


def _outdated(command: Command, tick_us: int) -> Command:
    """The command as a node reads it whose clock is ten seconds off."""
    return msgspec.structs.replace(command, echo_tick_us=(tick_us - 10_000_000) % TICKS)
