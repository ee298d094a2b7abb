"""A node and rig that play by script: exact amplitudes, exact times, no physics."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from math import cos, pi, sin
from struct import pack

import msgspec

from firmware_py.config import SHIPPED, Config, load
from firmware_py.guard.core import GuardCore
from firmware_py.guard.protection.permit import Start
from firmware_py.records import (
    Advice,
    Command,
    CommandRequest,
    Cycle,
    Decision,
    DeviceHeartbeat,
    Event,
    NodeInfo,
    NodeState,
    RawFrame,
    RigStatus,
    SampleFrame,
    WireMessage,
)
from firmware_py.wire.codec import CanCodec

MS = 1_000_000
SESSION = 0x1234
ROOT_2 = 2**0.5
WARM_S = 1.5
"""From the start until the guard may be armed."""


def bench() -> Config:
    """The shipped configuration of the bench rig, with a danger delay of 1 s so that tests need not
    wait for 3."""
    config = load(SHIPPED / "bench")[0]
    return config.replaced(limits=msgspec.structs.replace(config.limits, danger_delay_s=1.0))


class ScriptedNode:
    """Sends the six records on their periods; ``drift_ppm`` and ``delay_ns`` shape its clock and
    its wire."""

    def __init__(
        self, config: Config, drift_ppm: int = 0, start_tick_us: int = 4_294_000_000
    ) -> None:
        self.config = config
        self.codec = CanCodec()
        self.speed_rpm = 6000.0
        self.amplitude_um = 5.0
        self.acceleration_m_s2 = 1.0
        self.mean_um = (-10.0, -18.0)
        self.clearance_um = config.machine.actuator.safe_radial_clearance_um
        self.target_um = self.clearance_um
        self.pressure_bar = self.target_bar = config.machine.actuator.safe_pressure_bar
        self.actuate: Callable[[float], float] = lambda target_um: target_um
        """Where the actuator goes for a target; faults replace it."""
        self.rate_um_s = config.machine.actuator.rate_um_s
        self.obeys = True
        self.expires = True
        self.command_counter = 0
        self.refused = [0, 0, 0, 0]
        self._obeyed_ns = 0
        self._moved_ns = self._now_ns = 0
        self.moved = (self.clearance_um, self.pressure_bar)
        """Where the actuators went last: a measured value that a test has set stays as it is."""
        self.oil_C = 41.0
        self.power_W = 50.0
        self.supply_bar: float | None = None
        self.mode, self.session = 0, 0
        self.mark_valid = True
        self.edges: tuple[float, ...] = (0.0,)
        """Where on the shaft the mark has edges, in turns."""
        self.edge_seen: Callable[[int], bool] = lambda number: True
        self.turns_an_edge = 1
        self._edge_number = 0
        self.running = True
        self.info_boot_um = config.machine.actuator.safe_radial_clearance_um
        self.delay_ns = 100_000
        self.heard: list[WireMessage] = []
        self.frozen_channel: int | None = None
        self.lead_us = 0
        """How far this clock has run ahead of the host's, beside its drift."""
        self._drift_ppm = drift_ppm
        self._start_tick = start_tick_us
        self._counters: dict[type, int] = {}
        self._sample = 0
        self._phase, self._turns, self._mark_tick = 0.0, 0, start_tick_us
        self._slow_ms = 0

    def tick_at(self, now_ns: int) -> int:
        """Node tick at host time ``now_ns``, not wrapped."""
        return (
            self._start_tick
            + self.lead_us
            + now_ns // 1000
            + now_ns // 1000 * self._drift_ppm // 1_000_000
        )

    def restart(self) -> None:
        """Power off and on: counters and ticks begin anew."""
        self._counters.clear()
        self.session, self.mode, self.command_counter = 0, 0, 0
        self.refused = [0, 0, 0, 0]
        self._go_safe()

    def _go_safe(self) -> None:
        self.mode = 0
        self.target_um = self.config.machine.actuator.safe_radial_clearance_um
        self.target_bar = self.config.machine.actuator.safe_pressure_bar

    def _move(self, now_ns: int) -> None:
        """The actuator runs to its target at its rate; commands expire."""
        if (
            self.expires
            and now_ns - self._obeyed_ns > self.config.machine.actuator.time_to_live_ms * MS
        ):
            self._go_safe()
        way_um = self.rate_um_s * min(now_ns - self._moved_ns, 1_000 * MS) * 1e-9
        self._moved_ns = now_ns
        wanted_um = self.actuate(self.target_um)
        if self.clearance_um == self.moved[0]:
            self.clearance_um += min(max(wanted_um - self.clearance_um, -way_um), way_um)
            self.moved = (self.clearance_um, self.moved[1])
        if self.pressure_bar == self.moved[1]:
            self.pressure_bar = self.supply(self.target_bar)
            self.moved = (self.moved[0], self.pressure_bar)

    def supply(self, target_bar: float) -> float:
        """The pressure that a target gives (overwrite me)."""
        return target_bar

    def hear(self, frames: list[RawFrame]) -> None:
        """What the device said; commands are obeyed at once."""
        for frame in frames:
            message = self.codec.decode(frame)
            assert not isinstance(message, type(None))
            if isinstance(message, (Command, DeviceHeartbeat)):
                self.heard.append(message)
            if isinstance(message, Command) and self.obeys:
                self.target_um, self.session, self.mode = message.clearance_um, message.session, 1
                self.target_bar, self.command_counter = message.pressure_bar, message.counter
                self._obeyed_ns = self._now_ns

    def step(self, now_ns: int) -> list[RawFrame]:
        """Every frame that is complete at ``now_ns`` and was not before."""
        self._now_ns = now_ns
        self._move(now_ns)
        if not self.running:
            period_us = self.config.sampling.period_us
            self._sample = (self.tick_at(now_ns) - self._start_tick) // (3 * period_us)
            return []
        frames = []
        period_us = self.config.sampling.period_us
        while self._start_tick + (self._sample + 1) * 3 * period_us <= self.tick_at(now_ns):
            frames.append(self._samples(self._start_tick + self._sample * 3 * period_us, period_us))
            self._sample += 1
        if now_ns // (50 * MS) != self._slow_ms:
            self._slow_ms = now_ns // (50 * MS)
            frames += self._slow(self.tick_at(now_ns) & 0xFFFFFFFF)
        return [self.codec.encode(message, now_ns + self.delay_ns) for message in frames]

    def counter(self, kind: type) -> int:
        """The next counter of a message type."""
        self._counters[kind] = (self._counters.get(kind, -1) + 1) & 0xFFFF
        return self._counters[kind]

    def _samples(self, tick_us: int, period_us: int) -> SampleFrame:
        rows = b""
        for i in range(3):
            before, self._phase = (
                self._phase,
                self._phase + self.speed_rpm * pi / 30 * period_us * 1e-6,
            )
            for edge in self.edges:
                for angle in (2 * pi * edge, 2 * pi * (1 + edge)):
                    if before < angle <= self._phase:
                        self._edge(tick_us + i * period_us, self._phase - angle)
            if self._phase >= 2 * pi:
                self._phase -= 2 * pi
            rows += self._row(tick_us // period_us + i)
        return SampleFrame(
            self.counter(SampleFrame),
            tick_us & 0xFFFFFFFF,
            self._mark_tick & 0xFFFFFFFF,
            self._turns,
            2 * self.mark_valid,
            rows,
        )

    def _edge(self, tick_us: int, since_rad: float) -> None:
        """An edge of the mark passes, a little before the instant at ``tick_us``."""
        self._edge_number += 1
        if self.edge_seen(self._edge_number):
            self._turns = (self._turns + self.turns_an_edge) & 0xFFFF
            self._mark_tick = tick_us - round(since_rad / max(self.speed_rpm * pi / 30, 1e-9) * 1e6)

    def _row(self, n: int) -> bytes:
        a, (x, y), cosine = self.amplitude_um, self.mean_um, cos(self._phase)
        dither = n & 1
        d1 = (x + y) / ROOT_2 + a * cosine
        d2 = (y - x) / ROOT_2 + a * sin(self._phase)
        acc = round(self.acceleration_m_s2 * ROOT_2 * 100 * cosine)
        counts = [
            round(d1 * 100) + dither,
            round(d2 * 100) + dither,
            acc + dither,
            acc - dither,
            acc + dither,
            10 + dither,
            round(
                1000 * min(self.pressure_bar if self.supply_bar is None else self.supply_bar, 9.5)
            )
            + dither,
            5000 + dither,
        ]
        if self.frozen_channel is not None:
            counts[self.frozen_channel] = 0
        return pack("<8h", *counts)

    def _slow(self, tick_us: int) -> list[WireMessage]:
        a = self.config.machine.actuator
        messages: list[WireMessage] = [
            NodeState(
                self.counter(NodeState),
                tick_us,
                self.mode,
                self.session,
                self.command_counter,
                self.target_um,
                self.target_bar,
                abs(self.target_um - self.clearance_um) < 0.5,
                *self.refused,
            ),
            RigStatus(
                self.counter(RigStatus),
                tick_us,
                self.power_W,
                self.oil_C,
                self.clearance_um,
                self.pressure_bar,
            ),
        ]
        if self._slow_ms % 20 == 1:
            messages.append(
                NodeInfo(
                    self.counter(NodeInfo),
                    tick_us,
                    1,
                    self.config.sampling.period_us,
                    self.info_boot_um,
                    a.safe_pressure_bar,
                    a.time_to_live_ms,
                    a.rate_um_s,
                )
            )
        return messages


class Bench:
    """Guard core and scripted node on one simulated clock, one millisecond a cycle."""

    def __init__(
        self,
        config: Config | None = None,
        latched: list[str] | None = None,
        drift_ppm: int = 0,
        start: Start | None = None,
        timers: dict[str, int] | None = None,
    ) -> None:
        self.config = config or bench()
        self.node = ScriptedNode(self.config, drift_ppm)
        self.core = GuardCore(self.config, CanCodec(), SESSION, latched, start, timers)
        self.now_ns = 1_000 * MS
        self.seq = 0
        self.link_up = self.brain = self.gate = True
        self.memory_fault = self.link_fault = ""
        self.advise_um: float | None = None
        self.advice_seq = 0
        self.events: list[Event] = []
        self.cycles: list[Cycle] = []
        self.extra: list[RawFrame] = []
        self.tamper: Callable[[list[RawFrame]], list[RawFrame]] = list
        self.node.step(self.now_ns)

    def cycle(self, commands: list[CommandRequest] | None = None) -> Decision:
        """One millisecond."""
        self.now_ns += MS
        self.seq += 1
        sent = self.node.step(self.now_ns)
        frames = (self.tamper(sent) if self.link_up else []) + self.extra
        self.extra = []
        cycle = Cycle(
            self.seq,
            self.now_ns,
            frames,
            self.advice(),
            commands or [],
            self.brain,
            self.gate,
            self.link_up,
            self.memory_fault,
            self.link_fault,
        )
        self.cycles.append(cycle)
        decision = self.core.step(cycle)
        self.node.hear(decision.frames_out)
        self.events += decision.events
        return decision

    def run(self, seconds: float) -> list[Decision]:
        """Many milliseconds."""
        return [self.cycle() for _ in range(round(seconds * 1000))]

    def until(self, condition: Callable[[], object], within_s: float) -> None:
        """Many milliseconds, and no more than it takes."""
        end_ns = self.now_ns + round(within_s * 1000) * MS
        while not condition():
            assert self.now_ns < end_ns, f"not within {within_s:g} s; {self.names()[-5:]}"
            self.cycle()

    @property
    def authority(self) -> bool:
        """Whether the advice counts now."""
        return self.core.stages.arming.state.authority.held

    def ramp_to(self, speed_rpm: float, rate_rpm_s: float = 4000.0) -> None:
        """Change the speed as fast as a shaft can, in steps of a millisecond."""
        while self.node.speed_rpm != speed_rpm:
            step = rate_rpm_s * 1e-3
            self.node.speed_rpm += max(-step, min(step, speed_rpm - self.node.speed_rpm))
            self.cycle()

    def ask(
        self, verb: str, value: float | None = None, mode: int | None = None
    ) -> tuple[bool, list[str]]:
        """One request and its answer."""
        reply = self.cycle([CommandRequest(self.seq, verb, value, mode)]).replies[0]
        return reply.accepted, reply.reasons

    def armed(self, mode: int = 2, warm_s: float = WARM_S) -> Bench:
        """Warmed up, in ``mode``, armed."""
        self.run(warm_s)
        assert self.ask("mode", mode=mode)[0]
        accepted, reasons = self.ask("arm")
        assert accepted, reasons
        return self

    def names(self) -> list[str]:
        """Names of the events so far."""
        return [event.name for event in self.events]

    def advice(self) -> Advice | None:
        """What the brain says now."""
        if not self.brain or self.now_ns // MS % 100:
            return None
        self.advice_seq += 1
        return Advice(
            self.advice_seq,
            self.now_ns,
            self.now_ns - 5 * MS,
            300 * MS,
            self.advise_um,
            None,
            True,
            [],
            None,
        )


def warmed_up(seconds: float) -> Bench:
    """A bench that ran for so long (a fresh copy each time)."""
    return deepcopy(_warmed_up(seconds))


@cache
def _warmed_up(seconds: float) -> Bench:
    b = Bench()
    b.run(seconds)
    b.cycles.clear()
    return b


def armed(mode: int = 2) -> Bench:
    """Warmed up, in ``mode``, armed (a fresh copy each time)."""
    return warmed_up(WARM_S).armed(mode, 0.0)


def working() -> Bench:
    """Armed in auto, with authority, following an advice of 70 um (a fresh copy each time)."""
    return deepcopy(_worked_up())


@cache
def _worked_up() -> Bench:
    b = armed()
    b.advise_um = 70.0
    b.run(3.0)
    del b.cycles[:-20]
    return b
