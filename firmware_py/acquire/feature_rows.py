"""Figures read back from rows of features, for whoever has these alone (training, evaluation).

Within the float32 of the features (1e-5 of a value) they are what the device has from window and
orders: the tests hold both against each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.features import FEATURE_NAMES, FLOOR_DISPLACEMENT_M
from firmware_py.acquire.orders import subsync_share

Floats = NDArray[np.float64]
Rows = NDArray[np.floating]
"""Shape (n, len(FEATURE_NAMES))."""


def half_order_of(rows: Rows) -> tuple[Floats, Floats, Floats]:
    """Share of the orbit's energy at half order, its forward amplitude (m), and the clearance (m).

    Shape (n,) each: what :func:`firmware_py.brain.verdict.is_whirl` asks for.
    """
    rms, forward, backward = _columns(
        rows, "log_shaft_rms_m", "shaft_half_fwd_rms", "shaft_half_bwd_rms"
    )
    rms_m, forward_m, backward_m = (_amplitude(log) for log in (rms, forward + rms, backward + rms))
    clearance_m = 1e-4 * _columns(rows, "clearance_100um")[0]
    return subsync_share(forward_m, backward_m, rms_m), forward_m, clearance_m


def operating_points_of(rows: Rows) -> Floats:
    """Operating points (n, 4), columns :data:`firmware_py.brain.normal.POINT`."""
    speed, clearance, x, y, oil = _columns(
        rows,
        "log_speed_rad_s",
        "clearance_100um",
        "mean_x_over_clearance",
        "mean_y_over_clearance",
        "oil_outlet_50C",
    )
    return np.column_stack([10.0**speed, clearance * 1e-4, np.hypot(x, y), 50.0 * oil])


def _columns(rows: Rows, *names: str) -> list[Floats]:
    return [rows[:, FEATURE_NAMES.index(name)].astype(np.float64) for name in names]


def _amplitude(log: Floats) -> Floats:
    """Displacement of a feature that is its ``log10`` above the floor."""
    return np.asarray(np.sqrt(np.maximum(10.0 ** (2.0 * log) - FLOOR_DISPLACEMENT_M**2, 0.0)))
