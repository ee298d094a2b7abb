"""Spectra in bands: levels per hertz, shapes that shift with stiffness, phasors that tell in phase
from against."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_py.acquire.ringing import EDGES_HZ, spectra


def noise(n: int = 8000, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(1, n))


@pytest.mark.parametrize(("n", "rate"), [(4000, 5000.0), (10000, 5000.0), (8000, 10000.0)])
def test_level_is_power_per_hertz_at_any_rate_and_length(n: int, rate: float) -> None:
    density = 2e-4
    level, shape, _ = spectra(noise(n) * np.sqrt(density * rate / 2), rate, EDGES_HZ)
    assert level[0] == pytest.approx(np.log10(density) - 0.5772 / np.log(10), abs=0.05)
    assert np.abs(shape).max() < 0.8


def test_a_resonance_stands_in_its_band() -> None:
    time = np.arange(8000) / 5000.0
    _, shape, _ = spectra(0.01 * noise() + np.sin(2 * np.pi * 620.0 * time), 5000.0, EDGES_HZ)
    band = int(np.argmax(shape[0]))
    assert EDGES_HZ[band] <= 620.0 <= EDGES_HZ[band + 1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_phasors_tell_in_phase_from_against(sign: float) -> None:
    base = noise()
    _, _, cross = spectra(
        np.vstack([base, sign * base + 0.3 * noise(seed=1), noise(seed=2)]), 5000.0, EDGES_HZ
    )
    assert cross.shape == (3, 42)
    assert (sign * cross[0].real).mean() > 0.8
    assert abs(cross[1].real.mean()) < 0.1
    assert np.abs(cross).max() <= 1.0 + 1e-12
