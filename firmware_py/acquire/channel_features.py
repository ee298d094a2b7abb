"""Features of any fast channels: what a classifier of a user's own recordings sees, in training and
on the device.

A *view* turns a window of samples into a row of features.  Coarse bands carry over to another
speed, fine ones tell one session from another, orders follow the shaft: which is best, data say.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.orders import BINS, HALF_BAND, band_amplitude, over_angle, resampling_loss
from firmware_py.acquire.ringing import spectra

Floats = NDArray[np.float64]
View = Callable[[Floats, float, Floats | None], Floats]
"""Samples ``(channels, n)`` in SI, sampling rate (Hz) and shaft angle ``(n,)`` (turns) or None, to
a row of features."""

WINDOW_SAMPLES: Final = 200
WINDOW_S: Final = 1.0
"""A window holds so many samples and, where nobody asks otherwise, lasts so long at least."""
BANDS: Final = 24
LOWEST_LINE: Final = 2
"""The bands of ``spectra`` begin at this line of a window's spectrum."""
ORDERS: Final = 8
TURNS_LEAST: Final = 8
"""Whole turns below which half orders are not resolved."""
SAMPLES_A_TURN: Final = 20.0
"""Samples a turn below which the eighth order is not resolved."""
MARKS_LEAST: Final = 3
ORDERS_VIEW: Final = "orders"
_FLOOR: Final = 1e-12


def window_samples(rate_hz: float, window_s: float = WINDOW_S) -> int:
    """Length of a window at ``rate_hz``."""
    return max(WINDOW_SAMPLES, round(window_s * rate_hz))


def band_energies(bands: int, window: Floats, rate_hz: float, turns: Floats | None) -> Floats:
    """Log energies of ``bands`` bands of equal width up to half the sampling rate, and moments, of
    every channel."""
    mean = window.mean(axis=1)
    deviation = window - mean[:, None]
    power = np.abs(np.fft.rfft(deviation * np.hanning(window.shape[1]))) ** 2
    energy = [
        np.log(part.sum(axis=1) + _FLOOR) for part in np.array_split(power[:, 1:], bands, axis=1)
    ]
    std = deviation.std(axis=1) + _FLOOR
    shape = [np.mean(deviation**3, axis=1) / std**3, np.mean(deviation**4, axis=1) / std**4]
    return np.concatenate([*energy, std, *shape])


def device_spectra(window: Floats, rate_hz: float, turns: Floats | None) -> Floats:
    """Levels, shapes and phasors of :func:`~firmware_py.acquire.ringing.spectra` in bands even in
    the logarithm, and peakiness."""
    n = window.shape[1]
    lines = np.unique(
        np.round(np.geomspace(LOWEST_LINE, n // 2, min(BANDS, n // 4) + 1)).astype(np.intp)
    )
    level, shape, cross = spectra(window, rate_hz, lines * rate_hz / n)
    parts = (level, shape.ravel(), cross.real.ravel(), cross.imag.ravel(), *_levels(window))
    return np.concatenate(parts)


def orders(window: Floats, rate_hz: float, turns: Floats | None) -> Floats:
    """Amplitudes of the orders 1 to 8 and of the half-order band, phases between channels at the
    first, levels, and speed.

    Raises
    ------
    ValueError
        The angle is not known, or the turns do not resolve orders (:func:`no_orders`).
    """
    if reason := no_orders(rate_hz, turns):
        raise ValueError(reason)
    assert turns is not None
    whole = int(turns[-1] - turns[0])
    angle = turns[0] + np.arange(whole * BINS + 1) / BINS
    edges = np.interp(angle, turns, np.arange(len(turns), dtype=np.float64))
    even = over_angle(window, edges)
    weight = np.hanning(even.shape[1] + 1)[:-1]
    spectrum = 2.0 * np.fft.rfft(
        (even - even.mean(axis=1, keepdims=True)) * (weight / weight.sum())
    )
    samples_per_turn = float(edges[-1] - edges[0]) / whole
    number = np.arange(1, ORDERS + 1)
    lines = spectrum[:, whole * number] / resampling_loss(number, samples_per_turn)
    half = band_amplitude(
        spectrum[:, round(HALF_BAND[0] * whole) : round(HALF_BAND[1] * whole) + 1]
    )
    first = [lines[a, 0] * np.conj(lines[b, 0]) for a, b in combinations(range(len(lines)), 2)]
    phase = np.array([z / max(abs(z), _FLOOR**2) for z in first], np.complex128)
    speed = math.log10(rate_hz / samples_per_turn)
    parts = (_log(np.abs(lines)).ravel(), _log(half), phase.real, phase.imag, *_levels(window))
    return np.concatenate([*parts, [speed]])


def no_orders(rate_hz: float, turns: Floats | None) -> str:
    """Why a window has no orders; empty where it has."""
    if turns is None:
        return "neither mark nor speed is known"
    if not np.all(np.diff(turns) > 0.0):
        return "the shaft stands, or its angle goes back"
    count = float(turns[-1] - turns[0])
    if count < TURNS_LEAST:
        return f"{count:.1f} turns in {len(turns) / rate_hz:g} s, at least {TURNS_LEAST} are needed"
    if len(turns) / count < SAMPLES_A_TURN:
        return f"{len(turns) / count:.1f} samples a turn, at least {SAMPLES_A_TURN:g} are needed"
    return ""


def angle_at(marks: Floats, at: Floats) -> Floats:
    """Turns at the places ``at``: linear between marks, as fast as the nearest turn beyond them.

    Parameters
    ----------
    marks
        Where once-per-turn marks passed, increasing, at least two, in the unit of ``at``.
    """
    turn = np.arange(len(marks), dtype=np.float64)
    angle = np.interp(at, marks, turn)
    before, after = at < marks[0], at > marks[-1]
    angle[before] = (at[before] - marks[0]) / (marks[1] - marks[0])
    angle[after] = turn[-1] + (at[after] - marks[-1]) / (marks[-1] - marks[-2])
    return np.asarray(angle)


def _levels(window: Floats) -> tuple[Floats, Floats, Floats]:
    """``log10`` of rms, kurtosis and crest factor of every channel."""
    deviation = window - window.mean(axis=1, keepdims=True)
    rms = np.sqrt(np.mean(deviation**2, axis=1)) + _FLOOR
    kurtosis = np.log10(np.mean(deviation**4, axis=1) / rms**4 + 0.1)
    crest = np.log10(np.abs(deviation).max(axis=1) / rms + 0.1)
    return np.log10(rms), kurtosis, crest


def _log(amplitude: Floats) -> Floats:
    return np.asarray(np.log10(amplitude + _FLOOR))


VIEWS: Final[dict[str, View]] = {
    "2 bands": partial(band_energies, 2),
    "16 bands": partial(band_energies, 16),
    "64 bands": partial(band_energies, 64),
    "spectra": device_spectra,
    ORDERS_VIEW: orders,
}
"""By name; the name stands in a model's card."""
