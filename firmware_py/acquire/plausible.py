"""Plausibility of a window's channels: signals that no machine makes, whatever ails it.

Beside channel OK (range, stuck) these show a sick sensor: samples that drop to zero, a flat top, a mean where
there can be none, a line of the mains that the shaft does not make.  What looks like a machine stays with the
diagnosis: a changed gain, a slow drift inside the clearance.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.records import N_CHANNELS

TORN_SHARE: Final = 0.002
ZEROS_OVER_BESIDE: Final = 3.0
"""Zeros between two samples of one sign: this share of a window; zeros over as many of the counts beside zero."""
_BESIDE: Final = 4
FLAT_SHARE: Final = 0.05
"""Samples at one and the same extreme."""
FLAT_LEAST: Final = 16
"""Counts from extreme to extreme below which the signal is its own quantisation."""
MAINS_HZ: Final = (50.0, 60.0)
MAINS_ORDER_GAP: Final = 0.08
"""The mains is told from the shaft where no multiple of half its speed comes nearer than this (in orders)."""
MAINS_SI: Final = (1e-6, 1e-6, 0.7, 0.7, 0.7, 0.07, 0.03, 0.006)
"""Amplitudes of a mains line, about 0.4 % of the channels' ranges: m, m/s2, Pa, bar, V."""
MEAN_SI: Final = {2: 2.0, 3: 2.0, 4: 2.0, 5: 0.3}
"""Means that accelerometers (m/s2) and microphone (Pa) cannot have."""
_CONTACT: Final = 7

Counts = NDArray[np.int16]
Floats = NDArray[np.float64]


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
    ill = dropping_out(counts) | flat(counts) | impossible_mean(counts, scale, offset)
    ill |= mains(counts, scale, rate_hz, marks)
    return int(sum(1 << i for i in range(N_CHANNELS) if not ill[i]))


def dropping_out(counts: Counts) -> NDArray[np.bool_]:
    """Zeros where the signal was on one side, and far more often than the counts beside zero, (8,): a loose plug."""
    value = counts.astype(np.int32)
    before, after = value[:-2], value[2:]
    torn = (value[1:-1] == 0) & (np.minimum(np.abs(before), np.abs(after)) > _BESIDE) & (before * after > 0)
    size = np.abs(value)
    beside = ((size > 0) & (size <= _BESIDE)).sum(axis=0) / (2.0 * _BESIDE)
    return np.asarray((torn.sum(axis=0) > TORN_SHARE * len(counts))
                      & ((size == 0).sum(axis=0) > ZEROS_OVER_BESIDE * beside))


def flat(counts: Counts) -> NDArray[np.bool_]:
    """Many samples at one extreme, shape (8,): a clipping amplifier; the contact channel may rest at its supply."""
    top, bottom = counts == counts.max(axis=0), counts == counts.min(axis=0)
    many = np.maximum(top.sum(axis=0), bottom.sum(axis=0)) > FLAT_SHARE * len(counts)
    many &= np.ptp(counts.astype(np.int32), axis=0) > FLAT_LEAST
    many[_CONTACT] = False
    return np.asarray(many)


def impossible_mean(counts: Counts, scale: Floats, offset: Floats) -> NDArray[np.bool_]:
    """A mean acceleration or sound pressure, shape (8,)."""
    mean = np.abs(counts.mean(axis=0) * scale + offset)
    return np.array([mean[i] > MEAN_SI.get(i, np.inf) for i in range(N_CHANNELS)])


def mains(counts: Counts, scale: Floats, rate_hz: float, marks: Floats) -> NDArray[np.bool_]:
    """A line of the mains, shape (8,), where the shaft cannot have made it."""
    found = np.zeros(N_CHANNELS, dtype=np.bool_)
    if len(marks) < 2:
        return found
    turns_hz = rate_hz / np.diff(marks)
    n = len(counts)
    weight = np.hanning(n) / (0.5 * n)
    for line_hz in MAINS_HZ:
        halves = 2.0 * line_hz / np.array([turns_hz.max(), turns_hz.min()])
        if np.floor(halves[1] + 2 * MAINS_ORDER_GAP) >= np.ceil(halves[0] - 2 * MAINS_ORDER_GAP):
            continue
        phasor = weight * np.exp(-2j * np.pi * line_hz / rate_hz * np.arange(n))
        found |= np.abs(phasor @ (counts - counts.mean(axis=0))) * scale > MAINS_SI
    return found
