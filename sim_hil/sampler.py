"""Sample frames: three instants each, with the newest mark at or before the last of them.

Times are microseconds of the node's clock since its start; an instant was measured one filter delay
before its value is ready.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from firmware_py.records import INSTANTS_PER_FRAME, N_CHANNELS, SampleFrame
from firmware_py.wire.fields import SampleFlag
from sim_hil.machine import Batch

TICKS: Final = 1 << 32
COUNTERS: Final = 1 << 16
_FRAME_BYTES: Final = INSTANTS_PER_FRAME * N_CHANNELS * 2


class Sampler:
    """Turns batches of counts into sample frames.

    Parameters
    ----------
    period_us, delay_us
        Sampling period and delay of the anti-alias filter.
    tick0
        The node's tick at its start.
    """

    def __init__(self, period_us: int, delay_us: int, tick0: int) -> None:
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
        self._first_us += frames * INSTANTS_PER_FRAME * self._period_us
        self._counter += frames

    def frames(self, batch: Batch, start_us: int, flags: SampleFlag) -> list[SampleFrame]:
        """Frames that ``batch``, beginning at ``start_us``, completes."""
        for i in np.flatnonzero(batch.marks >= 0).tolist():
            self._edges += 1
            self._marks.append((start_us + i * self._period_us + round(batch.marks[i] * 1e6), self._edges))
        out: list[SampleFrame] = []
        for i, row in enumerate(batch.counts.astype("<i2", copy=False)):
            measured_us = start_us + (i + 1) * self._period_us - self._delay_us
            if not self._pending:
                self._first_us = measured_us
            self._pending += row.tobytes()
            if len(self._pending) == _FRAME_BYTES:
                out.append(self._frame(measured_us, flags))
        return out

    def _frame(self, last_us: int, flags: SampleFlag) -> SampleFrame:
        while self._marks and self._marks[0][0] <= last_us:
            self._mark_us, self._edges_sent = self._marks.popleft()
        known = self._edges_sent > 0
        frame = SampleFrame(
            counter=self._counter % COUNTERS,
            tick_us=(self._tick0 + self._first_us) % TICKS,
            mark_tick_us=(self._tick0 + self._mark_us) % TICKS if known else 0,
            turn_count=self._edges_sent % COUNTERS,
            flags=int(flags | (SampleFlag.MARK_VALID if known else SampleFlag(0))),
            samples=bytes(self._pending),
        )
        self._counter += 1
        self._pending.clear()
        return frame
