"""The node's anti-alias filter: linear phase, -60 dB from the Nyquist frequency up."""

from __future__ import annotations

import math

import numpy as np

from sim_hil.rotor.parameters import Floats

PASS_SHARE = 0.8
STOP_DB = 66.0
BETA = 0.1102 * (STOP_DB - 8.7)
"""Of the Kaiser window, for more than 50 dB (Kaiser 1974)."""


def antialias_taps(substeps: int) -> Floats:
    """Impulse response at the inner rate for decimation by ``substeps`` (Kaiser window, odd
    length).

    Passes to 0.8 of the outer Nyquist frequency; the delay is ``(len - 1) / 2`` inner steps.
    Written out here: importing `scipy.signal` takes as long as all else at the start of the rig.
    """
    stop = 1.0 / substeps  # of the inner Nyquist frequency, as what follows
    width, cutoff = (1 - PASS_SHARE) * stop, 0.5 * (1 + PASS_SHARE) * stop
    count = math.ceil((STOP_DB - 7.95) / (2.285 * math.pi * width) + 1) | 1
    steps = np.arange(count) - 0.5 * (count - 1)
    taps = cutoff * np.sinc(cutoff * steps) * np.kaiser(count, BETA)
    return np.asarray(taps / taps.sum(), dtype=np.float64)


def delay_periods(taps: Floats, substeps: int) -> int:
    """Delay of the filter in whole sampling periods (rounded up)."""
    return math.ceil((taps.size - 1) / 2 / substeps)
