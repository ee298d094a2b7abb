"""Sample frames of the rig's layout, with the newest mark at or before the last of them.

Times are microseconds of the node's clock since its start; an instant was measured one filter delay
before its value is ready.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py import signals
from firmware_py.records import CHANNELS, SampleFrame
from firmware_py.wire.layout import WireLayout
from firmware_py.wire.layout_fields import SampleFlag
from sim_hil.plant.machine import Batch

TICKS: Final = 1 << 32
COUNTERS: Final = 1 << 16


class Sampler:
    """Turns batches of counts into sample frames.

    Parameters
    ----------
    layout
        Of the frames; a channel that the machine has not shows what its first standard channel of
        the same kind shows, or nothing.
    period_us, delay_us
        Sampling period and delay of the anti-alias filter.
    tick0
        The node's tick at its start.
    """

    def __init__(self, layout: WireLayout, period_us: int, delay_us: int, tick0: int) -> None:
        self.instants = layout.instants
        self._sources = sources(layout)
        self._bytes = layout.samples_bytes
        self._period_us, self._delay_us, self._tick0 = period_us, delay_us, tick0
        self._pending = bytearray()
        self._first_us = 0
        self._marks: deque[tuple[int, int]] = deque()
        self._mark_us = 0
        self._edges_sent = 0
        self._edges = 0
        self._counter = 0

    def skip(self, frames: int) -> None:
        """Leave out ``frames``: their time and their counters pass, nothing is sent."""
        self._first_us += frames * self.instants * self._period_us
        self._counter = (self._counter + frames) % COUNTERS

    def frames(self, batch: Batch, start_us: int, flags: int) -> list[SampleFrame]:
        """Frames that ``batch``, beginning at ``start_us``, completes; ``flags`` without
        ``MARK_VALID``."""
        for i in np.flatnonzero(batch.marks >= 0).tolist():
            self._edges += 1
            self._marks.append(
                (start_us + i * self._period_us + round(batch.marks[i] * 1e6), self._edges)
            )
        if not self._pending:
            self._first_us = start_us + self._period_us - self._delay_us
        self._pending += self._of_rig(batch).astype("<i2", copy=False).tobytes()
        out: list[SampleFrame] = []
        while len(self._pending) >= self._bytes:
            out.append(self._frame(bytes(self._pending[: self._bytes]), flags))
            del self._pending[: self._bytes]
            self._first_us += self.instants * self._period_us
        return out

    def _of_rig(self, batch: Batch) -> NDArray[np.int16]:
        """The machine's counts in the order of the layout."""
        if self._sources == list(range(len(CHANNELS))):
            return batch.counts
        counts = batch.counts[:, self._sources]
        counts[:, [source < 0 for source in self._sources]] = 0
        return counts

    def _frame(self, samples: bytes, flags: int) -> SampleFrame:
        last_us = self._first_us + (self.instants - 1) * self._period_us
        while self._marks and self._marks[0][0] <= last_us:
            self._mark_us, self._edges_sent = self._marks.popleft()
        known = self._edges_sent > 0
        counter, self._counter = self._counter, (self._counter + 1) % COUNTERS
        return SampleFrame(
            counter=counter,
            tick_us=(self._tick0 + self._first_us) % TICKS,
            mark_tick_us=(self._tick0 + self._mark_us) % TICKS if known else 0,
            turn_count=self._edges_sent % COUNTERS,
            flags=flags + known * SampleFlag.MARK_VALID.value,
            samples=samples,
        )


def sources(layout: WireLayout) -> list[int]:
    """The machine's column for each channel of ``layout``; -1 where it has none of that kind."""
    kinds = [row.kind for row in signals.CHANNELS]
    return [
        CHANNELS.index(c.name)
        if c.name in CHANNELS
        else kinds.index(c.kind.name)
        if c.kind.name in kinds
        else -1
        for c in layout.channels
    ]
