"""A recording whose answer is known: circular and elliptic orbits, orders, a half-order line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire.channel_map import WIRE_SCALES


def recording(
    rate_hz: int = 5000,
    *,
    seconds: float = 4.0,
    start_hz: float = 50.0,
    ramp_hz_s: float = 0.0,
    forward_m: tuple[float, ...] = (10e-6,),
    backward_m: tuple[float, ...] = (),
    half_m: float = 0.0,
    acceleration_m_s2: float = 5.0,
    noise: float = 0.05,
    phase_rad: float = 0.5,
) -> tuple[NDArray[np.int16], NDArray[np.int64]]:
    """Counts (n, 8) and mark ticks (us); the shaft turns at ``start_hz + ramp_hz_s t``."""
    rng = np.random.default_rng(3)
    t = np.arange(round(rate_hz * seconds)) / rate_hz
    angle = 2 * np.pi * (start_hz * t + 0.5 * ramp_hz_s * t * t)
    orbit = np.full(len(t), 20e-6 - 5e-6j)
    for k, amplitude in enumerate(forward_m, 1):
        orbit = orbit + amplitude * np.exp(1j * (k * angle - phase_rad))
    for k, amplitude in enumerate(backward_m, 1):
        orbit = orbit + amplitude * np.exp(-1j * k * angle)
    orbit = orbit + half_m * np.exp(0.48j * angle)
    probes = orbit * np.exp(-0.25j * np.pi)
    si = np.column_stack(
        [
            probes.real,
            probes.imag,
            *(
                acceleration_m_s2 * np.cos(angle - i) + rng.normal(0, noise, len(t))
                for i in range(3)
            ),
            rng.normal(0, 0.05, len(t)),
            np.full(len(t), 1.0),
            np.full(len(t), 1.2),
        ]
    )
    turns = np.arange(int(angle[-1] / (2 * np.pi)) + 1)
    fine = np.linspace(0, seconds, 200 * len(t) // 10 + 1)
    fine_turns = start_hz * fine + 0.5 * ramp_hz_s * fine * fine
    marks = np.round(np.interp(turns, fine_turns, fine) * 1e6).astype(np.int64)
    return np.round(si / np.array(WIRE_SCALES)).astype(np.int16), marks


def readings(seconds: float = 4.0, clearance_m: float = 60e-6) -> NDArray[np.float64]:
    """Table for ``iter_windows``: tick, clearance, power, oil, every 50 ms."""
    ticks = np.arange(0, seconds * 1e6, 5e4)
    return np.column_stack([ticks, *(np.full(len(ticks), v) for v in (clearance_m, 120.0, 45.0))])
