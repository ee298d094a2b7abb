"""The shield: which radial clearances are admissible, by the film at rest
(:mod:`~firmware_py.machine.film`).

Three laws bound the clearance ``c``:

* **film** (upper and lower): at the largest credible load and the thinnest credible oil the minimum
  film must be at least ``h``.
* **whirl** (upper): a rigid rotor of effective mass ``m`` on the film is stable while
  ``w sqrt(c m / W) < Omega(eps)``, less with unbalance; the smallest credible load decides, for ``W
  Omega(eps)^2`` rises with ``W``, and the thinnest or the thickest oil.
* **vibration** (lower and upper): the measured peak-to-peak ``s`` may fill a share of ``c``.  It
  grows at least as the square of the clearance where it is large, so ``c (k c / s)`` with ``k``
  below that share is the widest that keeps it: growing unbalance and beginning whirl both find the
  bearing narrowing before the limit.  Where it does not follow, narrowing ends short of the limit.

The minimum film is not monotone in clearance, so film admits the connected run of clearances around
the retreat clearance.  **Reachability**: a clearance is admissible only if the actuator can still
run back to the retreat clearance ahead of the film, and before whirl has grown, while speed and
load go the worst way that the declared range lets them: the fastest *unannounced* ramps from where
the machine is, and each ramp that was announced.  An announcement narrows what is admissible before
its ramp, and never widens it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from math import pi
from typing import Final

from firmware_py.config import Config
from firmware_py.guard.envelope.retreat import (
    Box,
    Outrun,
    Ramp,
    along,
    before_whirl_has_grown,
    hull,
)
from firmware_py.machine.film import static_film
from firmware_py.machine.groove import Groove
from firmware_py.machine.lubricant import CredibleOil

GRID_M: Final = 1e-6
WHIRL_GRADE: Final = 0.45
WHIRL_MEASURED: Final = 0.8
"""Share of the unbalance that whirl is judged with, where it is known by its grade alone, and where
it was measured.

With four fifths of it the rotor of the rig, whose coupling damps it, begins to whirl 1 % beyond the
bound at the earliest, with all of it 3 %, with none of it up to 15 % within
(``tests/guard/envelope/test_whirl_on_rig.py``).  Of a grade the rest lies within the margins for
mass, coupling, clearance and load: with a third of it 2 of 120 machines whirl after the hardest
ramps that may come unannounced, with two fifths none."""

VIBRATION_MARGIN: Final = 0.77
"""Part of the share that vibration may fill in a clearance wider than the retreat clearance."""

FITTING_MARGIN: Final = 0.95
"""Part of the share that vibration may fill where narrowing does not make it smaller: that of an
unbalance well above the critical speed, which the mass holds, is as large in any clearance, and a
wider one is the better."""

PERIOD_S: Final = 0.02
"""An interval is this old at most before the next one replaces it; one that a command rests on is
new."""

STEP_S: Final = 0.05
FINE_S: Final = 0.6
"""Steps of the reachability test, twice as long after the first ``FINE_S``.

The bounds bend so little along an unannounced ramp that the ends of the steps are enough (0.03 um
in 0.1 s), with one more where it ends; an announced one may be as steep as it likes, and a step
beside it takes the worst of its end."""


class Shield:
    """Admissible interval of the radial clearance.

    Parameters
    ----------
    config
        Bearing, oil, rotor, declared operating range, actuator and limits.
    """

    def __init__(self, config: Config) -> None:
        b, a, o = config.machine.bearing, config.machine.actuator, config.machine.operating
        self._film = static_film(b.journal_radius_m, b.length_m)
        self._min_film_m = config.limits.min_film_um * 1e-6
        self._share = config.limits.clearance_share
        self._mass_kg = config.machine.rotor.mass_at_bearing_kg * (
            1.0 + config.machine.rotor.mass_error_share
        )
        self._whirl_speed = 1.0 - config.machine.rotor.whirl_error_share
        self._film_share = 1.0 - b.load_error_share
        self._unbalance_kg_m = config.machine.rotor.unbalance_normal_kg_m
        self._shaking_kg_m = self._unbalance_kg_m * (
            WHIRL_MEASURED if config.machine.rotor.unbalance_measured else WHIRL_GRADE
        )
        self._offset_m, self._error_m = (
            b.radial_clearance_offset_um * 1e-6,
            b.radial_clearance_error_um * 1e-6,
        )
        self._oil = config.machine.lubricant
        self._viscosity = CredibleOil(config.machine)
        self._safe_m = a.safe_radial_clearance_um * 1e-6
        self._rate_m_s = a.rate_um_s * 1e-6
        self._delay_s = a.time_to_live_ms * 1e-3 + a.time_constant_s
        self._speeds = (o.speed_min_rpm * pi / 30, o.speed_max_rpm * pi / 30)
        groove = Groove(config.machine)
        self._loads, self._added_N = groove.film_loads_N, groove.added_N
        self._speed_ramp = o.speed_ramp_unannounced_rpm_s * pi / 30
        self._load_ramp = o.load_ramp_unannounced_N_s
        self._min_m, self._max_m = (
            b.radial_clearance_min_um * 1e-6,
            b.radial_clearance_max_um * 1e-6,
        )
        self._even = self._even_ends()
        self._above = self._capacities(self._max_m)
        self._below = self._capacities(self._min_m)

    def _even_ends(self) -> list[float]:
        """Ends of the even steps of the run to the retreat clearance, s; the first is where it
        begins."""
        way_s, ends = self.lead_s - self._delay_s, [0.0]
        while ends[-1] < way_s:
            ends.append(ends[-1] + (STEP_S if ends[-1] < FINE_S else 2.0 * STEP_S))
        return ends

    def _ends(self, present: Box) -> list[float]:
        """Ends of all steps: the even ones, and where an unannounced ramp reaches the end of its
        declared range."""
        (slowest, fastest), (lightest_N, heaviest_N) = self._speeds, self._loads
        speed, load, last_s = self._speed_ramp, self._load_ramp, self._even[-1]
        arrivals = (
            (present.slow_rad_s - slowest) / speed,
            (fastest - present.fast_rad_s) / speed,
            (present.light_N - lightest_N) / load,
            (heaviest_N - present.heavy_N) / load,
        )
        return sorted(
            self._even + [t - self._delay_s for t in arrivals if 0.0 < t - self._delay_s < last_s]
        )

    @property
    def lead_s(self) -> float:
        """An announced ramp must start this much later: time to run to the retreat clearance from
        anywhere."""
        return (
            max(self._max_m - self._safe_m, self._safe_m - self._min_m) / self._rate_m_s
            + self._delay_s
        )

    def interval(
        self,
        speed_rad_s: float,
        load_low_N: float,
        load_high_N: float,
        temperature_C: float,
        peak_to_peak_m: float = 0.0,
        clearance_m: float = 0.0,
        announced: Sequence[Ramp] = (),
        oil: tuple[float, float] | None = None,
        slow_rad_s: float | None = None,
    ) -> tuple[float, float] | None:
        """Admissible radial clearances now, able to retreat in time; None when not even safe is
        one.

        Parameters
        ----------
        speed_rad_s
            Shaft speed, positive; the highest that it may have.
        load_low_N, load_high_N
            Smallest credible load of the film, and the largest as the thinnest credible oil would
            have to carry it.
        temperature_C
            Oil outlet temperature.
        peak_to_peak_m, clearance_m
            Measured vibration, larger axis, and the clearance in which it was measured; no
            vibration is no bound. The retreat clearance stays whatever it is: protection watches
            it.
        announced
            Ramps to come or under way, in the order of their starts.
        oil
            Thinnest and thickest credible oil over the law's at the outlet's reading; any batch
            when None.
        slow_rad_s
            The lowest that the shaft speed may have, where that is another one.
        """
        slow_rad_s = speed_rad_s if slow_rad_s is None else slow_rad_s
        if not 0.0 < slow_rad_s <= speed_rad_s:
            return None
        present = Box(slow_rad_s, speed_rad_s, load_low_N, load_high_N)
        oil = oil or (self._viscosity.thinnest, self._viscosity.thickest)
        oils = self._whirling(temperature_C, oil)
        now = self._bounds(present, temperature_C, slow_rad_s, oil[0], oils)
        low_m = max(now[0], self._min_m, min(peak_to_peak_m / self._share, self._safe_m))
        high_m = min(now[1], now[2], self._max_m)
        if peak_to_peak_m > 0.0 and clearance_m > 0.0:
            kept_m = VIBRATION_MARGIN * self._share * clearance_m * clearance_m / peak_to_peak_m
            if (
                peak_to_peak_m <= self._share * clearance_m
            ):  # narrower only once the vibration has followed
                kept_m = max(kept_m, peak_to_peak_m / (FITTING_MARGIN * self._share))
            high_m = min(high_m, max(kept_m, self._safe_m))
        if not low_m <= self._safe_m <= high_m:
            return None
        outrun: list[Outrun] = []
        start_s = 0.0
        for end_s in self._ends(present):
            run_m = self._rate_m_s * (start_s if announced else end_s)
            if low_m >= self._safe_m - run_m and high_m <= self._safe_m + run_m:
                break  # back at the retreat clearance by then, from all that is left
            box = self._box_after(self._delay_s + end_s, present, announced)
            low_t, high_t, whirl_m = self._bounds(box, temperature_C, slow_rad_s, oil[0], oils)
            low_m = max(low_m, min(low_t, self._safe_m) - run_m)
            high_m = min(high_m, max(high_t, self._safe_m) + run_m)
            half_turns = (
                box.fast_rad_s * (end_s - start_s if outrun else self._delay_s) / (4.0 * pi)
            )
            if outrun:
                outrun[-1] = outrun[-1]._replace(turns=outrun[-1].turns + half_turns)
            outrun.append(Outrun(max(whirl_m, self._safe_m), run_m, half_turns))
            start_s = end_s
        return low_m, min(high_m, before_whirl_has_grown(outrun))

    def fixed_range(self) -> tuple[float, float] | None:
        """Fixed clearances (m) that are admissible over the whole declared speed, load and inlet
        range."""
        need, whirl_m = self._over_the_range()
        count = round((self._max_m - self._min_m) / GRID_M)
        fits = [
            c
            for c in (self._min_m + i * GRID_M for i in range(count + 1))
            if self._capacity(c) >= need and c <= whirl_m
        ]
        return (fits[0], fits[-1]) if fits else None

    def admits_fixed(self, clearance_m: float) -> bool:
        """Whether ``clearance_m`` is admissible over the whole declared range."""
        need, whirl_m = self._over_the_range()
        return self._capacity(clearance_m) >= need and clearance_m <= whirl_m

    def _over_the_range(self) -> tuple[float, float]:
        """Film need and whirl bound of the whole declared range, with oil as the law has it."""
        need = self._film_need(self._speeds, self._loads[1]) / self._viscosity.law(
            self._oil.inlet_max_C
        )
        oils = (self._viscosity.law(t) for t in (self._oil.inlet_min_C, self._oil.film_max_C))
        return need, self._whirl_bound(self._speeds[1], self._loads[0], *oils)

    # ------------------------------------------------------------------ the two laws

    def _whirling(self, temperature_C: float, oil: tuple[float, float]) -> tuple[float, float]:
        """Viscosities of the thinnest and of the thickest credible film; ``oil`` as in
        :meth:`interval`."""
        thinner, thicker = oil
        hottest_C = max(temperature_C, self._oil.film_max_C)
        return (
            self._viscosity.law(hottest_C) * thinner,
            self._viscosity.law(temperature_C) * thicker,
        )

    def _whirl_bound(self, speed_rad_s: float, load_N: float, *viscosities: float) -> float:
        """Largest clearance that is stable at that speed and load in oil of each viscosity.

        In thin oil the journal runs more eccentric, where a balanced rotor whirls earlier and one
        out of balance later than in thick oil: of a range of viscosities one of the ends is the
        worst.
        """
        per_number = (
            load_N
            / (self._mass_kg * speed_rad_s * speed_rad_s)
            * self._whirl_speed
            * self._whirl_speed
        )
        number = per_number * per_number * load_N
        shaken = self._shaking_kg_m * speed_rad_s * speed_rad_s / load_N
        stable_m = [
            per_number
            / self._film.whirl_share(number / (viscosity * speed_rad_s * self._film_share), shaken)
            for viscosity in viscosities
        ]
        return min(stable_m) - self._error_m - self._offset_m

    def _film_need(self, speeds: tuple[float, float], load_N: float) -> float:
        """Largest ``W / w`` in the range of speeds; the normal unbalance turns with the load.

        ``W/w + U w`` is convex in the speed, so one of the ends is the worst.
        """
        return max(load_N / w + self._unbalance_kg_m * w for w in speeds)

    def _capacity(self, clearance_m: float) -> float:
        """Smallest ``W / (mu w)`` at which the film thins to the limit, for a bearing as built near
        this."""
        smallest = float("inf")
        built_m = clearance_m + self._offset_m
        for c in (built_m - self._error_m, built_m, built_m + self._error_m):
            eccentricity = 1.0 - self._min_film_m / c
            if eccentricity <= 0.0:
                return 0.0
            smallest = min(smallest, self._film.load_per_viscous_speed(eccentricity, c))
        return smallest

    def _capacities(self, end_m: float) -> list[float]:
        """Running minimum of capacity from the retreat clearance to ``end_m`` in :data:`GRID_M`,
        negated.

        Negated, so that it rises and :func:`bisect.bisect_right` finds how far a need is met.
        """
        sign = 1.0 if end_m >= self._safe_m else -1.0
        count = int(abs(end_m - self._safe_m) / GRID_M + 1e-6)
        falling: list[float] = []
        for i in range(count + 1):
            capacity = self._capacity(self._safe_m + sign * i * GRID_M)
            falling.append(-min(capacity, -falling[-1]) if falling else -capacity)
        return falling

    def _film_bounds(self, need: float) -> tuple[float, float]:
        """Connected run of clearances around the retreat clearance whose capacity is at least
        ``need``."""
        up = bisect_right(self._above, -need)
        down = bisect_right(self._below, -need)
        if not up or not down:
            return self._max_m, self._min_m
        return self._safe_m - (down - 1) * GRID_M, self._safe_m + (up - 1) * GRID_M

    def _bounds(
        self,
        box: Box,
        temperature_C: float,
        present_rad_s: float,
        thinner: float,
        oils: tuple[float, float],
    ) -> tuple[float, float, float]:
        """Clearances of film, from and to, and the widest of whirl, over a box of speed and load.

        ``thinner``: of the thinnest credible oil over the law's; ``oils``: viscosities of
        :meth:`_whirling`.

        Film heating goes with speed (friction power with its square, side flow with itself), so the
        excess of the outlet over the warmest inlet is scaled to the slow end, where the film is
        judged. The retreat clearance is proven for the declared loads in oil as the law has it: no
        thinner batch asks for more.
        """
        inlet_C = min(temperature_C, self._oil.inlet_max_C)
        hottest_C = inlet_C + (temperature_C - inlet_C) * box.slow_rad_s / present_rad_s
        law = self._viscosity.law(hottest_C)
        speeds = box.slow_rad_s, box.fast_rad_s
        declared = max(self._film_need(speeds, self._loads[1]) / law, -self._above[0])
        low_m, high_m = self._film_bounds(
            min(self._film_need(speeds, box.heavy_N) / (law * thinner), declared)
        )
        return low_m, high_m, self._whirl_bound(box.fast_rad_s, box.light_N, *oils)

    def _box_after(self, t_s: float, present: Box, announced: Sequence[Ramp]) -> Box:
        """All that unannounced ramps from now can reach in ``t_s``, and what has been announced."""
        box, start = self._drifted(present, t_s), present
        for ramp in announced:
            if ramp.start_s >= t_s:
                break
            reached, since_s = (
                along(ramp, self._added_N, start, t_s),
                max(0.0, t_s - max(ramp.end_s, 0.0)),
            )
            box, start = hull(box, self._drifted(reached, since_s)), reached
        return box

    def _drifted(self, box: Box, t_s: float) -> Box:
        """``box`` after unannounced ramps of ``t_s``, within the declared range."""
        speed, load = self._speed_ramp * t_s, self._load_ramp * t_s
        return Box(
            min(box.slow_rad_s, max(self._speeds[0], box.slow_rad_s - speed)),
            max(box.fast_rad_s, min(self._speeds[1], box.fast_rad_s + speed)),
            min(box.light_N, max(self._loads[0], box.light_N - load)),
            max(box.heavy_N, min(self._loads[1], box.heavy_N + load)),
        )
