"""Order analysis of a window: spectra over shaft angle instead of time.

The once-per-turn marks give the shaft angle of every sample (linear between marks).  Each channel
is averaged over equal angle bins by interpolating its running integral (a box filter in angle: no
aliasing from resampling), and a Hann-weighted FFT over whole turns gives amplitudes per order.  The
box and the sample-and-hold of the integration are divided out.  The orbit ``x + jy`` gives the full
spectrum: forward orders (in the direction of rotation) and backward orders.

Sources: order tracking by angular resampling, Fyfe and Munck 1997; full spectrum, Goldman and
Muszynska 1999.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.windows import Window

BINS: Final = 32
"""Angle bins per turn."""
TURN_STEP: Final = 8
"""Turns are used in multiples of this, so that the FFT has small factors."""
ORDERS: Final = 6
"""Whole orders that are reported: 1X .. 6X; a rub shows in the third, fifth and sixth."""
HALF_BAND: Final = (0.35, 0.60)
"""Orders in which oil whirl and half-order looseness show."""
ROTATING: Final = (0, 1, 2, 3, 4, 5, 7)
"""Channels analysed over angle: shaft x, y, three accelerations, microphone, contact resistance."""
CONTACT: Final = 6
"""Row of the contact resistance, whose orders show the true film, free of the probes' runout."""

_HANN_ENBW: Final = 1.5

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Orders:
    """Amplitudes (zero to peak, SI) of one window.

    Attributes
    ----------
    speed_rad_s
        Mean shaft speed over the whole turns.
    harmonics
        Shape (7, 6), complex: order k+1 of the channels of :data:`ROTATING`; phase from the mark.
    half
        Shape (7,): amplitude of a sine with the energy of the half-order band.
    forward, backward
        Shape (6,): amplitudes of the orbit's orders 1 .. 6 with and against the rotation.
    half_forward, half_backward
        Of the orbit's half-order band.
    peak_to_peak
        Shape (2,): median over the turns, shaft x and y.
    mean
        Shape (7,).
    rms
        Shape (7,): without the mean.
    not_1x
        Shape (7,): rms of everything but the first order.
    """

    speed_rad_s: float
    harmonics: Complexes
    half: Floats
    forward: Floats
    backward: Floats
    half_forward: float
    half_backward: float
    peak_to_peak: Floats
    mean: Floats
    rms: Floats
    not_1x: Floats

    @property
    def subsync_share(self) -> float:
        """Share of the orbit's vibration energy that lies in the half-order band."""
        rms = np.sqrt(np.sum(self.rms[:2] ** 2))
        half = np.array(self.half_forward), np.array(self.half_backward)
        return float(subsync_share(*half, rms))


def subsync_share(half_forward: Floats, half_backward: Floats, rms: Floats) -> Floats:
    """Share of an orbit's vibration energy in the half-order band, 0 for an orbit of none; any
    shape.

    Parameters
    ----------
    half_forward, half_backward
        Amplitudes with the energy of the band, m.
    rms
        Of both axes together, m.
    """
    energy = rms * rms
    band = half_forward * half_forward + half_backward * half_backward
    return np.asarray(np.minimum(1.0, band / np.where(energy > 0.0, energy, np.inf)))


def analyse(window: Window) -> Orders:
    """Order analysis of ``window``, which must hold whole turns (quality without ``NO_MARK``)."""
    turns = window.turns - window.turns % TURN_STEP
    marks = window.marks[-1 - turns :]
    samples_per_turn = float(marks[-1] - marks[0]) / turns
    angle = by_angle(window.samples, marks)
    whole = window.samples[int(marks[0]) : int(marks[-1]), ROTATING]
    mean = angle.mean(axis=1)
    rms = whole.std(axis=0)

    weight = np.hanning(angle.shape[1] + 1)[:-1]
    weighted = (angle - mean[:, None]) * (weight / weight.sum())
    spectrum = 2.0 * np.fft.rfft(weighted)
    orbit = np.fft.fft(weighted[0] + 1j * weighted[1])
    lines = turns * np.arange(1, ORDERS + 1)
    loss = resampling_loss(np.arange(1, ORDERS + 1), samples_per_turn)
    harmonics = spectrum[:, lines] / loss
    half = np.arange(round(HALF_BAND[0] * turns), round(HALF_BAND[1] * turns) + 1)
    return Orders(
        speed_rad_s=2.0 * math.pi * window.rate_hz / samples_per_turn,
        harmonics=harmonics,
        half=band_amplitude(spectrum[:, half]),
        forward=np.abs(orbit[lines] / loss),
        backward=np.abs(orbit[-lines] / loss),
        half_forward=float(band_amplitude(orbit[half])),
        half_backward=float(band_amplitude(orbit[-half])),
        peak_to_peak=_peak_to_peak(angle[:2], turns),
        mean=mean,
        rms=rms,
        not_1x=np.sqrt(np.maximum(rms**2 - 0.5 * np.abs(harmonics[:, 0]) ** 2, 0.0)),
    )


def by_angle(samples: Floats, marks: Floats) -> Floats:
    """Means of :data:`ROTATING` over equal angle bins from the first to the last mark, shape (7,
    turns * BINS)."""
    turns = len(marks) - 1
    edges = np.interp(np.arange(turns * BINS + 1) / BINS, np.arange(turns + 1), marks)
    return over_angle(np.ascontiguousarray(samples[:, ROTATING].T), edges)


def over_angle(signal: Floats, edges: Floats) -> Floats:
    """Means of ``signal`` (channels, n) between the places ``edges`` (m + 1,), counted in samples,
    shape (channels, m)."""
    integral = np.cumsum(signal, axis=1) - signal
    # Sample i stands for [i - 1/2, i + 1/2): an edge at position t has t + 1/2 samples behind it;
    # the last one goes on, for of a fast shaft several edges lie in its second half.
    position = np.maximum(edges + 0.5, 0.0)
    below = np.minimum(position.astype(np.intp), signal.shape[1] - 1)
    at_edges = integral[:, below] + (position - below) * signal[:, below]
    return np.asarray(np.diff(at_edges) / np.diff(position))


def resampling_loss(orders: NDArray[np.int_], samples_per_turn: float) -> Complexes:
    """Gain and phase of the angle bin (centre half a bin late) and of the sample-and-hold, per
    order."""
    box = np.sinc(orders / BINS) * np.sinc(orders / samples_per_turn)
    return np.asarray(box * np.exp(1j * np.pi * orders / BINS))


def band_amplitude(lines: Complexes) -> Floats:
    """Amplitude of a sine with the energy of ``lines`` (Hann weighted), over the last axis."""
    return np.asarray(np.sqrt(np.sum(np.abs(lines) ** 2, axis=-1) / _HANN_ENBW))


def _peak_to_peak(shaft: Floats, turns: int) -> Floats:
    return np.asarray(np.median(np.ptp(shaft.reshape(2, turns, BINS), axis=2), axis=1))
