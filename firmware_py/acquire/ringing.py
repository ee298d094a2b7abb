"""Ringing of pedestal and motor: shape of their spectra where ambient forces excite the modes of
the feet.

A loose bolt lowers the modes of its body, and, standing on one side, makes lift and roll one
motion: the vertical and the horizontal acceleration of the pedestal then ring in phase or against
it.  Bands are even in the logarithm of frequency, so that a stiffer foundation only shifts the
pattern.  In each band stand the mean of the logarithm of the periodogram and the mean of the unit
phasors between two channels: both count every line once, so that a strong line of the rotation
moves them little.

Source: a bolted joint's stiffness in the modes of the body, Bograd, Reuss, Schmidt, Gaul and Mayer
(2011); phase transform of the cross spectrum, Knapp and Carter (1976).
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.windows import Window

CHANNELS: Final = {"acc_bearing_vertical": 2, "acc_bearing_horizontal": 3, "acc_motor": 4}
EDGES_HZ: Final = np.geomspace(150.0, 1200.0, 43)
FLOOR_PSD: Final = 1e-9
"""(m/s2)^2/Hz, below the noise of an accelerometer."""

_PAIRS: Final = tuple(combinations(range(len(CHANNELS)), 2))
_HANN_POWER: Final = 0.375

Floats = NDArray[np.float64]


def names() -> tuple[str, ...]:
    """Names of what :func:`ringing` returns, in its order."""
    channels = tuple(CHANNELS)
    bands = [f"{centre:.0f}Hz" for centre in np.sqrt(EDGES_HZ[1:] * EDGES_HZ[:-1])]
    return (
        *(f"{name}_ringing_log_psd" for name in channels),
        *(f"{name}_ringing_{band}" for name in channels for band in bands),
        *(
            f"{channels[a]}_to_{channels[b]}_ringing_{part}_{band}"
            for a, b in _PAIRS
            for part in ("in_phase", "quadrature")
            for band in bands
        ),
    )


def ringing(window: Window) -> Floats:
    """Levels (3,), shapes (3 x 42) as ``log10`` of power density over the level, phasors (3 pairs x
    2 x 42)."""
    level, shape, cross = spectra(
        window.samples[:, list(CHANNELS.values())].T, window.rate_hz, EDGES_HZ
    )
    return np.concatenate([level, shape.ravel(), *(np.r_[c.real, c.imag] for c in cross)])


def spectra(
    signal: Floats, rate_hz: float, edges_hz: Floats
) -> tuple[Floats, Floats, NDArray[np.complex128]]:
    """Level, shape and phasors of some channels in the bands between ``edges_hz``.

    Parameters
    ----------
    signal
        Shape (channels, n).
    edges_hz
        Shape (bands + 1,); each band holds a line of the spectrum at least.

    Returns
    -------
    tuple
        Mean ``log10`` of the power density (channels,), what each band lies above it (channels,
        bands), mean unit phasor of every pair of channels (pairs, bands).
    """
    n = signal.shape[1]
    edges = np.round(edges_hz * n / rate_hz).astype(np.intp)
    starts, count = edges[:-1] - edges[0], np.diff(edges)
    lines = np.fft.rfft((signal - signal.mean(axis=1, keepdims=True)) * np.hanning(n))[
        :, edges[0] : edges[-1]
    ]
    size = np.abs(lines)
    density = size**2 * (2.0 / (n * _HANN_POWER * rate_hz))
    shape = np.add.reduceat(np.log10(density + FLOOR_PSD), starts, axis=1) / count
    level = shape.mean(axis=1)
    phasor = lines / np.maximum(size, 1e-300)
    pairs = combinations(range(len(signal)), 2)
    cross = [np.add.reduceat(phasor[a] * np.conj(phasor[b]), starts) / count for a, b in pairs]
    return level, shape - level[:, None], np.array(cross).reshape(-1, len(count))
