"""From filtered signals to counts: calibration error, noise, sensor faults, range, quantisation."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.wire.layout import SCHEMA_1
from sim_hil.faults.sensor import Samples, sensor_fault
from sim_hil.plant.build import Build
from sim_hil.rigs import RigData
from sim_hil.rotor.parameters import Floats

SCALES: Final = np.array([channel.wire_scale for channel in SCHEMA_1.channels])
"""SI units per count of the eight standard channels, as on the wire of schema 1."""

_MICROPHONE: Final = 5

Counts = NDArray[np.int16]


class SensorChain:
    """The eight channels of one build of ``rig``."""

    def __init__(self, rig: RigData, build: Build) -> None:
        self._low = np.array([c.low for c in rig.channels])
        self._high = np.array([c.high for c in rig.channels])
        self._noise = np.array([c.noise_rms for c in rig.channels])
        self._scale = scales_of(rig)
        self._noise[_MICROPHONE] = build.room_Pa
        self._build = build

    def counts(
        self, signals: Floats, normal: Floats, uniform: Floats, time_s: Floats, angle_rad: Floats,
        faults: dict[str, tuple[float, float]],
    ) -> Counts:  # fmt: skip
        """Wire counts.

        Parameters
        ----------
        signals
            Filtered signals, SI, shape (n, 8).
        normal, uniform
            Random numbers, shape (n, 8): standard normal and uniform on [0, 1).
        time_s, angle_rad
            Time of each instant, s, and the shaft's angle, rad, shape (n,).
        faults
            Severity and start time, s, of each sensor fault by name.
        """
        y = signals * self._build.gain + self._build.zero + normal * self._noise
        for name, (severity, start_s) in faults.items():
            found = sensor_fault(name)
            if found is not None:
                fault, i = found
                at = Samples(time_s - start_s, angle_rad, uniform[:, i], float(self._high[i]))
                y[:, i] = fault.apply(y[:, i], severity, at)
        np.maximum(y, self._low, out=y)
        np.minimum(y, self._high, out=y)
        np.divide(y, self._scale, out=y)
        counts: Counts = np.rint(y, out=y).astype(np.int16)
        return counts


def scales_of(rig: RigData) -> Floats:
    """SI per count of the eight channels of ``rig``, as its node sends them."""
    return np.array([c.wire_scale for c in rig.channels])


def units(counts: Counts, scales: Floats = SCALES) -> Floats:
    """Counts as SI values, shape as given."""
    si: Floats = counts * scales
    return si
