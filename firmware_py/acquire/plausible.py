"""Plausibility of a window's channels: signals that no machine makes, whatever ails it.

Beside channel OK (range, stuck) these show a sick sensor: samples that drop to zero, a flat top, a
mean where there can be none, a line of the mains that the shaft does not make.  What looks like a
machine stays with the diagnosis: a changed gain, a slow drift inside the clearance.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py import signals
from firmware_py.records import N_CHANNELS

TORN_SHARE: Final = 0.002
ZEROS_OVER_BESIDE: Final = 3.0
"""Zeros between two samples of one sign: this share of a window; zeros over as many of the counts
beside zero."""
_BESIDE: Final = 4
FLAT_SHARE: Final = 0.05
"""Samples at one and the same extreme."""
FLAT_LEAST: Final = 16
"""Counts from extreme to extreme below which the signal is its own quantisation."""
MAINS_HZ: Final = (50.0, 60.0)
MAINS_ORDER_GAP: Final = 0.08
"""The mains is told from the shaft where no multiple of half its speed comes nearer than this (in
orders)."""
_KINDS: Final = tuple(signals.FAST[row.kind] for row in signals.CHANNELS)
MAINS_SI: Final = tuple(kind.mains_si for kind in _KINDS)
"""Amplitudes of a mains line, about 0.4 % of the channels' ranges: m, m/s2, Pa, bar, V."""
MEAN_SI: Final = tuple(kind.mean_si for kind in _KINDS)
"""Means that accelerometers (m/s2) and microphone (Pa) cannot have."""
_RESTING: Final = np.array([kind.rests for kind in _KINDS])

Counts = NDArray[np.int16]
Integers = NDArray[np.int32]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def plausible(counts: Counts, scale: Floats, offset: Floats, rate_hz: float, marks: Floats) -> int:
    """Bit ``i`` set: channel ``i`` gives what a working sensor could.

    Parameters
    ----------
    counts
        One window, shape (n, 8).
    scale, offset
        SI per count and SI, shape (8,).
    marks
        Positions of the once-per-turn marks in samples.
    """
    by_channel = np.ascontiguousarray(counts.T).astype(np.int32)
    low, high, mean = by_channel.min(axis=1), by_channel.max(axis=1), by_channel.mean(axis=1)
    torn = dropping_out(by_channel)
    if len(marks) < 2:
        torn[_RESTING] = False  # metal touches metal where the shaft stands: the contact reads zero
    ill = torn | flat(by_channel, low, high)
    ill |= np.abs(mean * scale + offset) > MEAN_SI
    ill |= mains(by_channel - mean[:, None], scale, rate_hz, marks)
    return int(sum(1 << i for i in range(N_CHANNELS) if not ill[i]))


def dropping_out(counts: Integers) -> Flags:
    """Zeros where the signal was on one side, and far more often than the counts beside zero, (8,):
    a loose plug."""
    torn = np.zeros(N_CHANNELS, dtype=np.bool_)
    least = TORN_SHARE * counts.shape[1]
    for i in np.flatnonzero(np.count_nonzero(counts == 0, axis=1) > least).tolist():
        value = counts[i]
        size = np.abs(value)
        lone = (size[1:-1] == 0) & (np.minimum(size[:-2], size[2:]) > _BESIDE)
        lone &= (value[:-2] > 0) == (value[2:] > 0)
        zeros, near = np.count_nonzero(size == 0), np.count_nonzero(size <= _BESIDE)
        beside = (near - zeros) / (2.0 * _BESIDE)
        torn[i] = np.count_nonzero(lone) > least and zeros > ZEROS_OVER_BESIDE * beside
    return torn


def flat(counts: Integers, low: Integers, high: Integers) -> Flags:
    """Many samples at one extreme, shape (8,): a clipping amplifier; the contact channel may rest
    at its supply."""
    at_low, at_high = (np.count_nonzero(counts == end[:, None], axis=1) for end in (low, high))
    many = (np.maximum(at_low, at_high) > FLAT_SHARE * counts.shape[1]) & (high - low > FLAT_LEAST)
    many[_RESTING] = False
    return np.asarray(many)


def mains(swing: Floats, scale: Floats, rate_hz: float, marks: Floats) -> Flags:
    """A line of the mains, shape (8,), in counts without their mean (8, n), where the shaft cannot
    have made it."""
    found = np.zeros(N_CHANNELS, dtype=np.bool_)
    if len(marks) < 2:
        return found
    turns_hz = rate_hz / np.diff(marks)
    n = swing.shape[1]
    weighted = swing * (np.hanning(n) / (0.5 * n))
    for line_hz in MAINS_HZ:
        halves = 2.0 * line_hz / np.array([turns_hz.max(), turns_hz.min()])
        if np.floor(halves[1] + 2 * MAINS_ORDER_GAP) >= np.ceil(halves[0] - 2 * MAINS_ORDER_GAP):
            continue
        found |= (
            np.hypot(*(weighted @ _turning(line_hz / rate_hz, 1 << n.bit_length())[:n]).T) * scale
            > MAINS_SI
        )
    return found


@lru_cache(maxsize=16)
def _turning(turns_per_sample: float, n: int) -> Floats:
    """Cosine and sine of a line over ``n`` samples, shape (n, 2)."""
    angle = 2.0 * np.pi * turns_per_sample * np.arange(n)
    return np.column_stack([np.cos(angle), np.sin(angle)])
