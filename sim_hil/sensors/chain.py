"""From filtered signals to counts: calibration error, noise, sensor faults, range, quantisation."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.wire.layout import SCHEMA_1
from sim_hil.build import Build
from sim_hil.faults.sensor import Samples, sensor_fault
from sim_hil.rigs import read_json
from sim_hil.rotor.parameters import Floats

SCALES: Final = np.array([channel.wire_scale for channel in SCHEMA_1.channels])
"""SI units per count of the eight channels, as on the wire."""

_SI_PER_UNIT: Final = {"um": 1e-6, "m/s2": 1.0, "Pa": 1.0, "bar": 1.0, "V": 1.0}
_MICROPHONE: Final = 5

Counts = NDArray[np.int16]


class SensorChain:
    """The eight channels of one build."""

    def __init__(self, build: Build) -> None:
        channels = read_json("sensors.json")["channels"]
        si = np.array([_SI_PER_UNIT[c["unit"]] for c in channels])
        self._low = np.array([c["range"][0] for c in channels]) * si
        self._high = np.array([c["range"][1] for c in channels]) * si
        self._noise = np.array([c.get("noise_rms", 0.0) for c in channels]) * si
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
        np.divide(y, SCALES, out=y)
        counts: Counts = np.rint(y, out=y).astype(np.int16)
        return counts


def units(counts: Counts) -> Floats:
    """Counts as SI values, shape as given."""
    si: Floats = counts * SCALES
    return si
