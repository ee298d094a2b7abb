"""Sampling rate from time stamps, gaps, and one rate for all."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.readers.signal_file import SignalFileError, library

Floats = NDArray[np.float64]

JITTER: Final = 0.1
"""Spread of the steps, over their median, below which stamps are taken as even."""
GAP: Final = 1.5
"""A step of so many periods is a gap."""
COARSE: Final = 0.05
"""Stamps of which this share repeats the one before are rounded: only their ends give the rate."""
DENOMINATOR_MOST: Final = 2000


def rate_of_stamps(time_s: Floats, where: str, lines: NDArray[np.intp] | None) -> float:
    """Sampling rate (Hz) of even stamps.

    Parameters
    ----------
    time_s
        Shape (n,), seconds.
    where
        File and column, for messages.
    lines
        Line of each stamp in a text file.

    Raises
    ------
    SignalFileError
        Stamps go back, have a gap or are uneven: with the place.
    """

    def at(index: int) -> str:
        place = f"line {lines[index]}" if lines is not None else f"sample {index}"
        return f"{where}: {place}"

    bad = np.flatnonzero(~np.isfinite(time_s))
    if len(bad):
        raise SignalFileError(f"{at(int(bad[0]))}: no time; fill it or cut the recording there")
    if len(time_s) < 2:
        raise SignalFileError(f"{where}: {len(time_s)} stamp gives no rate; give rate_hz")
    step = np.diff(time_s)
    back = np.flatnonzero(step < 0.0)
    if len(back):
        i = int(back[0]) + 1
        raise SignalFileError(
            f"{at(i)}: time goes back from {time_s[i - 1]:.6g} s to {time_s[i]:.6g} s; these are "
            "two recordings: make a file of each"
        )
    if not time_s[-1] > time_s[0]:
        raise SignalFileError(f"{where}: time stands still; give rate_hz, or the right time column")
    coarse = float(np.mean(step == 0.0)) > COARSE
    tick = float(step[step > 0.0].min()) if coarse else 0.0
    period = float((time_s[-1] - time_s[0]) / len(step)) if coarse else float(np.median(step))
    far = np.flatnonzero(step > GAP * period + 2.0 * tick)
    if len(far):
        i = int(far[0]) + 1
        raise SignalFileError(
            f"{at(i)}: gap of {step[i - 1]:.4g} s after {time_s[i - 1]:.6g} s ({len(far)} gaps in "
            "all); cut the recording there (start_s, end_s), or make a file of each part"
        )
    off_s = np.abs(time_s - np.linspace(time_s[0], time_s[-1], len(time_s))).max()
    uneven = off_s > 2.0 * tick + period if coarse else float(step.std()) > JITTER * period
    if uneven:
        raise SignalFileError(
            f"{where}: uneven steps from {step.min():.4g} to {step.max():.4g} s; record at an even "
            "rate, or bring it to one first"
        )
    return float(len(step) / (time_s[-1] - time_s[0]))


def rounded_rate(rate_hz: float) -> float:
    """``rate_hz`` without the rounding of time stamps: whole where it is within 0.01 %."""
    whole = round(rate_hz)
    return float(whole) if whole and abs(rate_hz - whole) < 1e-4 * whole else rate_hz


def resampled(values: Floats, rate_hz: float, to_hz: float, path: Path) -> Floats:
    """``values`` (n, ...) at ``to_hz``: polyphase filter, cut at the lower Nyquist frequency.

    Raises
    ------
    SignalFileError
        ``to_hz`` is higher: what was not sampled cannot be made.
    """
    if abs(rate_hz - to_hz) <= 1e-9 * to_hz:
        return values
    if to_hz > rate_hz:
        raise SignalFileError(
            f"{path.name}: sampled at {rate_hz:g} Hz, resample_hz asks for {to_hz:g}: nothing lies "
            f"above {rate_hz / 2:g} Hz in it; ask for at most {rate_hz:g}, or leave it out"
        )
    ratio = Fraction(to_hz / rate_hz).limit_denominator(DENOMINATOR_MOST)
    signal = library("scipy.signal", path)
    found = signal.resample_poly(values, ratio.numerator, ratio.denominator, axis=0, padtype="mean")
    return np.asarray(found, np.float64)
