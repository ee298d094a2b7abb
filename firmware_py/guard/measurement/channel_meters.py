"""What one channel, or an orbit, did over the last turns: the values of measures that are added to
the table.

Each meter keeps pieces of blocks over its window.  Integers and + - x / sqrt alone, in fixed order:
the same on every machine.

* peak-to-peak, rms and mean: exact over the window, as :mod:`.motion`.
* 1X and not-1X: least squares of mean, cosine and sine at the told speed; the residual's energy is
  given as the peak-to-peak of a sine that has it.
* Smax: the greatest distance of the orbit from its mean over the window (ISO 20816-1:2016, S_max).
* velocity: acceleration through ``s / (s2 + sqrt2 w s + w2)``, integration and second-order
  high-pass in one, bilinear; a three-tap filter takes off the bilinear error to 0.5 % up to 0.12 of
  the sampling rate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import cos, pi, sqrt, tan
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.config import Config
from firmware_py.guard.measurement.motion import KEPT, probes_to_xy
from firmware_py.machine import FastChannel
from firmware_py.records import Block, Quality

WINDOW_S: Final = 0.1
"""Least window of peak-to-peak and Smax; also one turn."""

SUMS_WINDOW_S: Final = 0.5
"""Least window of rms and mean: a part of a turn at its end changes them by less than 0.5 %."""

ORDER_WINDOW_S: Final = 0.25
ORDER_TURNS: Final = 12.0
"""Least window of 1X and not-1X: motion at half of the speed leaks by less than 3 %."""

VELOCITY_WINDOW_S: Final = 0.5
SETTLED_S: Final = 1.0
"""After a restart the high-pass has forgotten how it began."""

CORNER_SHARE: Final = 1.0 / 3.0
"""Corner of the high-pass below the low end of the band: there it takes 0.6 %."""

BRIDGED_S: Final = 0.05
"""A longer gap is not bridged: the meter begins anew."""

_STEPS: Final = 4096
_UNIT: Final = 16384
_COSINE: Final = np.array(
    [round(_UNIT * cos(2 * pi * i / _STEPS)) for i in range(_STEPS)], np.int64
)
Counts = NDArray[np.integer[Any]]


class Piece(msgspec.Struct, array_like=True, gc=False):
    """What a meter keeps of one block; ``gap``: something is missing before it."""

    t_ns: int
    count: int
    gap: bool
    sums: list[int] = []
    energy: float = 0.0
    raw: bytes = b""


class MeterState(msgspec.Struct):
    """The window of a meter; ``turns``: angle told by the marks; ``carry``: memory of its filter;
    ``fed``: samples since it began; ``next_us``: tick of the sample that follows."""

    pieces: list[Piece] = []
    turns: float = 0.0
    carry: list[float] = []
    fed: int = 0
    next_us: int = -1


class Metered(NamedTuple):
    """The value of a window, in the unit of people, and whether the window is whole."""

    value: float
    whole: bool


class ChannelMeter(ABC):
    """Base of the meters: which blocks are in the window.

    Parameters
    ----------
    config
        Sampling, and the slowest speed for which a turn is awaited.
    channels
        Places of the channels in a block.
    """

    least_s, turns = WINDOW_S, 1.0

    def __init__(self, config: Config, channels: tuple[int, ...]) -> None:
        self.channels = list(channels)
        self._mask = sum(1 << i for i in channels)
        self._period_s = config.sampling.period_us * 1e-6
        self._longest_s = 60.0 / max(config.limits.min_speed_rpm, 1.0)
        self._turn_s = self._longest_s
        self.state = MeterState(pieces=[])

    def step(self, block: Block) -> Metered | None:
        """The value including ``block``; None while nothing can be said."""
        s = self.state
        gap_us = block.tick_us - s.next_us if s.next_us >= 0 else 0
        missing = bool(block.quality & Quality.GAP_BEFORE) or gap_us > 0
        if not 0 <= gap_us <= BRIDGED_S * 1e6:
            s.turns, s.carry, s.fed = 0.0, [], 0
            gap_us = 0
        if block.unusable & self._mask:
            return self._value_now(block)
        counts = np.frombuffer(block.samples, "<i2").reshape(-1, block.channels)
        piece = self._piece(block, counts[:, self.channels].astype(np.int64), gap_us)
        s.next_us = block.tick_us + len(counts) * block.sample_period_us
        if piece is not None:
            s.pieces.append(msgspec.structs.replace(piece, gap=missing))
        return self._value_now(block)

    def _value_now(self, block: Block) -> Metered | None:
        """Of the newest pieces that fill the window; older ones go."""
        turn_s = 2 * pi / block.speed_rad_s if block.speed_rad_s > 0 else self._longest_s
        self._turn_s = min(turn_s, self._longest_s)
        needed_s = max(self.turns * self._turn_s, self.least_s)
        oldest_ns = block.t_acq_ns - round(KEPT * needed_s * 1e9)
        pieces, n, hole = self.state.pieces, 0, False
        used = 0
        for piece in reversed(pieces):
            if piece.t_ns < oldest_ns:
                break
            used += 1
            n += piece.count
            if n * self._period_s >= needed_s:
                break
            hole = hole or piece.gap
        del pieces[: len(pieces) - used]
        if not n:
            return None
        whole = n * self._period_s >= needed_s and not hole
        return Metered(self._value(n, needed_s / self._period_s), whole)

    @abstractmethod
    def _piece(self, block: Block, counts: Counts, gap_us: int) -> Piece | None:
        """What is kept of a block; None of one that is not kept."""

    @abstractmethod
    def _value(self, n: int, needed: float) -> float:
        """The value of ``n`` samples in the window, which shall have ``needed``."""


class SumsMeter(ChannelMeter):
    """Peak-to-peak, rms or mean of one channel.

    Parameters
    ----------
    config
        See :class:`ChannelMeter`.
    place, channel
        The channel, and its place in a block.
    kind
        ``peak_to_peak``, ``rms`` or ``mean``.
    per_si
        Units of people in one SI unit.
    """

    def __init__(
        self, config: Config, place: int, channel: FastChannel, kind: str, per_si: float
    ) -> None:
        super().__init__(config, (place,))
        self._kind = kind
        self.least_s = WINDOW_S if kind == "peak_to_peak" else SUMS_WINDOW_S
        self._scale, self._offset = channel.scale * per_si, channel.offset * per_si

    def _piece(self, block: Block, counts: Counts, gap_us: int) -> Piece:
        a = counts[:, 0]
        sums = [int(a.min()), int(a.max()), int(a.sum()), int((a * a).sum())]
        return Piece(block.t_acq_ns, len(a), False, sums)

    def _value(self, n: int, needed: float) -> float:
        pieces = self.state.pieces
        if self._kind == "peak_to_peak":
            lows, highs = min(p.sums[0] for p in pieces), max(p.sums[1] for p in pieces)
            return (highs - lows) * abs(self._scale)
        total = sum(p.sums[2] for p in pieces)
        if self._kind == "mean":
            return total / n * self._scale + self._offset
        square = n * sum(p.sums[3] for p in pieces) - total * total
        return sqrt(square / (n * max(float(n), needed))) * abs(self._scale)


class OrderMeter(ChannelMeter):
    """1X of one displacement channel, or what is left without it, um peak-to-peak.

    Parameters
    ----------
    config, place, channel
        See :class:`SumsMeter`.
    first
        Whether it is 1X; else not-1X.
    """

    least_s, turns = ORDER_WINDOW_S, ORDER_TURNS

    def __init__(self, config: Config, place: int, channel: FastChannel, first: bool) -> None:
        super().__init__(config, (place,))
        self._first, self._scale_um = first, abs(channel.scale) * 1e6

    def step(self, block: Block) -> Metered | None:
        """As of the others; None while the speed is not known, or the shaft stands."""
        if not block.speed_rad_s > 0.0 or block.quality & Quality.NO_MARK:
            self.state = MeterState(pieces=[])
            return None
        return super().step(block)

    def _piece(self, block: Block, counts: Counts, gap_us: int) -> Piece:
        s, a = self.state, counts[:, 0]
        turn_step = block.speed_rad_s * (block.sample_period_us * 1e-6) / (2 * pi)
        s.turns += turn_step * gap_us / block.sample_period_us
        index = (_STEPS * (s.turns + turn_step * np.arange(len(a)))).astype(np.int64)
        s.turns = (s.turns + turn_step * len(a)) % 1.0
        c, d = _COSINE[index & (_STEPS - 1)], _COSINE[(index - _STEPS // 4) & (_STEPS - 1)]
        products = (c, d, c * c, c * d, d * d, a, a * c, a * d, a * a)
        return Piece(block.t_acq_ns, len(a), False, [int(each.sum()) for each in products])

    def _value(self, n: int, needed: float) -> float:
        c, d, cc, cd, dd, a, ac, ad, aa = (
            sum(column) for column in zip(*(p.sums for p in self.state.pieces), strict=True)
        )
        # n times the central moments: exact integers
        kcc, kcd, kdd = n * cc - c * c, n * cd - c * d, n * dd - d * d
        kac, kad, kaa = n * ac - a * c, n * ad - a * d, n * aa - a * a
        det = kcc * kdd - kcd * kcd
        if det <= 0:
            return 0.0
        u, v = (kac * kdd - kad * kcd) / det, (kad * kcc - kac * kcd) / det
        if self._first:
            return 2.0 * sqrt(u * u + v * v) * _UNIT * self._scale_um
        left = max(0.0, kaa - (u * kac + v * kad))
        return 2.0 * sqrt(2.0 * left) / n * self._scale_um


class OrbitMeter(ChannelMeter):
    """Smax of a bearing: the greatest distance of the shaft from its mean, um.

    Parameters
    ----------
    config
        See :class:`ChannelMeter`.
    places
        Of its two probes in a block.
    """

    def __init__(self, config: Config, places: tuple[int, int]) -> None:
        super().__init__(config, places)
        first, second = (config.machine.channel[i] for i in places)
        (xa, xb), (ya, yb) = probes_to_xy(first.angle_deg, second.angle_deg)
        a, b = first.scale * 1e6, second.scale * 1e6
        self._x, self._y = (xa * a, xb * b), (ya * a, yb * b)

    def _piece(self, block: Block, counts: Counts, gap_us: int) -> Piece:
        return Piece(block.t_acq_ns, len(counts), False, raw=counts.astype("<i2").tobytes())

    def _value(self, n: int, needed: float) -> float:
        raw = b"".join([piece.raw for piece in self.state.pieces])
        counts = np.frombuffer(raw, "<i2").reshape(-1, 2).astype(np.int64)
        turn = self._turn_s / self._period_s  # the mean is that of whole turns
        whole = min(n, round(max(1.0, n // turn) * turn))
        mean_a, mean_b = (total / whole for total in counts[-whole:].sum(axis=0).tolist())
        a, b = counts[:, 0] - mean_a, counts[:, 1] - mean_b
        x, y = self._x[0] * a + self._x[1] * b, self._y[0] * a + self._y[1] * b
        return sqrt(float((x * x + y * y).max()))


class VelocityMeter(ChannelMeter):
    """Velocity of a housing from its acceleration, mm/s rms.

    Parameters
    ----------
    config, place, channel
        See :class:`SumsMeter`.
    band_low_hz
        Low end of the band.
    """

    least_s = VELOCITY_WINDOW_S

    def __init__(
        self, config: Config, place: int, channel: FastChannel, band_low_hz: float
    ) -> None:
        super().__init__(config, (place,))
        rate = 1.0 / self._period_s
        self._scale = channel.scale * 1e3
        c = 2.0 * rate
        w = c * round(tan(pi * CORNER_SHARE * band_low_hz / rate), 12)
        root_2 = sqrt(2.0)
        a0 = c * c + root_2 * w * c + w * w
        self._gain = c / a0
        self._a1, self._a2 = 2.0 * (w * w - c * c) / a0, (c * c - root_2 * w * c + w * w) / a0
        self._settled = round(SETTLED_S * rate)

    def _piece(self, block: Block, counts: Counts, gap_us: int) -> Piece | None:
        s, values = self.state, [value * self._scale for value in counts[:, 0].tolist()]
        if not s.carry:  # counted from the first sample: no step at the beginning
            s.carry = [values[0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        missing = gap_us // block.sample_period_us
        last = s.carry[1] + s.carry[0]
        bridge = [last + (values[0] - last) * (k + 1) / (missing + 1) for k in range(missing)]
        self._run(bridge)
        energy = self._run(values)
        s.fed += missing + len(values)
        if s.fed < self._settled:
            return None
        return Piece(block.t_acq_ns, len(values), False, energy=energy)

    def _run(self, values: list[float]) -> float:
        """Filter ``values``; the sum of the squared velocities, (mm/s)2."""
        zero, p1, p2, x1, x2, y1, y2 = self.state.carry
        gain, a1, a2, energy = self._gain, self._a1, self._a2, 0.0
        for value in values:
            p0 = value - zero
            x0 = p1 - (p0 - 2.0 * p1 + p2) / 12.0
            y0 = gain * (x0 - x2) - a1 * y1 - a2 * y2
            energy += y0 * y0
            p2, p1, x2, x1, y2, y1 = p1, p0, x1, x0, y1, y0
        self.state.carry = [zero, p1, p2, x1, x2, y1, y2]
        return energy

    def _value(self, n: int, needed: float) -> float:
        return sqrt(sum(p.energy for p in self.state.pieces) / max(float(n), needed))
