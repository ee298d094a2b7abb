"""Faults of the sensors: what is measured changes, the machine does not.

Named ``sensor_<kind>:<channel>``; severity 0 is healthy, 1 the strongest.  They act on the signal
in SI before quantisation, in shares of the channel's full range where they need a size.
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
DENT_RAD = math.radians(10)


@dataclass(frozen=True)
class Samples:
    """Where and when a faulty channel was sampled, each shape (n,).

    ``since_s``: time since the fault began; ``angle_rad``: of the shaft; ``uniform``: random
    numbers on [0, 1); ``full``: the channel's full range.
    """

    since_s: Floats
    angle_rad: Floats
    uniform: Floats
    full: float


@dataclass(frozen=True)
class SensorFault:
    """How one kind changes a signal, the severities it takes, and the channels it can happen to."""

    apply: Callable[[Floats, float, Samples], Floats]
    channels: tuple[str, ...] = CHANNELS
    severity_range: tuple[float, float] = (0.0, 1.0)


def gain(signal: Floats, severity: float, at: Samples) -> Floats:
    """Sensitivity lost: ``y (1 - 0.5 severity)``."""
    return signal * (1 - 0.5 * severity)


def offset(signal: Floats, severity: float, at: Samples) -> Floats:
    """Zero shifted by ``0.2 severity`` of the full range."""
    return signal + 0.2 * severity * at.full


def drift(signal: Floats, severity: float, at: Samples) -> Floats:
    """Zero moving by ``0.2 severity`` of the full range a minute."""
    return signal + 0.2 * severity * at.full * at.since_s / DRIFT_S


def stuck(signal: Floats, severity: float, at: Samples) -> Floats:
    """The output no longer moves (a constant ``0.1 severity`` of the full range)."""
    return np.full_like(signal, 0.1 * severity * at.full) if severity > 0 else signal


def dropout(signal: Floats, severity: float, at: Samples) -> Floats:
    """A share ``0.2 severity`` of the samples, at random, reads zero (loose connector)."""
    return np.where(at.uniform < 0.2 * severity, 0.0, signal)


def clipping(signal: Floats, severity: float, at: Samples) -> Floats:
    """The amplifier saturates at ``0.5 (1 - 0.99 severity)`` of the full range, either side of
    zero."""
    limit = 0.5 * (1 - 0.99 * severity) * at.full if severity > 0 else math.inf
    return np.clip(signal, -limit, limit)


def hum(signal: Floats, severity: float, at: Samples) -> Floats:
    """50 Hz pick-up of amplitude ``0.05 severity`` of the full range (ground loop)."""
    return signal + 0.05 * severity * at.full * np.sin(2 * math.pi * HUM_HZ * at.since_s)


def runout(signal: Floats, severity: float, at: Samples) -> Floats:
    """A dent under the probe: once a turn ``0.1 severity`` of the full range deep, 10 degrees wide
    (1/e).

    Proximity probes only.  It stands at every speed, also in a slow roll, with many orders of the
    speed.
    """
    turned = np.remainder(at.angle_rad + math.pi, 2 * math.pi) - math.pi
    return signal + 0.1 * severity * at.full * np.exp(-((turned / DENT_RAD) ** 2))


SENSOR_FAULTS: Final[dict[str, SensorFault]] = {
    **{
        kind.__name__: SensorFault(kind)
        for kind in (gain, offset, drift, stuck, dropout, clipping, hum)
    },
    "runout": SensorFault(runout, ("disp_x", "disp_y")),
}


def sensor_fault(name: str) -> tuple[SensorFault, int] | None:
    """The fault and its channel index of ``sensor_<kind>:<channel>``; None when it is no such
    name."""
    head, _, channel = name.partition(":")
    kind = head.removeprefix("sensor_")
    if head == kind or kind not in SENSOR_FAULTS or channel not in SENSOR_FAULTS[kind].channels:
        return None
    return SENSOR_FAULTS[kind], CHANNELS.index(channel)
