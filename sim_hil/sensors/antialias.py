"""The node's anti-alias filter: linear phase, -60 dB from the Nyquist frequency up."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import firwin, kaiserord

from sim_hil.rotor.parameters import Floats

PASS_SHARE = 0.8
STOP_DB = 66.0


def antialias_taps(rate_hz: float, substeps: int) -> Floats:
    """Impulse response at ``rate_hz * substeps`` for decimation by ``substeps`` (Kaiser window, odd
    length).

    Passes to 0.8 of the Nyquist frequency of ``rate_hz``; the delay is ``(len - 1) / 2`` inner
    steps.
    """
    nyquist_inner = 0.5 * rate_hz * substeps
    stop = 0.5 * rate_hz
    count, beta = kaiserord(STOP_DB, (1 - PASS_SHARE) * stop / nyquist_inner)
    taps = firwin(
        count | 1, 0.5 * (1 + PASS_SHARE) * stop, window=("kaiser", beta), fs=2 * nyquist_inner
    )
    return np.ascontiguousarray(taps, dtype=np.float64)


def delay_periods(taps: Floats, substeps: int) -> int:
    """Delay of the filter in whole sampling periods (rounded up)."""
    return math.ceil((taps.size - 1) / 2 / substeps)
