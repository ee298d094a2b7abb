"""A node that only measures: sample frames of any rig of wire schema 2, by script, no physics.

Every bearing has an orbit of its own, ``x + jy = mean + forward exp(j a) + backward exp(-j a) +
half exp(j 0.47 a)`` over the shaft angle ``a``, seen by its probes; other channels are quiet noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import pi

import numpy as np

from firmware_py import signals
from firmware_py.config import Config
from firmware_py.config.bearings import views
from firmware_py.config.instances import slow_signals
from firmware_py.device import Device
from firmware_py.guard.core import GuardCore
from firmware_py.records import (
    Cycle,
    Decision,
    Event,
    NodeInfo,
    PeerRecord,
    RawFrame,
    ReadingsFrame,
    SampleFrame,
)
from firmware_py.wire.codec import CanCodec
from firmware_py.wire.layout import WireLayout

MS = 1_000_000
MARK_VALID = 2
HALF = 0.47
DELAY_NS = 200_000


@dataclass
class Orbit:
    """Amplitudes in um; complex: with their phases."""

    mean_um: complex = -20 - 40j
    forward_um: complex = 8.0
    backward_um: complex = 0.0
    half_um: complex = 0.0
    second_um: complex = 1.0
    noise_um: float = 0.1


class MeasuringNode:
    """Sends SAMPLES and NODE_INFO, and READINGS where the rig has any."""

    def __init__(self, config: Config, seed: int = 1) -> None:
        self.config, self.layout = config, WireLayout.of(config)
        self.codec = CanCodec(self.layout)
        self.speed_rpm = 3000.0
        self.orbits = {view.name: Orbit() for view in views(config)}
        self.readings: dict[str, float] = {row.name: 0.0 for row in slow_signals(config)}
        self.dead: set[str] = set()
        """Channels whose cable is broken: at their rail."""
        self.heard: list[RawFrame] = []
        self._random = np.random.default_rng(seed)
        self._turned = 0.0
        self._sample = 0
        self._mark_us = self._turns = 0
        self._edges: list[int] = []
        self._whole = 0
        self._counters: dict[type, int] = {}

    def frames(self, until_ns: int) -> list[RawFrame]:
        """All that it sends up to ``until_ns``, the sample clock counted from 0."""
        period_us, n = self.layout.period_us, self.layout.instants
        found = []
        while (self._sample + n) * period_us * 1000 <= until_ns:
            found.append(self._encode(self._samples(), until_ns))
            frame = self._sample // n
            if frame % max(1, 50_000 // (n * period_us)) == 0:
                found += self._slow(until_ns)
        return found

    def _encode(self, message: SampleFrame | NodeInfo | ReadingsFrame, now_ns: int) -> RawFrame:
        return self.codec.encode(message, now_ns)

    def _count(self, kind: type) -> int:
        number = self._counters.get(kind, -1) + 1
        self._counters[kind] = number
        return number & 0xFFFF

    def _samples(self) -> SampleFrame:
        period_us, n = self.layout.period_us, self.layout.instants
        tick_us = self._sample * period_us
        per_sample = self.speed_rpm / 60.0 * period_us * 1e-6
        angles = self._turned + per_sample * np.arange(n)
        last_us = tick_us + (n - 1) * period_us
        for k in range(n):
            whole = int(angles[k] + per_sample + 1e-9)
            if whole > self._whole:
                self._whole, share = whole, (whole - angles[k]) / per_sample
                self._edges.append(round(tick_us + (k + share) * period_us))
        while self._edges and self._edges[0] <= last_us:  # a later one is told with the next frame
            self._mark_us, self._turns = self._edges.pop(0), self._turns + 1
        counts = np.column_stack(
            [self._channel(i, angles) for i in range(len(self.layout.channels))]
        )
        self._turned += per_sample * n
        self._sample += n
        return SampleFrame(
            self._count(SampleFrame),
            tick_us & 0xFFFFFFFF,
            self._mark_us & 0xFFFFFFFF,
            self._turns & 0xFFFF,
            MARK_VALID if self._turns else 0,
            np.clip(np.round(counts), -32768, 32767).astype("<i2").tobytes(),
        )

    def _channel(self, i: int, turned: np.ndarray) -> np.ndarray:
        channel = self.config.machine.channel[i]
        kind = signals.fast_kind(channel.name, channel.kind)
        assert kind is not None
        wire = channel.wire_scale or kind.wire_scale
        if channel.name in self.dead:
            return np.full(len(turned), 32767.0)
        noise = self._random.standard_normal(len(turned))
        if kind.name != "displacement":
            return 20.0 * noise
        orbit = self.orbits.get(channel.bearing) or next(iter(self.orbits.values()))
        a = 2 * pi * turned
        path = (
            orbit.mean_um
            + orbit.forward_um * np.exp(1j * a)
            + orbit.backward_um * np.exp(-1j * a)
            + orbit.second_um * np.exp(2j * a)
            + orbit.half_um * np.exp(1j * HALF * a)
        )
        seen_um = np.real(path * np.exp(-1j * np.radians(channel.angle_deg)))
        return np.asarray((seen_um + orbit.noise_um * noise) * 1e-6 / wire)

    def _slow(self, now_ns: int) -> list[RawFrame]:
        tick_us = self._sample * self.layout.period_us & 0xFFFFFFFF
        info = NodeInfo(
            self._count(NodeInfo), tick_us, 2, self.layout.period_us, 0.0, 0.0, 100, 0.0,
            self.layout.hash,
        )  # fmt: skip
        pages = []
        for page in range(self.layout.pages):
            rows = self.layout.page(page)
            values = tuple(self.readings[row.name] for row in rows)
            pages.append(
                ReadingsFrame(
                    self._count(ReadingsFrame), tick_us, page, values, (0,) * len(rows),
                    (0,) * len(rows),
                )
            )  # fmt: skip
        return [self._encode(each, now_ns) for each in (info, *pages)]


class Run:
    """Guard, and brain where one is made, over the frames of a node; events and records kept."""

    def __init__(self, config: Config, brain: object = None, latched: Iterable[str] = ()) -> None:
        self.node = MeasuringNode(config)
        self.guard = GuardCore(config, CanCodec(WireLayout.of(config)), 0x1234, list(latched))
        self.said: list[PeerRecord] = []
        self.device = Device(
            self.guard,
            (lambda: brain) if brain is not None else None,  # type: ignore[arg-type,return-value]
            [lambda record, _t: self.said.append(record)],
        )
        self.now_ns = 0
        self.last: Decision | None = None

    def seconds(self, seconds: float, step_ms: int = 2) -> None:
        """Let time pass."""
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.now_ns += step_ms * MS
            frames = self.node.frames(self.now_ns)
            self.last = self.device.step(self.now_ns + DELAY_NS, frames)
            self.node.heard += self.last.frames_out

    @property
    def events(self) -> list[str]:
        """Names of all events so far."""
        return [record.name for record in self.said if isinstance(record, Event)]

    def alarms(self) -> set[str]:
        """Names of what stands now."""
        from firmware_py.guard import report

        return {alarm.name for alarm in report.standing(self.guard.stages)}


def cycle(seq: int, now_ns: int, frames: list[RawFrame]) -> Cycle:
    """One cycle without rooms."""
    return Cycle(seq, now_ns, frames, None, [], False, False, True)
