"""What the shaft and the housing did over the last full turn: exact integer statistics of raw counts."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt
from typing import Final

import msgspec
import numpy as np

from firmware_py.config import Config
from firmware_py.records import N_CHANNELS, Block, Quality

DISPLACEMENTS: Final = (0, 1)
ACCELERATIONS: Final = (2, 3, 4)
WINDOW_S: Final = 0.1
"""The window is one full turn, and at least this long (API 670, 5th ed.: the rms time constant is of this order)."""


class BlockSums(msgspec.Struct, array_like=True, gc=False):
    """Extremes, sums and squares of one block in counts; squares of the accelerations only."""

    count: int
    lows: tuple[int, int]
    highs: tuple[int, int]
    sums: tuple[int, int, int, int, int]
    squares: tuple[int, int, int]


class Motion(msgspec.Struct, frozen=True):
    """Statistics over the window; ``complete`` says that it covers a full turn without a gap.

    Before that, peak-to-peak and rms are too small, never too large.
    """

    complete: bool
    peak_to_peak_um: tuple[float, float]
    rms_m_s2: tuple[float, float, float]
    mean_x_m: float
    mean_y_m: float


class MotionMeter:
    """Rolling statistics of displacement and acceleration.

    Parameters
    ----------
    config
        Channels (scale, angle), sampling and the slowest speed for which a full turn is awaited.
    """

    def __init__(self, config: Config) -> None:
        channels = config.channel
        self._period_s = config.sampling.period_us * 1e-6
        self._longest_s = 60.0 / max(config.limits.min_speed_rpm, 1.0)
        self._scales = [abs(channel.scale) for channel in channels]
        self._offsets = [(channels[i].scale, channels[i].offset) for i in DISPLACEMENTS]
        self._to_xy = _inverse(channels[0].angle_deg, channels[1].angle_deg)
        self.window: list[BlockSums] = []

    def step(self, block: Block) -> Motion:
        """Statistics including ``block``; a gap before it starts a new window."""
        if block.quality & Quality.GAP_BEFORE:
            self.window.clear()
        self.window.append(_sums(block))
        needed_s = min(2 * pi / block.speed_rad_s, self._longest_s) if block.speed_rad_s > 0 else self._longest_s
        needed = max(needed_s, WINDOW_S) / self._period_s
        total = sum(b.count for b in self.window)
        while total - self.window[0].count >= needed:
            total -= self.window.pop(0).count
        return self._motion(total, needed)

    def _motion(self, n: int, needed: float) -> Motion:
        window = self.window
        spans = [max(b.highs[i] for b in window) - min(b.lows[i] for b in window) for i in DISPLACEMENTS]
        sums = [sum(b.sums[i] for b in window) for i in range(len(DISPLACEMENTS) + len(ACCELERATIONS))]
        squares = [sum(b.squares[j] for b in window) for j in range(len(ACCELERATIONS))]
        a, b = (sums[i] / n * scale + offset for i, (scale, offset) in zip(DISPLACEMENTS, self._offsets, strict=True))
        (xa, xb), (ya, yb) = self._to_xy

        def rms(i: int) -> float:
            """Of the alternating part; what is missing of the window counts as still."""
            square = n * squares[i - ACCELERATIONS[0]] - sums[i] * sums[i]
            return sqrt(square / (n * max(float(n), needed))) * self._scales[i]

        return Motion(
            complete=n >= needed,
            peak_to_peak_um=(spans[0] * self._scales[0] * 1e6, spans[1] * self._scales[1] * 1e6),
            rms_m_s2=(rms(2), rms(3), rms(4)),
            mean_x_m=xa * a + xb * b, mean_y_m=ya * a + yb * b,
        )


def _sums(block: Block) -> BlockSums:
    counts = np.frombuffer(block.samples, "<i2").reshape(-1, N_CHANNELS)[:, : 1 + ACCELERATIONS[-1]]
    wide = counts.astype(np.int64)
    lows, highs = counts[:, :2].min(axis=0).tolist(), counts[:, :2].max(axis=0).tolist()
    return BlockSums(len(counts), tuple(lows), tuple(highs), tuple(wide.sum(axis=0).tolist()),
                     tuple((wide[:, 2:] * wide[:, 2:]).sum(axis=0).tolist()))


def _inverse(first_deg: float, second_deg: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Matrix from two probe readings to (x, y); probes measure ``x cos(a) + y sin(a)``.

    Rounded to 12 digits, so that differences between math libraries cannot reach a decision.
    """
    c1, s1 = cos(radians(first_deg)), sin(radians(first_deg))
    c2, s2 = cos(radians(second_deg)), sin(radians(second_deg))
    det = c1 * s2 - c2 * s1
    return ((round(s2 / det, 12), round(-s1 / det, 12)), (round(-c2 / det, 12), round(c1 / det, 12)))
