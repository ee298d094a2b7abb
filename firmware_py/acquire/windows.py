"""Windows: gap-free stretches of samples, long enough for order analysis (ISO 13374 DM).

The same :class:`Windower` cuts the running machine's blocks and, through
:mod:`~firmware_py.acquire.recorded_windows`, a whole recording for training.  Window ends lie on a
fixed grid of samples counted from the start of a gap-free run, so the windows do not depend on how
the samples were chopped into blocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap, Floats
from firmware_py.acquire.plausible import plausible
from firmware_py.records import N_CHANNELS, Block, Quality, RigReading

TURNS: Final = 32
"""Turns that a window holds when its length allows."""
MIN_TURNS: Final = 8
"""Whole turns below which a window is marked ``NO_MARK``: order analysis would not resolve
half-orders."""
MIN_SECONDS: Final = 0.8
MAX_SECONDS: Final = 2.0
HOP_SECONDS: Final = 0.25
WINDOW_LAYOUT: Final = {
    "turns": float(TURNS),
    "min_seconds": MIN_SECONDS,
    "max_seconds": MAX_SECONDS,
    "hop_seconds": HOP_SECONDS,
}
"""How windows are cut; a model that saw other windows does not fit."""
MARK_RATIO_MAX: Final = 1.5
"""Neighbouring turns that differ by more hold a lost or a false mark (a 4000 rpm/s ramp gives
1.1)."""

MARKS_MOST: Final = 2048
FLAGS_MOST: Final = 8192
READINGS_MOST: Final = 128
"""Marks, changes of quality and readings that are remembered at most."""
REMEMBERED_US: Final = 2_500_000
"""Marks and readings older than this lie in no later window: the longest one and a quarter."""


@dataclass(frozen=True, slots=True)
class Window:
    """A gap-free stretch of samples with what the rig reported meanwhile.

    Attributes
    ----------
    samples
        Shape (n, 8), SI; columns 0 and 1 are the shaft's x and y (m) in the machine's frame.
    rate_hz
        Sampling rate.
    marks
        Positions of the once-per-turn marks in samples from the first row (fractional, increasing).
    end_tick_us
        Unwrapped node tick one period after the last row.
    end_ns
        Host time of that tick; 0 offline.
    last_block_seq
        Block that closed the window; 0 offline.
    quality
        :class:`~firmware_py.records.Quality` flags; ``NO_MARK`` when there are no usable turns.
    channel_ok
        Bit ``i`` set: channel ``i`` was OK throughout, and plausible.
    clearance_m, shaft_power_W, oil_outlet_C
        Means of the rig's readings inside the window; NaN when there was none.
    """

    samples: Floats
    rate_hz: float
    marks: Floats
    end_tick_us: int
    end_ns: int
    last_block_seq: int
    quality: int
    channel_ok: int
    clearance_m: float
    shaft_power_W: float
    oil_outlet_C: float

    @property
    def turns(self) -> int:
        """Whole turns between the first and the last mark."""
        return max(0, len(self.marks) - 1)


@dataclass(slots=True)
class Chunk:
    """Samples as they arrive, from a block or from a recording."""

    counts: NDArray[np.int16]
    tick_us: int
    period_us: int
    marks_us: NDArray[np.int64]
    t_acq_ns: int = 0
    period_ns: int = 0
    seq: int = 0
    quality: int = 0
    channel_ok: int = 0xFF


class Flags(msgspec.Struct, array_like=True):
    """Quality and OK bits of the samples up to number ``end`` of the run."""

    end: int
    quality: int
    channel_ok: int


class Reported(msgspec.Struct, frozen=True, array_like=True):
    """What the rig reported at one unwrapped node tick."""

    tick_us: int
    clearance_m: float
    shaft_power_W: float
    oil_outlet_C: float


class WindowerState(msgspec.Struct):
    """Where the windower stands in a run, and all that it remembers but the samples.

    ``run``: samples of the run so far; ``next_end``: its sample at which the next window ends;
    ``end_tick_us``: node tick after its last one.
    """

    next_end: int = 0
    run: int = 0
    end_tick_us: int = -1
    marks_us: list[int] = []
    flags: list[Flags] = []
    readings: list[Reported] = []
    windows: int = 0
    windows_cut_by_gap: int = 0


@dataclass(slots=True)
class Windower:
    """Cuts a stream of blocks into overlapping windows; holds a fixed amount of memory.

    Parameters
    ----------
    channels
        Conversion to SI.
    rate_hz
        Sampling rate.
    """

    channels: ChannelMap
    rate_hz: int
    state: WindowerState = field(init=False, default_factory=WindowerState)
    _ring: NDArray[np.int16] = field(init=False)
    _fill: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._ring = np.zeros((2 * self.most, N_CHANNELS), np.int16)
        self._restart()

    @property
    def most(self) -> int:
        """Samples of the longest window: no more are ever looked back at."""
        return round(MAX_SECONDS * self.rate_hz)

    @property
    def counters(self) -> dict[str, int]:
        """Windows cut, and runs that a gap ended."""
        state = self.state
        return {"windows": state.windows, "windows_cut_by_gap": state.windows_cut_by_gap}

    def restore(self, state: WindowerState, blocks: Sequence[Block]) -> None:
        """Go on from ``state``; ``blocks`` are the newest of its run, at least :attr:`most` samples
        or all.

        Raises
        ------
        ValueError
            They do not hold the samples that the state needs.
        """
        counts = [self._counts(block) for block in blocks]
        need = min(state.run, self.most)
        if sum(map(len, counts)) < need:
            raise ValueError(f"the samples before this state are not all there: {need} are needed")
        self.state, self._fill = state, need
        if need:
            self._ring[:need] = np.concatenate(counts)[-need:]

    def _restart(self) -> None:
        state = self.state
        self._fill = state.run = 0
        state.next_end = round(MIN_SECONDS * self.rate_hz)
        state.marks_us.clear()
        state.flags.clear()

    def note(self, reading: RigReading) -> None:
        """Remember what the rig said about clearance, shaft power and oil.

        Before the first block there is no time to put it on: such a reading is left out.
        """
        if not self.state.run:
            return
        status = reading.status
        self.note_reported(
            Reported(
                nearest_tick(status.tick_us, self.state.end_tick_us),
                status.clearance_actual_um * 1e-6,
                status.shaft_power_W,
                status.oil_outlet_C,
            )
        )

    def note_reported(self, reported: Reported) -> None:
        """Remember ``reported``; what no later window holds is dropped."""
        readings = self.state.readings
        readings.append(reported)
        del readings[:-READINGS_MOST]
        oldest_us = self.state.end_tick_us - REMEMBERED_US
        while readings[0].tick_us < oldest_us and len(readings) > 1:
            del readings[0]

    def step(self, block: Block) -> list[Window]:
        """Take one block; return the windows that it completes, oldest first."""
        counts = self._counts(block)
        marks = np.array(block.mark_ticks_us, np.int64)
        return self.take(
            Chunk(
                counts,
                block.tick_us,
                block.sample_period_us,
                marks,
                block.t_acq_ns,
                block.period_ns,
                block.seq,
                block.quality,
                self.channels.ok(block.channel_ok),
            )
        )

    def _counts(self, block: Block) -> NDArray[np.int16]:
        """The samples of ``block``, shape (n, 8), in the order of the columns."""
        return self.channels.columns(
            np.frombuffer(block.samples, "<i2").reshape(-1, block.channels)
        )

    def take(self, chunk: Chunk) -> list[Window]:
        """Take one chunk; return the windows that it completes, oldest first."""
        state = self.state
        joined = chunk.tick_us == state.end_tick_us and not chunk.quality & Quality.GAP_BEFORE
        if state.run and not joined:
            state.windows_cut_by_gap += 1
            self._restart()
        self._forget_marks()
        state.end_tick_us = chunk.tick_us
        state.marks_us += chunk.marks_us.tolist()
        del state.marks_us[:-MARKS_MOST]
        windows: list[Window] = []
        for start in range(0, len(chunk.counts), self.most):
            windows += self._append(chunk, chunk.counts[start : start + self.most])
        return windows

    def _forget_marks(self) -> None:
        """Drop the marks that no later window holds; two stay, they tell how long a turn is."""
        marks, oldest_us = self.state.marks_us, self.state.end_tick_us - REMEMBERED_US
        gone = 0
        while len(marks) - gone > 2 and marks[gone] < oldest_us:
            gone += 1
        del marks[:gone]

    def _append(self, chunk: Chunk, counts: NDArray[np.int16]) -> list[Window]:
        """Add at most ``MAX_SECONDS`` of samples, then cut every window whose end has been
        reached."""
        n = len(counts)
        if self._fill + n > len(self._ring):
            keep = min(self._fill, self.most)
            self._ring[:keep] = self._ring[self._fill - keep : self._fill]
            self._fill = keep
        self._ring[self._fill : self._fill + n] = counts
        self._fill += n
        state = self.state
        state.run += n
        state.end_tick_us += n * chunk.period_us
        self._note_flags(int(chunk.quality & ~Quality.GAP_BEFORE), chunk.channel_ok)
        windows = []
        while state.next_end <= state.run:
            windows.append(self._cut(chunk, state.run - state.next_end))
            state.next_end += round(HOP_SECONDS * self.rate_hz)
        state.windows += len(windows)
        return windows

    def _note_flags(self, quality: int, channel_ok: int) -> None:
        """Remember what is known of the newest samples; samples of which the same is known share an
        entry."""
        state = self.state
        last = state.flags[-1] if state.flags else None
        if last and (last.quality, last.channel_ok) == (quality, channel_ok):
            last.end = state.run
            return
        state.flags.append(Flags(state.run, quality, channel_ok))
        del state.flags[:-FLAGS_MOST]

    def _cut(self, chunk: Chunk, back: int) -> Window:
        """The window that ends ``back`` samples before the newest one."""
        period_us = chunk.period_us
        end_us = self.state.end_tick_us - back * period_us
        marks_us = np.array(self.state.marks_us, np.int64)
        marks_us = marks_us[marks_us < end_us]
        n = min(self._length(marks_us), self.state.next_end, self._fill - back)
        start_us = end_us - n * period_us
        marks = (marks_us[marks_us >= start_us] - start_us) / period_us
        quality, channel_ok = self._flags_over(self.state.next_end - n)
        counts = self._ring[self._fill - back - n : self._fill - back]
        channel_ok &= plausible(
            counts, self.channels.scale, self.channels.offset, 1e6 / period_us, marks
        )
        if not _usable(marks):
            quality |= Quality.NO_MARK
        after_ns = (
            (chunk.tick_us + len(chunk.counts) * period_us - end_us) // period_us * chunk.period_ns
        )
        end_ns = chunk.t_acq_ns + len(chunk.counts) * chunk.period_ns - after_ns
        return Window(
            self.channels.to_si(counts),
            1e6 / period_us,
            marks,
            end_us,
            end_ns,
            chunk.seq,
            quality,
            channel_ok,
            *self._reading_means(start_us, end_us),
        )

    def _length(self, marks_us: NDArray[np.int64]) -> int:
        """Samples for ``TURNS`` turns at the present speed, within the two bounds."""
        turn_s = (marks_us[-1] - marks_us[-2]) * 1e-6 if len(marks_us) > 1 else math.inf
        seconds = min(max((TURNS + 1) * turn_s, MIN_SECONDS), MAX_SECONDS)
        return round(seconds * self.rate_hz)

    def _flags_over(self, start: int) -> tuple[int, int]:
        """Union of the quality flags and intersection of the OK bits since sample ``start`` of the
        run."""
        known = self.state.flags
        while len(known) > 1 and known[0].end <= self.state.run - self.most - self.rate_hz:
            del known[0]
        quality, channel_ok = 0, 0xFF
        for flags in known:
            if flags.end > start:
                quality |= flags.quality
                channel_ok &= flags.channel_ok
        return quality, channel_ok

    def _reading_means(self, start_us: int, end_us: int) -> tuple[float, float, float]:
        inside = [
            (row.clearance_m, row.shaft_power_W, row.oil_outlet_C)
            for row in self.state.readings
            if start_us <= row.tick_us < end_us
        ]
        if not inside:
            return math.nan, math.nan, math.nan
        clearance, power, oil = (
            math.fsum(column) / len(inside) for column in zip(*inside, strict=True)
        )
        return clearance, power, oil


def _usable(marks: Floats) -> bool:
    """Enough whole turns, none of them torn by a lost or a false mark."""
    if len(marks) <= MIN_TURNS:
        return False
    turns = np.diff(marks)
    ratio = turns[1:] / np.maximum(turns[:-1], 1e-9)
    return bool(
        turns.min() > 0 and ratio.max() < MARK_RATIO_MAX and ratio.min() > 1 / MARK_RATIO_MAX
    )


def nearest_tick(tick_us: int, near_us: int) -> int:
    """Unwrap the 32-bit ``tick_us`` to the value nearest to the unwrapped tick ``near_us``."""
    return near_us + (tick_us - near_us + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
