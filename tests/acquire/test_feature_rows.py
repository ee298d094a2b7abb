"""Figures read back from features, against those that the device has from window and orders."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire import features
from firmware_py.acquire.feature_rows import half_order_of, operating_points_of
from firmware_py.acquire.features import FEATURE_NAMES
from firmware_py.acquire.orders import Orders
from firmware_py.acquire.windows import Window
from firmware_py.brain.normal import operating_point
from firmware_py.brain.verdict import WHIRL_CLEARANCE_SHARE, WHIRL_SHARE, is_whirl

COUNT = 10_000
SHAFT = FEATURE_NAMES.index("log_shaft_rms_m")


def seen(rng: np.random.Generator) -> tuple[Window, Orders]:
    """One random window and its orders, as far as the figures go."""
    rms = 10.0 ** rng.uniform(-6.0, -4.3, 2)
    half = np.linalg.norm(rms) * 10.0 ** rng.uniform(-2.0, 0.0, 2)
    clearance = rng.uniform(40e-6, 160e-6)
    orders = Orders(
        speed_rad_s=rng.uniform(100.0, 1300.0),
        harmonics=np.zeros((7, 6), np.complex128),
        half=np.zeros(7),
        forward=np.ones(6) * 1e-6,
        backward=np.ones(6) * 1e-7,
        half_forward=half[0],
        half_backward=half[1],
        peak_to_peak=np.zeros(2),
        mean=np.append(rng.uniform(-0.6, 0.6, 2) * clearance, np.zeros(5)),
        rms=np.append(rms, np.zeros(5)),
        not_1x=np.zeros(7),
    )
    return Window(
        np.ones((1, 8)), 5000.0, np.zeros(1), 0, 0, 0, 0, 255, clearance, 50.0, rng.uniform(20, 60)
    ), orders


def row(window: Window, orders: Orders) -> NDArray[np.float32]:
    values = np.zeros(len(FEATURE_NAMES), np.float32)
    operating, shaft = features._operating(window, orders), features._shaft(window, orders)
    values[: len(operating)] = operating
    values[SHAFT : SHAFT + len(shaft)] = shaft
    return values


def test_features_give_the_figures_that_they_were_made_of() -> None:
    rng = np.random.default_rng(0)
    pairs = [seen(rng) for _ in range(COUNT)]
    rows = np.array([row(*pair) for pair in pairs])
    share, half_m, clearance_m = half_order_of(rows)
    true = np.array([(o.subsync_share, o.half_forward, w.clearance_m) for w, o in pairs]).T
    np.testing.assert_allclose(share, true[0], rtol=2e-5, atol=1e-6)
    np.testing.assert_allclose(half_m, true[1], rtol=2e-5, atol=1e-11)
    np.testing.assert_allclose(clearance_m, true[2], rtol=1e-6)
    told, known = is_whirl(share, half_m, clearance_m), is_whirl(*true)
    near = np.abs(true[0] / WHIRL_SHARE - 1.0) < 1e-4
    near |= np.abs(true[1] / (WHIRL_CLEARANCE_SHARE * true[2]) - 1.0) < 1e-4
    assert near.sum() < COUNT / 1000
    assert (told == known)[~near].all()
    assert 0.1 < known.mean() < 0.9
    points = np.array([operating_point(*pair) for pair in pairs])
    np.testing.assert_allclose(operating_points_of(rows), points, rtol=2e-5)
    assert math.isclose(points[:, 1].min(), 40e-6, rel_tol=0.1)
