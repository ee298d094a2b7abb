"""Feature vector of a window: what the classifier and its novelty score see.

Amplitudes are ``log10`` of SI values (m, m/s2, Pa, W) above a floor near the sensor noise; orders
above the first stand as ``log10`` ratios to the first order or to the total, which cancels gain
errors and most of the spread between builds; phases are sine and cosine of differences between
channels at one order, which cancels the unknown angle of the mark.  Faster recordings are brought
to one rate first, so that models of one rate serve all.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.acquire import film_check, ringing
from firmware_py.acquire.film_check import LEAST_SHARE, circuit_of, read_volt
from firmware_py.acquire.orders import CONTACT, ORDERS, Orders, analyse
from firmware_py.acquire.windows import Window
from firmware_py.machine import Machine
from firmware_py.machine.contact import film_of, film_per_volt

RATE_HZ: Final = 5000.0
"""Rate that features are taken at; the bands and crest factors would change with another."""

BAND_EDGES_HZ: Final = (20.0, 100.0, 250.0, 500.0, 900.0, 1400.0, 2000.0)
"""Fixed bands for housing resonances and the microphone."""

FLOOR_DISPLACEMENT_M: Final = 1e-8
FLOOR_ACCELERATION_M_S2: Final = 1e-3
FLOOR_SOUND_PA: Final = 1e-4
FLOOR_VOLT: Final = 1e-3
FLOOR_POWER_W: Final = 0.1
FLOOR_FILM: Final = 1e-4
FLOOR_FILM_SHARE: Final = 2e-2
FLOOR_POSITION: Final = 1e-2
FILM_UNIT_M: Final = 5e-6

HIGH_ORDERS: Final = range(4, ORDERS + 1)
"""Orders of the orbit that neither probe nor film makes in a healthy machine: absolute, not over
the first."""

_ACC: Final = ("acc_bearing_vertical", "acc_bearing_horizontal", "acc_motor")
_BANDED: Final = (*_ACC, "microphone")
_PAIRS: Final = (
    ("acc_bearing_vertical", 2, "shaft_y", 1),
    ("acc_bearing_horizontal", 3, "shaft_x", 0),
    ("acc_bearing_vertical", 2, "acc_bearing_horizontal", 3),
    ("acc_motor", 4, "acc_bearing_vertical", 2),
    ("shaft_y", 1, "shaft_x", 0),
)
"""Channel pairs whose phase difference at 1X is a feature."""

_OPERATION: Final = (
    "log_speed_rad_s",
    "clearance_100um",
    "pressure_bar",
    "log_shaft_power_W",
    "oil_outlet_50C",
    "mean_x_over_clearance",
    "mean_y_over_clearance",
    "log_clearance_100um",
    "log_power_over_petroff",
    "eccentricity_square",
    "log_film_share",
)
"""How the machine is run: speed, readings, and where the shaft floats."""


def _names() -> tuple[str, ...]:
    """Names in the order in which :func:`from_orders` fills the vector."""
    return (
        *_OPERATION,
        "log_shaft_rms_m",
        "log_shaft_fwd_1x_m",
        "shaft_bwd_fwd_1x",
        "shaft_fwd_2x_1x",
        "shaft_bwd_2x_1x",
        "shaft_fwd_3x_1x",
        "shaft_bwd_3x_1x",
        "shaft_half_fwd_rms",
        "shaft_half_bwd_rms",
        "shaft_not_1x_rms",
        "shaft_p2p_x_clearance",
        "shaft_p2p_y_clearance",
        *(f"log_shaft_{way}_{k}x_m" for way in ("fwd", "bwd") for k in HIGH_ORDERS),
        *(
            f"{name}_{what}"
            for name in _ACC
            for what in (
                "log_rms",
                "1x_rms",
                *(f"{k}x_1x" for k in range(2, ORDERS + 1)),
                "half_rms",
                "not_1x_rms",
                "kurtosis",
                "crest",
                "1x_per_shaft",
                "2x_phase_sin",
                "2x_phase_cos",
            )
        ),
        "acc_bearing_horizontal_vertical_1x",
        "acc_motor_bearing_1x",
        "acc_bearing_horizontal_vertical_rms",
        "acc_motor_bearing_rms",
        *(f"{a}_{b}_1x_{part}" for a, _, b, _ in _PAIRS for part in ("sin", "cos")),
        "microphone_log_rms",
        "microphone_1x_rms",
        "microphone_2x_rms",
        *(
            f"{name}_band_{low:.0f}_{high:.0f}"
            for name in _BANDED
            for low, high in pairwise(BAND_EDGES_HZ)
        ),
        "pressure_log_std",
        "contact_mean_V",
        "contact_log_std_V",
        "contact_low_V",
        "contact_1x_film",
        "contact_2x_film",
        "contact_half_film",
        "contact_log_film",
        "contact_film_over_position",
        "contact_eccentricity",
        *film_check.names(),
        *ringing.names(),
    )


FEATURE_NAMES: Final = _names()
"""Names of the features, in order; part of every classifier's metadata."""


def _group(name: str) -> str:
    """What a feature is about: a channel's orders or its ringing, or how the machine is run."""
    if name in _OPERATION:
        return "operation"
    if name in film_check.names():
        return "film"
    about = "ringing" if "ringing" in name else "orders"
    stem = name.split("_to_")[0]
    for channel in (*_BANDED, "shaft", "contact"):
        if stem.removeprefix("log_").startswith(channel):
            return f"{channel}_{about}"
    return "pressure"


GROUPS: Final = tuple(dict.fromkeys(map(_group, FEATURE_NAMES)))
"""What features are about, in order of their first appearance."""
GROUP_OF_FEATURE: Final = np.array([GROUPS.index(_group(name)) for name in FEATURE_NAMES])
"""Index into :data:`GROUPS` of every feature."""


def features(window: Window, machine: Machine) -> NDArray[np.float32]:
    """Feature vector of ``window``, shape ``(len(FEATURE_NAMES),)``.

    A reading that never came (NaN clearance, power, temperature) leaves NaN in its features: the
    caller gives no diagnosis from them.

    Parameters
    ----------
    window
        With whole turns (quality without ``NO_MARK``).
    machine
        Whose film, oil and contact circuit the readings are held against.

    Raises
    ------
    NoContactError
        The machine has no contact channel.
    """
    window = at_one_rate(window)
    return from_orders(window, analyse(window), machine)


def at_one_rate(window: Window) -> Window:
    """``window`` at :data:`RATE_HZ`: the spectrum of a faster one is cut at the new Nyquist
    frequency."""
    faster = round(window.rate_hz / RATE_HZ)
    if faster <= 1:
        return window
    n = len(window.samples) // faster
    spectrum = np.fft.rfft(window.samples[: n * faster], axis=0)[: n // 2 + 1]
    return replace(
        window,
        samples=np.fft.irfft(spectrum, n, axis=0) / faster,
        rate_hz=RATE_HZ,
        marks=window.marks / faster,
    )


def from_orders(window: Window, orders: Orders, machine: Machine) -> NDArray[np.float32]:
    """As :func:`features`, with window and order analysis of :data:`RATE_HZ` already at hand."""
    log_bands, log_rms = _bands(window)
    vector = np.concatenate(
        [
            _operating(window, orders),
            _shaft(window, orders),
            *(_acceleration(window, orders, channel) for channel in (2, 3, 4)),
            _acceleration_ratios(orders),
            _pair_phases(orders),
            _microphone(orders),
            (log_bands - log_rms[:, None]).ravel(),
            _slow_channels(window),
            _contact_film(window, orders, machine),
            film_check.film_check(window, orders, machine),
            ringing.ringing(window),
        ]
    )
    return vector.astype(np.float32)


def _log(value: object, floor: float) -> NDArray[np.float64]:
    """``log10`` of an amplitude above ``floor``, smooth through it."""
    return np.asarray(0.5 * np.log10(np.square(np.asarray(value, np.float64)) + floor * floor))


def _operating(window: Window, orders: Orders) -> NDArray[np.float64]:
    square = float(orders.mean[0] ** 2 + orders.mean[1] ** 2) / window.clearance_m**2
    return np.array(
        [
            np.log10(orders.speed_rad_s),
            window.clearance_m / 1e-4,
            np.mean(window.samples[:, 6]),
            _log(window.shaft_power_W, FLOOR_POWER_W),
            window.oil_outlet_C / 50.0,
            orders.mean[0] / window.clearance_m,
            orders.mean[1] / window.clearance_m,
            np.log10(window.clearance_m / 1e-4),
            _log(window.shaft_power_W, FLOOR_POWER_W)
            + np.log10(window.clearance_m / orders.speed_rad_s**2),
            square,
            _log(max(1.0 - square**0.5, 0.0), FLOOR_FILM_SHARE),
        ]
    )


def _shaft(window: Window, orders: Orders) -> NDArray[np.float64]:
    floor = FLOOR_DISPLACEMENT_M
    forward, backward = _log(orders.forward, floor), _log(orders.backward, floor)
    rms = _log(np.hypot(orders.rms[0], orders.rms[1]), floor)
    return np.array(
        [
            rms,
            forward[0],
            backward[0] - forward[0],
            forward[1] - forward[0],
            backward[1] - forward[0],
            forward[2] - forward[0],
            backward[2] - forward[0],
            _log(orders.half_forward, floor) - rms,
            _log(orders.half_backward, floor) - rms,
            _log(np.hypot(orders.not_1x[0], orders.not_1x[1]), floor) - rms,
            orders.peak_to_peak[0] / window.clearance_m,
            orders.peak_to_peak[1] / window.clearance_m,
            *forward[3:],
            *backward[3:],
        ]
    )


def _acceleration(window: Window, orders: Orders, channel: int) -> NDArray[np.float64]:
    floor = FLOOR_ACCELERATION_M_S2
    lines = _log(np.abs(orders.harmonics[channel]), floor)
    rms = _log(orders.rms[channel], floor)
    shaft = _log(orders.speed_rad_s**2 * orders.forward[0], floor)
    # A clipped wave locks its second harmonic to the first: the phase of H2 relative to twice that
    # of H1.
    relative = orders.harmonics[channel, 1] * np.conj(orders.harmonics[channel, 0]) ** 2
    kurtosis, crest = _peakiness(window.samples[:, channel])
    return np.array(
        [
            rms,
            lines[0] - rms,
            *(lines[1:ORDERS] - lines[0]),
            _log(orders.half[channel], floor) - rms,
            _log(orders.not_1x[channel], floor) - rms,
            kurtosis,
            crest,
            lines[0] - shaft,
            *_direction(relative),
        ]
    )


def _peakiness(signal: NDArray[np.float64]) -> tuple[float, float]:
    """``log10`` of the kurtosis and of the crest factor."""
    deviation = signal - signal.mean()
    square = deviation * deviation
    variance = float(square.mean()) + FLOOR_ACCELERATION_M_S2**2
    kurtosis = float(np.mean(square * square)) / variance**2
    crest = float(square.max()) / variance
    return float(np.log10(kurtosis + 0.1)), 0.5 * float(np.log10(crest + 0.1))


def _acceleration_ratios(orders: Orders) -> NDArray[np.float64]:
    floor = FLOOR_ACCELERATION_M_S2
    first = _log(np.abs(orders.harmonics[2:5, 0]), floor)
    rms = _log(orders.rms[2:5], floor)
    return np.array([first[1] - first[0], first[2] - first[0], rms[1] - rms[0], rms[2] - rms[0]])


def _pair_phases(orders: Orders) -> NDArray[np.float64]:
    first = orders.harmonics[:, 0]
    return np.concatenate([_direction(first[a] * np.conj(first[b])) for _, a, _, b in _PAIRS])


def _direction(value: complex) -> NDArray[np.float64]:
    """Sine and cosine of the phase of ``value``; zero for a zero."""
    size = abs(value)
    return np.array([value.imag, value.real]) / size if size > 0.0 else np.zeros(2)


def _microphone(orders: Orders) -> NDArray[np.float64]:
    lines = _log(np.abs(orders.harmonics[5, :2]), FLOOR_SOUND_PA)
    rms = _log(orders.rms[5], FLOOR_SOUND_PA)
    return np.array([rms, lines[0] - rms, lines[1] - rms])


def _bands(window: Window) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """``log10`` rms per fixed band, shape (4, 6), and of the whole, shape (4,), of ``_BANDED``."""
    signal = np.ascontiguousarray(window.samples[:, 2:6].T)
    n = signal.shape[1]
    weight = np.hanning(n)
    deviation = (signal - signal.mean(axis=1, keepdims=True)) * weight
    lines = np.fft.rfft(deviation)
    power = (lines.real**2 + lines.imag**2) * (2.0 / (n * float(np.sum(weight**2))))
    edges = np.minimum(
        np.round(np.array(BAND_EDGES_HZ) * n / window.rate_hz).astype(np.intp), power.shape[1]
    )
    running = np.concatenate([np.zeros((4, 1)), np.cumsum(power, axis=1)], axis=1)
    floors = np.array([FLOOR_ACCELERATION_M_S2] * 3 + [FLOOR_SOUND_PA])[:, None] ** 2
    bands = np.diff(running[:, edges], axis=1)
    return 0.5 * np.log10(bands + floors), 0.5 * np.log10(running[:, -1] + floors[:, 0])


def _slow_channels(window: Window) -> NDArray[np.float64]:
    pressure, contact = window.samples[:, 6], window.samples[:, 7]
    return np.array(
        [
            _log(pressure.std(), FLOOR_VOLT),
            contact.mean(),
            _log(contact.std(), FLOOR_VOLT),
            np.partition(contact, len(contact) // 100)[len(contact) // 100],
        ]
    )


def _contact_film(window: Window, orders: Orders, machine: Machine) -> NDArray[np.float64]:
    """Film by the contact channel, free of the probes' runout: its orders over its mean, its mean,
    eccentricity.

    The film follows from the voltage by the law of the contact channel at middling roughness.
    """
    contact = circuit_of(machine)
    volt = read_volt(contact, np.asarray(orders.mean[CONTACT]))
    film_m = float(film_of(contact, volt))
    swing = np.array([*np.abs(orders.harmonics[CONTACT, :2]), orders.half[CONTACT]])
    swing *= film_per_volt(contact, float(volt)) / film_m
    position_m = window.clearance_m - float(np.hypot(orders.mean[0], orders.mean[1]))
    eccentricity = min(max(1.0 - film_m / window.clearance_m, LEAST_SHARE), 1.0 - LEAST_SHARE)
    log_film = math.log10(film_m / FILM_UNIT_M)
    return np.array(
        [
            *_log(swing, FLOOR_FILM),
            log_film,
            log_film - _log(max(position_m, 0.0) / 1e-4, FLOOR_POSITION),
            eccentricity,
        ]
    )
