"""What one window of both probes says of the pair: size of each kind beside its limit.

The kinds are described in :mod:`firmware_py.guard.plausibility.pair`.
"""

from __future__ import annotations

from math import isnan, nan, pi, sqrt
from typing import Final, NamedTuple

from firmware_py.config import Config
from firmware_py.guard.envelope.load_estimate import ORBIT_SHARE_MAX
from firmware_py.guard.measurement.motion import DISPLACEMENTS
from firmware_py.guard.plausibility.pair_window import (
    NO_FACTS,
    UNKNOWN_C,
    Facts,
    PairState,
    PairStatistics,
)
from firmware_py.machine.film import KNOTS, static_film
from firmware_py.machine.groove import Groove
from firmware_py.machine.lubricant import CredibleOil
from firmware_py.machine.parts import CLEARANCE, has, has_film_law
from firmware_py.machine.probes import are_zeroed, probe_errors

STEADY_SPEED: Final = 0.03
STEADY_M: Final = 5e-6
"""Change of speed (share) and clearance in a window up to which the film is at rest; the latter is
allowed for."""

BEYOND_C: Final = 15.0
"""Outside the declared temperatures by more than this, the outlet says nothing of the film."""
LOAD_SHARE: Final = 0.05
"""Allowed for beyond the declared loads."""
FLAT_SHARE: Final = 0.5
"""Of the orbit's amplitude times runout: what runout makes of a flat orbit."""
COPIED: Final = 0.98
COPIED_LEAST_M: Final = 0.3e-6
"""Correlation of the signals, and of their noise (second differences), and the least rms of a
signal that is judged."""
ROUND: Final = 0.9
FORWARD: Final = 0.95
ROUND_LEAST_M: Final = 0.3e-6
"""Axis ratio, area over that of a forward ellipse, and least rms of an orbit that shows that both
probes are right."""
ANOTHER_ZERO_M: Final = 25e-6
"""The farthest that a zero that was never taken may put the mean beside the curve."""
REST_LEFT: Final = 0.05
"""Share of the clearance that the film may still hold under a shaft that stands."""
MOVED_M: Final = 6e-6
"""A mean that was off the curve from the start may move so far beside it."""


class Verdict(NamedTuple):
    """Size of one kind beside its limit."""

    value: float
    limit: float
    text: str

    @property
    def bad(self) -> bool:
        """Whether the limit is passed."""
        return self.value > self.limit


class PairVerdicts:
    """Judges a window against probes, bearing, oil and the declared loads.

    Parameters
    ----------
    config
        Bearing, oil, probes and the declared range of static load (downward, along -y).
    to_xy
        Rows of the matrix from both probes to x and y (:func:`probes_to_xy`).
    """

    def __init__(
        self, config: Config, to_xy: tuple[tuple[float, float], tuple[float, float]]
    ) -> None:
        b = config.machine.bearing
        probes = [config.machine.channel[i] for i in DISPLACEMENTS]
        (xa, xb), (ya, yb) = to_xy
        self._turned_over = xa * yb - xb * ya
        self._has_law = has_film_law(config.machine)
        self._drawn_m = (
            b.radial_clearance_nominal_um * 1e-6 if has(config.machine, CLEARANCE) else nan
        )
        zeroed = self._zeroed = are_zeroed(config.machine)
        errors = probe_errors(config.machine)
        self._zero_m, self._gain = errors.zero_m, errors.gain_share
        rolled_m = max(p.slow_roll_um for p in probes) * 1e-6
        self._runout_m = rolled_m + errors.runout_m if zeroed else errors.runout_m
        self._offset_m, self._error_m = (
            b.radial_clearance_offset_um * 1e-6,
            b.radial_clearance_error_um * 1e-6,
        )
        self._range_m = (
            b.radial_clearance_min_um * 1e-6 - STEADY_M,
            b.radial_clearance_max_um * 1e-6 + STEADY_M,
        )
        self._range_C = (
            config.machine.lubricant.inlet_min_C - BEYOND_C,
            config.machine.lubricant.film_max_C + BEYOND_C,
        )
        self._attitude = b.attitude_error_deg * pi / 180.0
        self._shares = (1.0 - b.load_error_share, 1.0 + b.load_error_share)
        low_N, high_N = Groove(config.machine).film_loads_N
        self._loads_N = (low_N * (1.0 - LOAD_SHARE), high_N * (1.0 + LOAD_SHARE))
        self._film, self._oil = (
            static_film(b.journal_radius_m, b.length_m),
            CredibleOil(config.machine),
        )
        self._coldest_C = (
            200.0
            if config.machine.lubricant.film_at_outlet
            else config.machine.lubricant.inlet_min_C
        )
        # the inverse of the matrix from probes to xy: what each probe sees of the curve
        det = self._turned_over
        self._curve = [
            (e * s, -e * c)
            for e, s, c in zip(
                self._film.eccentricity, self._film.sine, self._film.cosine, strict=True
            )
        ]
        self._seen = [((yb * x - xb * y) / det, (xa * y - ya * x) / det) for x, y in self._curve]

    def facts(self, clearance_m: float, temperature_C: float, ok: bool = True) -> Facts:
        """Slow readings as far as they are ``ok`` and within the bearing's range."""
        (low_m, high_m), (cold_C, hot_C) = self._range_m, self._range_C
        within = low_m <= clearance_m <= high_m and cold_C <= temperature_C <= hot_C
        return Facts(clearance_m, temperature_C, ok and within)

    def drawn(self, temperature_C: float | None) -> Facts:
        """Of a bearing whose clearance is fixed and not measured: that of its drawing."""
        if isnan(self._drawn_m):
            return NO_FACTS
        return Facts(self._drawn_m, UNKNOWN_C if temperature_C is None else temperature_C)

    def backward(self, w: PairStatistics) -> Verdict:
        """How far the orbit runs against the rotation, beside what runout can feign."""
        limit = (
            self._runout_m
            * (self._runout_m + FLAT_SHARE * sqrt(2.0) * w.major_m)
            * abs(self._turned_over)
        )
        return Verdict(
            -w.area_m2 * 1e12, limit * 1e12, "the orbit runs against the rotation, um2 over pi"
        )

    def at_rest(self, s: PairState, w: PairStatistics, facts: Facts) -> Verdict:
        """How far a shaft that stands is off the wall on which it lies.

        Which part of the wall does not matter: friction and the direction of the load do not.
        """
        clearance_m = facts.clearance_m + self._offset_m
        begun_m = s.start.clearance_m if s.start else facts.clearance_m
        zero_m = sqrt(2.0) * self._zero_m if self._zeroed else ANOTHER_ZERO_M
        limit = zero_m + self._runout_m + self._error_m + self._gain * clearance_m
        limit += abs(facts.clearance_m - begun_m) + REST_LEFT * clearance_m
        off = abs(sqrt(w.x_m * w.x_m + w.y_m * w.y_m) - clearance_m)
        return Verdict(off * 1e6, limit * 1e6, "the shaft stands, but off the bearing's wall, um")

    def outside(self, s: PairState, w: PairStatistics, facts: Facts) -> Verdict:
        """How far the mean position lies from the middle, beside the widest clearance."""
        clearance_m = max(facts.clearance_m, s.start.clearance_m if s.start else 0.0)
        limit = (clearance_m + self._offset_m + self._error_m) * (1.0 + self._gain) + sqrt(
            2.0
        ) * self._zero_m
        return Verdict(
            sqrt(w.x_m * w.x_m + w.y_m * w.y_m) * 1e6,
            limit * 1e6,
            "the mean position lies outside the clearance, um",
        )

    def position(
        self, s: PairState, w: PairStatistics, facts: Facts, speed_rad_s: float
    ) -> Verdict | None:
        """How far a probe is off the nearest place that is admissible, over what is allowed for;
        None: not at rest."""
        begun = s.start or facts
        moved_m = abs(facts.clearance_m - begun.clearance_m)
        clearance_m = 0.5 * (facts.clearance_m + begun.clearance_m) + self._offset_m
        unsteady = (
            abs(speed_rad_s - s.start_rad_s) > STEADY_SPEED * s.start_rad_s or moved_m > STEADY_M
        )
        lawless = not self._has_law or facts.temperature_C == UNKNOWN_C
        if lawless or unsteady or clearance_m <= 0.0 or s.p2p_m > ORBIT_SHARE_MAX * clearance_m:
            return None
        first, last = self._admissible(clearance_m, speed_rad_s, facts.temperature_C)
        fixed_m = self._zero_m + moved_m + s.p2p_m / (2.0 * pi * max(1.0, s.turns))
        shifted_m = self._attitude * clearance_m + self._error_m
        least = float("inf")
        for k in range(first, last + 1):
            pa, pb = self._seen[k]
            slack_m = fixed_m + shifted_m * self._film.eccentricity[k]
            off = max(
                abs(w.a_m - clearance_m * pa) / (slack_m + self._gain * clearance_m * abs(pa)),
                abs(w.b_m - clearance_m * pb) / (slack_m + self._gain * clearance_m * abs(pb)),
            )
            least = min(least, off)
        if self._another_zero(s, w, clearance_m, least > 1.0):
            least = 1.0
        return Verdict(
            least,
            1.0,
            (
                "the mean position is none of the film at any declared load; its error over that "
                "allowed"
            ),
        )

    def _admissible(
        self, clearance_m: float, speed_rad_s: float, temperature_C: float
    ) -> tuple[int, int]:
        """Knots of the film that carry a declared load in any credible oil and clearance."""
        warm = self._oil.law(temperature_C) * speed_rad_s
        cold = self._oil.law(min(temperature_C, self._coldest_C)) * speed_rad_s
        narrow_m = max(clearance_m - self._error_m, 1e-9)
        wide_m = clearance_m + self._error_m
        most = self._shares[1] * cold * self._oil.thickest / (narrow_m * narrow_m)
        least = self._shares[0] * warm * self._oil.thinnest / (wide_m * wide_m)
        load = self._film.load
        first = next((k for k in range(KNOTS + 1) if load[k] * most >= self._loads_N[0]), KNOTS)
        last = next((k for k in range(KNOTS, -1, -1) if load[k] * least <= self._loads_N[1]), 0)
        return max(first - 1, 0), min(max(last, first) + 1, KNOTS)

    def _another_zero(self, s: PairState, w: PairStatistics, clearance_m: float, off: bool) -> bool:
        """Whether a mean off the curve is that of the first window, and the orbit shows that both
        probes are right.

        With both signs reversed an orbit is as forward, but the mean lies above the middle.
        """
        beside = min(
            ((w.x_m - clearance_m * x, w.y_m - clearance_m * y) for x, y in self._curve),
            key=lambda d: d[0] * d[0] + d[1] * d[1],
        )
        round_ = w.minor_m >= ROUND * w.major_m and w.minor_m >= ROUND_LEAST_M
        forward = w.area_m2 >= FORWARD * 2.0 * w.major_m * w.minor_m and w.y_m <= 0.0
        if s.off_m is None:
            near = beside[0] * beside[0] + beside[1] * beside[1] <= ANOTHER_ZERO_M * ANOTHER_ZERO_M
            s.off_m = (
                beside if off and round_ and forward and near and not self._zeroed else (0.0, 0.0)
            )
        dx, dy = beside[0] - s.off_m[0], beside[1] - s.off_m[1]
        known = s.off_m != (0.0, 0.0) and dx * dx + dy * dy <= MOVED_M * MOVED_M
        return off and known and round_ and forward


def copied(w: PairStatistics) -> Verdict:
    """Both correlations, as far as there is a signal."""
    value = (
        min(abs(w.correlation), abs(w.noise_correlation))
        if w.least_rms_m >= COPIED_LEAST_M
        else 0.0
    )
    return Verdict(value, COPIED, "both channels carry one signal: correlation with its noise")
