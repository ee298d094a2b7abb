"""The environments' share of energy at half order, against the device's order analysis."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_py.acquire.orders import analyse
from firmware_py.acquire.windows import Window
from sim_hil.gym.control_task import subsynchronous_share

RATE_HZ = 5000.0
SECONDS = 0.8
TOLERANCE = 0.03
"""Of a share between 0 and 1: a Hann window over time here, over whole turns there."""


def orbit(rng: np.random.Generator) -> tuple[NDArray[np.float64], float]:
    """A first order, a half order of any size, and noise, shape (n, 2), with the speed."""
    speed = rng.uniform(250.0, 1300.0)
    angle = speed * np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    first, half = 10.0 ** rng.uniform(-6.0, -4.5, 2)
    order, phase = rng.uniform(0.42, 0.53), rng.uniform(0.0, 2.0 * math.pi, 2)
    z = first * np.exp(1j * (angle + phase[0])) + half * np.exp(1j * (order * angle + phase[1]))
    xy = np.column_stack([z.real, z.imag])
    return xy + rng.normal(0.0, 2e-8, xy.shape), speed


def device_share(xy: NDArray[np.float64], speed: float) -> float:
    samples = np.zeros((len(xy), 8))
    samples[:, :2] = xy
    turn = 2.0 * math.pi / speed * RATE_HZ
    marks = np.arange(0.0, len(xy) - 1.0, turn)
    return analyse(Window(samples, RATE_HZ, marks, 0, 0, 0, 0, 255, 6e-5, 50.0, 45.0)).subsync_share


def compare(count: int) -> None:
    rng = np.random.default_rng(0)
    for _ in range(count):
        xy, speed = orbit(rng)
        found = float(subsynchronous_share(xy, RATE_HZ, np.array(speed)))
        assert found == pytest.approx(device_share(xy, speed), abs=TOLERANCE)


def test_both_see_the_same_share_at_half_order() -> None:
    compare(300)


@pytest.mark.slow
def test_both_see_the_same_share_in_ten_thousand_orbits() -> None:
    compare(10_000)
