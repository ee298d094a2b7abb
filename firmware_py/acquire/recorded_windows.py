"""Windows of a whole recording, for training: cut by the device's own windower."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import ChannelMap, Floats
from firmware_py.acquire.windows import HOP_SECONDS, Chunk, Reported, Window, Windower

BLOCK: Final = 30
"""Samples in which a recording's channels are judged, as many as a block of schema 1 holds."""

ChannelJudge = Callable[[NDArray[np.int16], float], int]
"""Counts of the next samples (n, channels) and shaft speed (rad/s, 0: unknown) to bits of OK."""


def iter_windows(
    samples: NDArray[np.int16],
    tick_us: int,
    mark_ticks_us: NDArray[np.int64],
    rate_hz: int,
    *,
    readings: Floats | None = None,
    channels: ChannelMap | None = None,
    judge: ChannelJudge | None = None,
) -> Iterator[Window]:
    """Windows of one gap-free recording, cut by the device's own :class:`Windower`.

    Parameters
    ----------
    samples
        Counts, shape (n, 8).
    tick_us
        Unwrapped node tick of the first row.
    mark_ticks_us
        Unwrapped ticks of the once-per-turn marks, increasing.
    rate_hz
        Sampling rate.
    readings
        Shape (m, 4): unwrapped tick (us), radial clearance (m), shaft power (W), oil outlet (degC).
    channels
        Conversion to SI; default: ``orbitd.dbc``.
    judge
        Asked block by block which channels are OK; default: all are, as long as they are plausible.

    Yields
    ------
    Window
        Every ``HOP_SECONDS``, oldest first.
    """
    windower = Windower(channels or ChannelMap.wire(), rate_hz)
    table = np.empty((0, 4)) if readings is None else readings
    period_us = round(1e6 / rate_hz)
    step = BLOCK if judge else round(HOP_SECONDS * rate_hz)
    for start in range(0, len(samples), step):
        counts = samples[start : start + step]
        first_us = tick_us + start * period_us
        last_us = first_us + len(counts) * period_us
        for row in table[(table[:, 0] >= first_us) & (table[:, 0] < last_us)]:
            windower.note_reported(Reported(int(row[0]), *row[1:].tolist()))
        marks = mark_ticks_us[(mark_ticks_us >= first_us) & (mark_ticks_us < last_us)]
        ok = judge(counts, _speed_rad_s(mark_ticks_us, last_us)) if judge else 0xFF
        yield from windower.take(Chunk(counts, first_us, period_us, marks, channel_ok=ok))


def _speed_rad_s(marks_us: NDArray[np.int64], now_us: int) -> float:
    """Speed by the last turn before ``now_us``; 0: not known yet."""
    seen = int(np.searchsorted(marks_us, now_us))
    return 2e6 * math.pi / float(marks_us[seen - 1] - marks_us[seen - 2]) if seen > 1 else 0.0
