"""Static bearing load from where the shaft floats, as an interval that honours the sensors' errors.

The mean shaft position gives the eccentricity; the short-bearing closed form with side leakage
(:mod:`firmware_py.guard.bearing_laws`) turns it into load, given speed, clearance and viscosity.  Position also
shows the *direction* of the load: where it disagrees with the attitude that belongs to the eccentricity,
the zero reference (or the bearing) is not what it was, and the declared range is all that is known.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.guard.bearing_laws import CLEARANCE_ERROR_M, TEMPERATURE_ERROR_C, load_per_viscous_speed
from firmware_py.guard.motion import DISPLACEMENTS
from firmware_py.guard.viscosity import ViscosityTable

ZERO_ERROR_M: Final = 2.9e-6
"""Two probes of 2 um zero error each, along the eccentricity."""

GAIN_ERROR: Final = 0.03
ZEROED_ERROR_M: Final = 0.71e-6
ZEROED_GAIN_ERROR: Final = 0.01
"""Both after the zero and slow-roll procedure (0.5 um each probe), where the configuration says that it was done."""

MODEL_ERROR: Final = 0.25
"""Rupture and inlet conditions move the load at one eccentricity by up to 21 %, the batch of oil by 10 %."""

ATTITUDE_ERROR: Final = 0.26
"""Rupture, inlet and groove move the attitude angle by up to 15 degrees (sine of it)."""

ECCENTRICITY_MAX: Final = 0.97
ORBIT_SHARE_MAX: Final = 0.6
"""Above this share of the clearance (peak to peak) the mean of the orbit is no static equilibrium."""


class LoadInterval(msgspec.Struct, frozen=True):
    """Smallest and largest credible static load; ``measured`` False means the declared range."""

    low_N: float
    high_N: float
    measured: bool


class LoadEstimator:
    """Interval of the static load.

    Parameters
    ----------
    config
        Bearing, oil and the declared range of load (downward, along -y).
    """

    def __init__(self, config: Config) -> None:
        self._radius_m, self._length_m = config.bearing.journal_radius_m, config.bearing.length_m
        self._inlet_min_C = config.oil.inlet_min_C
        zeroed = all(config.channel[i].zeroed for i in DISPLACEMENTS)
        self._zero_m = ZEROED_ERROR_M if zeroed else ZERO_ERROR_M
        self._gain = ZEROED_GAIN_ERROR if zeroed else GAIN_ERROR
        self._viscosity = ViscosityTable(config.oil)
        self._declared = LoadInterval(config.operating.load_min_N, config.operating.load_max_N, False)

    def declared(self) -> LoadInterval:
        """The declared range, when nothing better is known."""
        return self._declared

    def estimate(
        self, x_m: float, y_m: float, clearance_m: float, speed_rad_s: float, temperature_C: float,
        peak_to_peak_m: float,
    ) -> LoadInterval:
        """Interval from the mean shaft position ``(x, y)``, reported radial clearance and oil outlet.

        Falls back to the declared range when the position is not that of a static equilibrium under a
        downward load, or contradicts the declared range altogether.
        """
        e_m = sqrt(x_m * x_m + y_m * y_m)
        error_m = self._zero_m + self._gain * e_m
        if not speed_rad_s > 0.0 or peak_to_peak_m > ORBIT_SHARE_MAX * clearance_m:
            return self._declared
        if not self._direction_agrees(x_m, y_m, e_m, error_m, clearance_m):
            return self._declared
        low = self._load(max(0.0, e_m - error_m), clearance_m + CLEARANCE_ERROR_M)
        high = self._load(e_m + error_m, clearance_m - CLEARANCE_ERROR_M)
        thin = self._viscosity.thinnest(temperature_C + TEMPERATURE_ERROR_C)
        thick = self._viscosity.thickest(min(temperature_C - TEMPERATURE_ERROR_C, self._inlet_min_C))
        low_N = max(self._declared.low_N, low * thin * speed_rad_s * (1.0 - MODEL_ERROR))
        high_N = min(self._declared.high_N, high * thick * speed_rad_s * (1.0 + MODEL_ERROR))
        return LoadInterval(low_N, high_N, True) if low_N <= high_N else self._declared

    def _load(self, eccentricity_m: float, clearance_m: float) -> float:
        """Load per viscosity and speed; unbounded where the closed form ends."""
        eccentricity = eccentricity_m / clearance_m
        if eccentricity >= ECCENTRICITY_MAX:
            return float("inf")
        return load_per_viscous_speed(eccentricity, clearance_m, self._radius_m, self._length_m)

    @staticmethod
    def _direction_agrees(x_m: float, y_m: float, e_m: float, error_m: float, clearance_m: float) -> bool:
        """Whether the shaft lies where a downward load and counter-clockwise rotation put it.

        Attitude of the short bearing: ``tan(phi) = pi sqrt(1 - eps^2) / (4 eps)`` from -y toward +x.
        """
        eccentricity = min(e_m / clearance_m, ECCENTRICITY_MAX)
        across, along = pi * sqrt(1.0 - eccentricity * eccentricity), 4.0 * eccentricity
        length = sqrt(across * across + along * along)
        off_x, off_y = x_m - e_m * across / length, y_m + e_m * along / length
        allowed_m = error_m + ATTITUDE_ERROR * e_m
        return off_x * off_x + off_y * off_y <= allowed_m * allowed_m
