"""Channel OK (vocabulary of API 670, 5th ed.): is a sensor's signal one that a working sensor could give?

A channel is not OK while more than a quarter of a block lies outside its OK range (a broken cable sits at
the rail; a clipped *peak* is vibration and must not defeat its own trip), or while it has not moved by
one count for :data:`STUCK_S`.  It returns after :data:`HOLD_OFF_S` without either.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

from firmware_py.config import Channel
from firmware_py.records import N_CHANNELS

STUCK_S: Final = 0.25
HOLD_OFF_S: Final = 1.0

_INT16_MIN: Final = -32768
_INT16_MAX: Final = 32767


class ChannelOkState(msgspec.Struct):
    """Per channel: samples without change, the value they hold, and good samples still owed."""

    same: list[int]
    value: list[int]
    owed: list[int]


def counts_range(channel: Channel) -> tuple[int, int]:
    """OK range of ``channel`` in raw counts, always inside the rails of ``int16``."""
    ends = sorted((limit - channel.offset) / channel.scale for limit in (channel.ok_low, channel.ok_high))
    return max(math.ceil(ends[0]), _INT16_MIN + 1), min(math.floor(ends[1]), _INT16_MAX - 1)


class ChannelOk:
    """OK flags of the eight channels, one bit each.

    Parameters
    ----------
    channels
        The configured channels in wire order.
    rate_hz
        Sampling rate.
    """

    def __init__(self, channels: list[Channel], rate_hz: int) -> None:
        ranges = [counts_range(c) for c in channels]
        self._low = np.array([low for low, _ in ranges], np.int16)
        self._high = np.array([high for _, high in ranges], np.int16)
        self._stuck_samples = round(STUCK_S * rate_hz)
        self._hold_off_samples = round(HOLD_OFF_S * rate_hz)
        self.state = ChannelOkState([0] * N_CHANNELS, [0] * N_CHANNELS, [0] * N_CHANNELS)

    def step(self, samples: npt.NDArray[np.int16]) -> int:
        """Bit mask of OK channels after the next ``samples`` (``n x 8`` counts)."""
        n = len(samples)
        outside = ((samples < self._low) | (samples > self._high)).sum(axis=0).tolist()
        still = (samples[0] == samples[-1]).tolist()
        mask = 0
        for i in range(N_CHANNELS):
            bad = 4 * outside[i] > n or self._stuck(i, samples, still[i])
            self.state.owed[i] = self._hold_off_samples if bad else max(0, self.state.owed[i] - n)
            mask |= (self.state.owed[i] == 0) << i
        return mask

    def _stuck(self, i: int, samples: npt.NDArray[np.int16], ends_equal: bool) -> bool:
        """Whether channel ``i`` has held one value for the stuck time."""
        s = self.state
        if not ends_equal or bool((samples[:, i] != samples[0, i]).any()):
            s.same[i] = 0
            return False
        value = int(samples[0, i])
        s.same[i] = s.same[i] + len(samples) if value == s.value[i] else len(samples)
        s.value[i] = value
        return s.same[i] >= self._stuck_samples
