"""Windows of measured recordings as rows of features, on whatever channels a rig has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.ringing import spectra
from models.diagnosis.dataset_folder import MeasuredRecording

Floats = NDArray[np.float64]
Features = Callable[[Floats, float], Floats]
"""A window ``(channels, n)`` and its sampling rate to a row of features."""

WINDOW_SAMPLES: Final = 200
WINDOW_LEAST_S: Final = 1.0
"""A window holds so many samples and lasts so long at least."""
BANDS: Final = 24
LOWEST_LINE: Final = 2
"""The device's bands begin at this line of a window's spectrum."""


@dataclass(frozen=True)
class FeatureRows:
    """Rows of one dataset: features by the name of their view, label, group, recording and machine
    of every window."""

    views: dict[str, Floats]
    label: NDArray[np.intp]
    group: NDArray[np.intp]
    recording: NDArray[np.intp]
    machine: NDArray[np.intp]
    labels: tuple[str, ...]
    groups: tuple[str, ...]
    machines: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.label)


def windows_of(found: list[MeasuredRecording]) -> FeatureRows:
    """Non-overlapping windows of every recording, in every view."""
    labels, groups, machines = (
        tuple(sorted({getattr(r, name) for r in found})) for name in ("label", "group", "machine")
    )
    rows: dict[str, list[Floats]] = {name: [] for name in VIEWS}
    told: list[tuple[int, int, int, int]] = []
    for number, recording in enumerate(found):
        n = window_samples(recording.rate_hz)
        for start in range(0, max(1, len(recording.samples) - n + 1), n):
            window = recording.samples[start : start + n].T
            for name, view in VIEWS.items():
                rows[name].append(view(window, recording.rate_hz))
            told.append(
                (
                    labels.index(recording.label),
                    groups.index(recording.group),
                    number,
                    machines.index(recording.machine),
                )
            )
    label, group, of, machine = np.array(told, np.intp).T
    views = {name: np.array(found) for name, found in rows.items()}
    return FeatureRows(views, label, group, of, machine, labels, groups, machines)


def window_samples(rate_hz: float) -> int:
    """Length of a window at ``rate_hz``."""
    return max(WINDOW_SAMPLES, round(WINDOW_LEAST_S * rate_hz))


def band_energies(bands: int, window: Floats, rate_hz: float) -> Floats:
    """Log energies of ``bands`` bands of equal width up to half the sampling rate, and moments, of
    every channel."""
    mean = window.mean(axis=1)
    deviation = window - mean[:, None]
    power = np.abs(np.fft.rfft(deviation * np.hanning(window.shape[1]))) ** 2
    energy = [
        np.log(part.sum(axis=1) + 1e-12) for part in np.array_split(power[:, 1:], bands, axis=1)
    ]
    std = deviation.std(axis=1) + 1e-12
    shape = [np.mean(deviation**3, axis=1) / std**3, np.mean(deviation**4, axis=1) / std**4]
    return np.concatenate([*energy, std, *shape])


def device_spectra(window: Floats, rate_hz: float) -> Floats:
    """Levels, shapes and phasors of the device's :func:`spectra` in bands even in the logarithm,
    and peakiness."""
    n = window.shape[1]
    lines = np.unique(
        np.round(np.geomspace(LOWEST_LINE, n // 2, min(BANDS, n // 4) + 1)).astype(np.intp)
    )
    level, shape, cross = spectra(window, rate_hz, lines * rate_hz / n)
    deviation = window - window.mean(axis=1, keepdims=True)
    rms = np.sqrt(np.mean(deviation**2, axis=1)) + 1e-12
    kurtosis = np.log10(np.mean(deviation**4, axis=1) / rms**4 + 0.1)
    crest = np.log10(np.abs(deviation).max(axis=1) / rms + 0.1)
    parts = (
        level,
        shape.ravel(),
        cross.real.ravel(),
        cross.imag.ravel(),
        np.log10(rms),
        kurtosis,
        crest,
    )
    return np.concatenate(parts)


VIEWS: Final[dict[str, Features]] = {
    "2 bands": partial(band_energies, 2),
    "16 bands": partial(band_energies, 16),
    "64 bands": partial(band_energies, 64),
    "spectra": device_spectra,
}
"""Coarse bands carry over to another speed, fine ones tell one session from another; which is
better, data say."""
