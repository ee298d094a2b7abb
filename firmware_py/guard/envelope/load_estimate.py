"""Load of the film from where the shaft floats, as an interval that honours the sensors' errors.

The mean shaft position has two coordinates, and the film at rest
(:mod:`firmware_py.machine.film`) has one curve of places for all loads: a place is credible
where both probes may show what they show.  The least and most eccentric credible place, with speed,
clearance and viscosity, are the interval of the load.  Where no place of the curve is credible, the
zero reference (or the bearing) is not what it was, and the declared range is all that is known.

It is the static load and what a groove adds (:mod:`~firmware_py.machine.groove`), at any pressure
that may be set.
"""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt
from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.guard.envelope.oil_estimate import (
    OilEstimator,
    OilInterval,
    OilState,
    SteadyInstant,
)
from firmware_py.guard.measurement.motion import DISPLACEMENTS, WINDOW_S
from firmware_py.machine.film import ECCENTRICITY_MAX, KNOTS, static_film
from firmware_py.machine.groove import Groove
from firmware_py.machine.lubricant import CredibleOil, coldest_outlet_C
from firmware_py.machine.probes import probe_errors

ORBIT_SHARE_MAX: Final = 0.6
"""Above this share of the clearance (peak to peak) the mean of the orbit is no static
equilibrium."""


class Look(msgspec.Struct, frozen=True):
    """What is measured at one instant: mean shaft position over the window before it, and readings.

    ``power_W`` None: the shaft power is not OK, and nothing is learnt from it.
    """

    time_s: float
    x_m: float
    y_m: float
    peak_to_peak_m: float
    clearance_m: float
    speed_rad_s: float
    temperature_C: float
    power_W: float | None
    pressure_bar: float = 0.0


class LoadInterval(msgspec.Struct, frozen=True):
    """Smallest and largest credible load of the film; ``measured`` False means the declared range.

    ``film_N`` is the largest load as the thinnest credible oil would have to carry it: position
    shows load over viscosity, so that the thickest oil, which ``high_N`` stands for, does not count
    for the film.
    """

    low_N: float
    high_N: float
    film_N: float
    measured: bool


class LoadState(msgspec.Struct):
    """What the estimator remembers (for snapshots)."""

    oil: OilState
    recent: list[Look] = []


class LoadEstimator:
    """Interval of the film's load.

    Parameters
    ----------
    config
        Bearing, oil, probes, feed and the declared range of static load (downward, along -y).
    """

    def __init__(self, config: Config) -> None:
        bearing = config.machine.bearing
        self._film = static_film(bearing.journal_radius_m, bearing.length_m)
        self._low_share, self._high_share = (
            1.0 - bearing.load_error_share,
            1.0 + bearing.load_error_share,
        )
        self._offset_m = bearing.radial_clearance_offset_um * 1e-6
        self._error_m = bearing.radial_clearance_error_um * 1e-6
        self._turned = bearing.attitude_error_deg * pi / 180.0
        errors = probe_errors(config.machine)
        self._zero_m, self._gain = errors.zero_m, errors.gain_share
        self._probes = [_direction(config.machine.channel[i].angle_deg) for i in DISPLACEMENTS]
        (c0, s0), (c1, s1) = self._probes
        self._spread = sqrt(2.0 / (1.0 - abs(c0 * c1 + s0 * s1)))
        self._places = [self._seen_by(*probe) for probe in self._probes]
        self._viscosity, self._oil = (
            CredibleOil(config.machine),
            OilEstimator(config, self._film),
        )
        self._inlet_min_C, self._hottest_C = (
            config.machine.lubricant.inlet_min_C,
            config.machine.lubricant.film_max_C,
        )
        self._coldest_C = coldest_outlet_C(config.machine)
        self._groove = Groove(config.machine)
        self._declared_N = self._groove.film_loads_N
        self.state = LoadState(self._oil.unknown())

    def declared(self) -> LoadInterval:
        """The declared range, when nothing better is known."""
        low_N, high_N = self._declared_N
        return LoadInterval(low_N, high_N, high_N, False)

    @property
    def oil(self) -> OilInterval:
        """What is known of the oil."""
        return self._oil.interval(self.state.oil)

    def oil_range(self, temperature_C: float) -> tuple[float, float]:
        """Thinnest and thickest credible film over the law at that reading of the outlet."""
        return self.oil.thinnest, self._oil.thickest(self.oil, temperature_C)

    def oil_at(self, outlet_C: float | None) -> tuple[float, tuple[float, float]]:
        """Temperature of the film's law, and thinnest and thickest credible film over it.

        An outlet that is not known, or colder than declared, stands for every film from the coldest
        to the hottest.
        """
        if outlet_C is not None and outlet_C >= self._coldest_C:
            return outlet_C, self.oil_range(outlet_C)
        coldest_C = self._inlet_min_C if outlet_C is None else outlet_C
        thicker = self._viscosity.law(coldest_C) / self._viscosity.law(self._hottest_C)
        return self._hottest_C, (self._viscosity.thinnest, self._viscosity.thickest * thicker)

    def estimate(self, look: Look) -> LoadInterval:
        """Interval at the middle of the window that ends with ``look``.

        The declared range when the position is not that of a static equilibrium under a downward
        load, or contradicts the declared range altogether.
        """
        newest = msgspec.structs.replace(look, clearance_m=look.clearance_m + self._offset_m)
        look = self._amid(newest)
        self._oil.forget(self.state.oil, look.time_s)
        if not look.speed_rad_s > 0.0 or look.peak_to_peak_m > ORBIT_SHARE_MAX * look.clearance_m:
            return self.declared()
        credible = self._credible(look)
        if credible is None:
            return self.declared()
        if newest.power_W is not None:
            self._oil.learn(
                self.state.oil,
                SteadyInstant(
                    newest.time_s,
                    newest.speed_rad_s,
                    newest.clearance_m,
                    newest.temperature_C,
                    newest.power_W,
                ),
                credible,
            )
        return self._interval(look, credible)

    def _amid(self, look: Look) -> Look:
        """``look`` with the clearance, speed and pressure of the middle of the window."""
        recent = self.state.recent
        recent.append(look)
        while len(recent) > 2 and recent[1].time_s <= look.time_s - 0.5 * WINDOW_S:
            del recent[0]
        before = recent[0]
        if not 0.0 < look.time_s - before.time_s <= 2.0 * WINDOW_S:
            self.state.recent = [look]
            return look
        back = min(1.0, 0.5 * WINDOW_S / (look.time_s - before.time_s))
        return msgspec.structs.replace(
            look,
            clearance_m=look.clearance_m + back * (before.clearance_m - look.clearance_m),
            speed_rad_s=look.speed_rad_s + back * (before.speed_rad_s - look.speed_rad_s),
            pressure_bar=look.pressure_bar + back * (before.pressure_bar - look.pressure_bar),
        )

    def _interval(self, look: Look, credible: tuple[int, int]) -> LoadInterval:
        """Load of the two places, by the oil and clearance that make it smallest and largest."""
        low, high = credible
        narrow_m, wide_m = look.clearance_m - self._error_m, look.clearance_m + self._error_m
        oil, law = self.oil, self._viscosity.law(look.temperature_C) * look.speed_rad_s
        least = self._film.load[low] / (wide_m * wide_m) * self._low_share * law
        most = (
            self._film.load[high] / (narrow_m * narrow_m) * self._high_share * law
            if high < KNOTS
            else float("inf")
        )
        less_N, more_N = self._groove.swing_N(look.pressure_bar)
        low_N, high_N = (
            max(self._declared_N[0], least * oil.thinnest_wide - less_N),
            self._declared_N[1],
        )
        thick = self._oil.thickest(oil, look.temperature_C)
        film_N, high_N = (
            min(high_N, most * oil.thinnest + more_N),
            min(high_N, most * thick + more_N),
        )
        return LoadInterval(low_N, high_N, film_N, True) if low_N <= high_N else self.declared()

    def _credible(self, look: Look) -> tuple[int, int] | None:
        """Knots around the least and the most eccentric credible place; None if there is none.

        A probe may show ``zero + gain p`` beside the true ``p``; a mean over part of a turn is off
        by what of the orbit is left over; the build's clearance and the film's attitude move the
        place itself.
        """
        turns = max(1.0, look.speed_rad_s * WINDOW_S / (2.0 * pi))
        fixed_m = self._zero_m + look.peak_to_peak_m / (2.0 * pi * turns)
        moved_m = self._turned * look.clearance_m + self._error_m
        (c0, s0), (c1, s1) = self._probes
        a0, a1 = look.x_m * c0 + look.y_m * s0, look.x_m * c1 + look.y_m * s1
        (p0, p1), c, gain, eccentricity = (
            self._places,
            look.clearance_m,
            self._gain,
            self._film.eccentricity,
        )

        def credible(k: int) -> bool:
            x0, x1, slack_m = c * p0[k], c * p1[k], fixed_m + moved_m * eccentricity[k]
            return abs(a0 - x0) <= slack_m + gain * abs(x0) and abs(
                a1 - x1
            ) <= slack_m + gain * abs(x1)

        first, last = self._within(
            sqrt(look.x_m * look.x_m + look.y_m * look.y_m), c, fixed_m, moved_m + gain * c
        )
        low = next((k for k in range(first, last + 1) if credible(k)), None)
        if low is None:
            return None
        high = next(k for k in range(last, low - 1, -1) if credible(k))
        return max(low - 1, 0), min(high + 1, KNOTS)

    def _within(
        self, distance_m: float, clearance_m: float, fixed_m: float, per_eccentricity_m: float
    ) -> tuple[int, int]:  # fmt: skip
        """Knots beyond which the distance alone makes a place incredible: both probes off by all
        that they may."""
        fixed_m, per_eccentricity_m = self._spread * fixed_m, self._spread * per_eccentricity_m
        least = (distance_m - fixed_m) / (clearance_m + per_eccentricity_m)
        near = clearance_m - per_eccentricity_m
        most = (distance_m + fixed_m) / near if near > 0.0 else ECCENTRICITY_MAX
        per_knot = ECCENTRICITY_MAX / KNOTS
        return max(0, int(least / per_knot)), min(KNOTS, int(min(most, 1.0) / per_knot) + 1)

    def _seen_by(self, cosine: float, sine: float) -> list[float]:
        """What a probe of that direction sees of the places of the curve, in clearances.

        The journal lies at ``eps (sin(phi), -cos(phi))`` under a downward load, turning
        counter-clockwise.
        """
        film = self._film
        return [
            e * (s * cosine - c * sine)
            for e, s, c in zip(film.eccentricity, film.sine, film.cosine, strict=True)
        ]


def _direction(angle_deg: float) -> tuple[float, float]:
    """Rounded to 12 digits, so that differences between math libraries cannot reach a decision."""
    return round(cos(radians(angle_deg)), 12), round(sin(radians(angle_deg)), 12)
