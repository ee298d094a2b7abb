"""What the shaft and the housing did over the last full turn: exact integer statistics of raw
counts."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt
from typing import Final

import msgspec
import numpy as np

from firmware_py.config import Config
from firmware_py.config.instances import places
from firmware_py.machine import FastChannel
from firmware_py.records import Block, Quality

DISPLACEMENTS: Final = (0, 1)
"""The two probes of the bearing are always the first channels."""
KEPT: Final = 3.0
WINDOW_S: Final = 0.1
"""The window is one full turn, and at least this long (API 670, 5th ed.: the rms time constant is
of this order)."""


class BlockSums(msgspec.Struct, array_like=True, gc=False):
    """Extremes, sums and squares of one block in counts, of the watched channels in their order;
    squares of the accelerations only.

    ``unusable`` has the bits of channels that are not to be judged by this block; ``gap`` says that
    samples are missing before it; ``t_ns`` is when it began.
    """

    count: int
    lows: tuple[int, int]
    highs: tuple[int, int]
    sums: tuple[int, ...]
    squares: tuple[int, ...]
    unusable: int = 0
    gap: bool = False
    t_ns: int = 0


class ShaftMotion(msgspec.Struct, frozen=True):
    """Statistics over the window; ``complete`` says that it covers a full turn of both
    displacements without a gap.

    ``whole`` says the same of each watched channel: the displacements, then the accelerations.
    Before that, peak-to-peak and rms are too small, never too large.
    """

    complete: bool
    peak_to_peak_um: tuple[float, float]
    rms_m_s2: tuple[float, ...]
    mean_x_m: float
    mean_y_m: float
    whole: tuple[bool, ...] = (False, False, False, False, False)


def watched(channels: list[FastChannel]) -> tuple[int, ...]:
    """Channels whose vibration protection judges: the two displacements, then the accelerations."""
    return DISPLACEMENTS + places(channels).accelerations


class Good(msgspec.Struct, gc=False):
    """Blocks of one channel that may be judged, the samples in them, and whether they cover the
    window without a hole."""

    blocks: list[BlockSums]
    count: int
    whole: bool


class MotionMeter:
    """Rolling statistics of displacement and acceleration.

    Around a gap, or a block that is not to be judged, the window keeps what is good for up to
    :data:`KEPT` times its length: a loss every few milliseconds must not make a vibration look
    small.

    Parameters
    ----------
    config
        Channels (scale, angle), sampling and the slowest speed for which a full turn is awaited.
    """

    def __init__(self, config: Config) -> None:
        channels = config.machine.channel
        self._period_s = config.sampling.period_us * 1e-6
        self._longest_s = 60.0 / max(config.limits.min_speed_rpm, 1.0)
        self._scales = [abs(channel.scale) for channel in channels]
        self._offsets = [(channels[i].scale, channels[i].offset) for i in DISPLACEMENTS]
        self._watched = watched(channels)
        n = len(self._watched)
        self._columns = slice(n) if self._watched == tuple(range(n)) else list(self._watched)
        self._mask = sum(1 << i for i in self._watched)
        self._to_xy = probes_to_xy(channels[0].angle_deg, channels[1].angle_deg)
        self.window: list[BlockSums] = []

    def step(self, block: Block) -> ShaftMotion:
        """Statistics including ``block``."""
        window = self.window
        window.append(self._sums(block))
        turn_s = 2 * pi / block.speed_rad_s if block.speed_rad_s > 0 else self._longest_s
        needed_s = max(min(turn_s, self._longest_s), WINDOW_S)
        needed = needed_s / self._period_s
        oldest_ns = block.t_acq_ns - round(KEPT * needed_s * 1e9)
        while window[0].t_ns < oldest_ns:
            del window[0]
        masks = {b.unusable for b in window}
        if masks != {0} or any(b.gap for b in window):
            found: dict[tuple[int, ...], Good] = {}
            alike = [tuple([mask >> i & 1 for mask in masks]) for i in self._watched]
            for i, left_out in zip(self._watched, alike, strict=True):
                if left_out not in found:  # channels left out of the same blocks share one
                    found[left_out] = self._newest(i, needed)
            return self._motion([found[left_out] for left_out in alike], needed)
        total = sum([b.count for b in window])
        while total - window[0].count >= needed:
            total -= window.pop(0).count
        good = Good(window, total, total >= needed)
        return self._motion([good] * len(self._watched), needed)

    def _newest(self, i: int, needed: float) -> Good:
        """Newest blocks of channel ``i`` that may be judged."""
        good, n, hole = list[BlockSums](), 0, False
        for b in reversed(self.window):
            if b.unusable >> i & 1:
                hole = True
                continue
            good.append(b)
            n += b.count
            if n >= needed:
                break
            hole = hole or b.gap
        return Good(good, n, n >= needed and not hole)

    def _motion(self, good: list[Good], needed: float) -> ShaftMotion:
        """Of the good blocks of each channel; the mean position of those that are good on both
        probes."""
        both, n = good[0].blocks, good[0].count
        if good[0] is not good[1]:
            both = [b for b in both if not b.unusable >> DISPLACEMENTS[1] & 1]
            n = sum([b.count for b in both])
        n = max(n, 1)
        whole = [each.whole for each in good]
        a, b = (
            sum([block.sums[i] for block in both]) / n * scale + offset
            for i, (scale, offset) in zip(DISPLACEMENTS, self._offsets, strict=True)
        )
        (xa, xb), (ya, yb) = self._to_xy

        def span_um(i: int) -> float:
            blocks = good[i].blocks
            return (
                (max([b.highs[i] for b in blocks]) - min([b.lows[i] for b in blocks]))
                * self._scales[i]
                * 1e6
                if blocks
                else 0.0
            )

        def rms(i: int) -> float:
            """Of the alternating part; what is missing of the window counts as still."""
            blocks, n = good[i].blocks, good[i].count
            total = sum([b.sums[i] for b in blocks])
            square = n * sum([b.squares[i - len(DISPLACEMENTS)] for b in blocks]) - total * total
            scale = self._scales[self._watched[i]]
            return sqrt(square / (n * max(float(n), needed))) * scale if n else 0.0

        return ShaftMotion(
            complete=whole[0] and whole[1],
            peak_to_peak_um=(span_um(0), span_um(1)),
            rms_m_s2=tuple(rms(i) for i in range(len(DISPLACEMENTS), len(self._watched))),
            mean_x_m=xa * a + xb * b,
            mean_y_m=ya * a + yb * b,
            whole=tuple(whole),
        )

    def _sums(self, block: Block) -> BlockSums:
        counts = np.frombuffer(block.samples, "<i2").reshape(-1, block.channels)
        wide = counts[:, self._columns].astype(np.int64)
        lows, highs = counts[:, :2].min(axis=0).tolist(), counts[:, :2].max(axis=0).tolist()
        return BlockSums(
            len(counts),
            tuple(lows),
            tuple(highs),
            tuple(wide.sum(axis=0).tolist()),
            tuple((wide[:, 2:] * wide[:, 2:]).sum(axis=0).tolist()),
            block.unusable & self._mask,
            bool(block.quality & Quality.GAP_BEFORE),
            block.t_acq_ns,
        )


def probes_to_xy(
    first_deg: float, second_deg: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Matrix from two probe readings to (x, y); probes measure ``x cos(a) + y sin(a)``.

    Rounded to 12 digits, so that differences between math libraries cannot reach a decision.
    """
    c1, s1 = cos(radians(first_deg)), sin(radians(first_deg))
    c2, s2 = cos(radians(second_deg)), sin(radians(second_deg))
    det = c1 * s2 - c2 * s1
    return (
        (round(s2 / det, 12), round(-s1 / det, 12)),
        (round(-c2 / det, 12), round(c1 / det, 12)),
    )
