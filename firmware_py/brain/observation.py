"""The machine as it is now: figures over the last few whole turns, for predictor and actor."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from firmware_py.acquire.channel_map import ChannelMap
from firmware_py.acquire.orders import Orders
from firmware_py.acquire.windows import Window
from firmware_py.brain.measurement import Measured
from firmware_py.records import Block, Quality, RigReading

SPAN_S: Final = 0.2
"""Time over which the present is taken; shortened to whole turns."""


@dataclass(frozen=True, slots=True)
class Present:
    """The present state, SI.

    ``peak_to_peak_m`` is (x, y) in the machine's frame; ``channel_ok`` has one bit per channel.
    """

    t_acq_ns: int
    reading_ns: int
    speed_rad_s: float
    mean_m: tuple[float, float]
    peak_to_peak_m: tuple[float, float]
    probe_peak_to_peak_m: float
    supply_pressure_bar: float
    clearance_m: float
    shaft_power_W: float
    oil_outlet_C: float
    channel_ok: int
    contact_V: float = math.nan

    def measured(self) -> Measured:
        """What the predictor synchronises with."""
        return Measured(
            self.speed_rad_s,
            self.clearance_m,
            *self.mean_m,
            self.probe_peak_to_peak_m,
            self.shaft_power_W,
            self.oil_outlet_C,
            self.contact_V,
            t_ns=self.t_acq_ns,
        )


class ObserverState(msgspec.Struct):
    """How many blocks are kept, the time that they span, where they go on, and the newest
    reading."""

    blocks: int = 0
    span_ns: int = 0
    next_tick_us: int = -1
    reading: RigReading | None = None


class Observer:
    """Keeps the newest ``SPAN_S`` of blocks and the newest reading.

    Parameters
    ----------
    channels
        Conversion to SI.
    """

    def __init__(self, channels: ChannelMap) -> None:
        self._channels = channels
        self._blocks: deque[Block] = deque()
        self.state = ObserverState()

    def restore(self, state: ObserverState, blocks: Sequence[Block]) -> None:
        """Go on from ``state``; the newest of ``blocks`` are those that were kept.

        Raises
        ------
        ValueError
            There are fewer.
        """
        if len(blocks) < state.blocks:
            raise ValueError(f"the samples before this state are not all there: {len(blocks)}")
        self.state, self._blocks = state, deque(blocks[len(blocks) - state.blocks :])

    def take(self, record: Block | RigReading) -> None:
        """Note one record."""
        state = self.state
        if isinstance(record, RigReading):
            state.reading = record
            return
        if record.quality & Quality.GAP_BEFORE or record.tick_us != state.next_tick_us:
            self._blocks.clear()
            state.span_ns = 0
        state.next_tick_us = record.tick_us + record.instants * record.sample_period_us
        self._blocks.append(record)
        state.span_ns += _length_ns(record)
        while state.span_ns - _length_ns(self._blocks[0]) >= SPAN_S * 1e9:
            state.span_ns -= _length_ns(self._blocks.popleft())
        state.blocks = len(self._blocks)

    def present(self) -> Present | None:
        """The present state; None before ``SPAN_S`` of gap-free samples, a reading and a turning
        shaft."""
        reading = self.state.reading
        if reading is None or self.state.span_ns < 0.99e9 * SPAN_S:
            return None
        last, status = self._blocks[-1], reading.status
        turn_s = 2 * math.pi / last.speed_rad_s if last.speed_rad_s > 0 else math.inf
        turns = int(SPAN_S / turn_s)
        if turns < 1:
            return None
        raw = b"".join(block.samples for block in self._blocks)
        counts = self._channels.columns(np.frombuffer(raw, "<i2").reshape(-1, last.channels))
        counts = counts[-round(turns * turn_s * 1e6 / last.sample_period_us) :]
        si = self._channels.to_si(counts)
        probes = np.ptp(counts[:, :2].astype(np.int32), axis=0) * np.abs(self._channels.scale[:2])
        mean, spread = si.mean(axis=0), np.ptp(si[:, :2], axis=0)
        ok = 0xFF
        for block in self._blocks:
            ok &= self._channels.ok(block.channel_ok)
        return Present(
            t_acq_ns=last.t_acq_ns + _length_ns(last),
            reading_ns=reading.t_acq_ns,
            speed_rad_s=last.speed_rad_s,
            mean_m=(float(mean[0]), float(mean[1])),
            peak_to_peak_m=(float(spread[0]), float(spread[1])),
            probe_peak_to_peak_m=float(probes.max()),
            supply_pressure_bar=float(mean[6]),
            clearance_m=status.clearance_actual_um * 1e-6,
            shaft_power_W=status.shaft_power_W,
            oil_outlet_C=status.oil_outlet_C,
            channel_ok=ok,
            contact_V=float(mean[7]) if ok >> 7 & 1 else math.nan,
        )


def window_measured(window: Window, orders: Orders) -> tuple[Measured, complex] | None:
    """Means over a window, and the orbit's forward first order from the mark; None without readings
    or probes."""
    readings = (window.clearance_m, window.shaft_power_W, window.oil_outlet_C)
    if not np.isfinite(readings).all() or window.channel_ok & 3 != 3:
        return None
    x, y = orders.harmonics[:2, 0].tolist()
    half_m = math.hypot(orders.half_forward, orders.half_backward)
    return Measured(
        orders.speed_rad_s,
        window.clearance_m,
        float(orders.mean[0]),
        float(orders.mean[1]),
        0.0,
        window.shaft_power_W,
        window.oil_outlet_C,
        half_m=half_m,
        t_ns=window.end_ns,
    ), 0.5 * (x + 1j * y)


def _length_ns(block: Block) -> int:
    return block.instants * block.period_ns
