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
        self._pending += batch.counts.astype("<i2", copy=False).tobytes()
        out: list[SampleFrame] = []
        while len(self._pending) >= _FRAME_BYTES:
            out.append(self._frame(bytes(self._pending[:_FRAME_BYTES]), flags))
            del self._pending[:_FRAME_BYTES]
            self._first_us += INSTANTS_PER_FRAME * self._period_us
        return out

    def _frame(self, samples: bytes, flags: int) -> SampleFrame:
        last_us = self._first_us + (INSTANTS_PER_FRAME - 1) * self._period_us
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
