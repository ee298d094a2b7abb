"""Faults of the sensors: what is measured changes, the machine does not.

Named ``sensor_<kind>:<channel>``; severity 0 is healthy, 1 the strongest.  They act on the signal in SI
before quantisation, in shares of the channel's full range where they need a size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_py.records import CHANNELS
from sim_hil.rotor.parameters import Floats

HUM_HZ = 50.0
DRIFT_S = 60.0


@dataclass(frozen=True)
class SensorFault:
    """``apply(signal, since_s, full_range, severity, uniform)`` of one kind, and its severities."""

    apply: Callable[[Floats, Floats, float, float, Floats], Floats]
    severity_range: tuple[float, float] = (0.0, 1.0)


def gain(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """Sensitivity lost: ``y (1 - 0.5 severity)``."""
    return signal * (1 - 0.5 * severity)


def offset(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """Zero shifted by ``0.2 severity`` of the full range."""
    return signal + 0.2 * severity * full


def drift(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """Zero moving by ``0.2 severity`` of the full range a minute."""
    return signal + 0.2 * severity * full * since_s / DRIFT_S


def stuck(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """The output no longer moves (a constant ``0.1 severity`` of the full range)."""
    return np.full_like(signal, 0.1 * severity * full) if severity > 0 else signal


def dropout(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """A share ``0.2 severity`` of the samples, at random, reads zero (loose connector)."""
    return np.where(uniform < 0.2 * severity, 0.0, signal)


def clipping(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """The amplifier saturates at ``0.5 (1 - severity)`` of the full range, either side of zero."""
    limit = 0.5 * (1 - 0.99 * severity) * full if severity > 0 else math.inf
    return np.clip(signal, -limit, limit)


def hum(signal: Floats, since_s: Floats, full: float, severity: float, uniform: Floats) -> Floats:
    """50 Hz pick-up of amplitude ``0.05 severity`` of the full range (ground loop)."""
    return signal + 0.05 * severity * full * np.sin(2 * math.pi * HUM_HZ * since_s)


SENSOR_FAULTS: Final[dict[str, SensorFault]] = {
    kind.__name__: SensorFault(kind) for kind in (gain, offset, drift, stuck, dropout, clipping, hum)
}


def sensor_fault(name: str) -> tuple[SensorFault, int] | None:
    """The fault and its channel index of ``sensor_<kind>:<channel>``; None when it is no such name."""
    head, _, channel = name.partition(":")
    kind = head.removeprefix("sensor_")
    if head == kind or kind not in SENSOR_FAULTS or channel not in CHANNELS:
        return None
    return SENSOR_FAULTS[kind], CHANNELS.index(channel)
