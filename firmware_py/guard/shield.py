"""The shield: which radial clearances are admissible, by closed forms alone.

Two laws bound the clearance ``c`` of a plain journal bearing (radius ``R``, length ``L``, ``lam = L/2R``):

* **film** (upper and lower): at the largest credible load and the thinnest credible oil the minimum film
  must be at least ``h``.  Ocvirk's short bearing with pi-film carries, at eccentricity ``eps = 1 - h/c``,
  ``W = mu w R L^3 eps sqrt(16 eps^2 + pi^2 (1 - eps^2)) / (4 c^2 (1 - eps^2)^2)`` (Dubois & Ocvirk, NACA
  Report 1157, 1953); the side leakage of a finite length is ``kappa = 1 / (1 + lam^2 (0.38 + eps^2) /
  (1 - eps^2))``, fitted from below to the Reynolds solution for ``lam <= 1``.
* **whirl** (upper): a rigid rotor of effective mass ``m`` on the film is stable while
  ``w sqrt(c m / W) < Omega(eps)``; over all eccentricities and ``lam <= 1`` the Reynolds film never has
  ``Omega`` below 2.50 (short bearing: Lund 1966, Holmes 1960), so the smallest credible load decides.

The minimum film is not monotone in clearance, so film admits the connected run of clearances around the
safe one.  **Reachability**: a clearance is admissible only if, while the declared fastest ramps pull speed
and load to their worst, the actuator can still run back to the safe clearance ahead of both laws.

Only + - * / and sqrt in a fixed order: the same bits on every machine.
"""

from __future__ import annotations

from bisect import bisect_right
from math import pi, sqrt
from typing import Final

from firmware_py.config import Config, ConfigFile
from firmware_py.guard.viscosity import ViscosityTable

GRID_M: Final = 1e-6
WHIRL_NUMBER: Final = 2.50
"""Smallest ``w sqrt(c m / W)`` at which a plain Reynolds film of ``L/D <= 1`` loses stability."""

SPEED_MARGIN: Final = 0.95
"""Share of the whirl threshold speed that is used (feed pressure and coupling shift it by a few percent)."""

CLEARANCE_ERROR_M: Final = 2e-6
"""A built bearing differs from its drawing by this much (radial)."""

TEMPERATURE_ERROR_C: Final = 1.0
LENGTH_OVER_DIAMETER_MAX: Final = 1.0
STEP_S: Final = 0.1
"""Step of the reachability test; each step takes the worst of its end."""


def leakage_factor(eccentricity: float, length_over_diameter: float) -> float:
    """Finite-length load as a share of the short bearing's, from below (module docstring)."""
    lam2 = length_over_diameter * length_over_diameter
    e2 = eccentricity * eccentricity
    return 1.0 / (1.0 + lam2 * (0.38 + e2) / (1.0 - e2))


def load_per_viscous_speed(eccentricity: float, clearance_m: float, radius_m: float, length_m: float) -> float:
    """Static load carried at ``eccentricity`` per viscosity and speed, ``W / (mu w)`` in m^2."""
    e2 = eccentricity * eccentricity
    short = (radius_m * length_m * length_m * length_m * eccentricity * sqrt(16.0 * e2 + pi * pi * (1.0 - e2))
             / (4.0 * clearance_m * clearance_m * (1.0 - e2) * (1.0 - e2)))
    return short * leakage_factor(eccentricity, 0.5 * length_m / radius_m)


class Shield:
    """Admissible interval of the radial clearance.

    Parameters
    ----------
    config
        Bearing, oil, rotor, declared operating range, actuator and limits.
    """

    def __init__(self, config: Config) -> None:
        b, a, o = config.bearing, config.actuator, config.operating
        self._radius_m, self._length_m = b.journal_radius_m, b.length_m
        self._min_film_m = config.limits.min_film_um * 1e-6
        self._share = config.limits.clearance_share
        self._mass_kg = config.rotor.effective_mass_at_bearing_kg
        self._unbalance_kg_m = config.rotor.unbalance_normal_kg_m
        self._oil = config.oil
        self._viscosity = ViscosityTable(config.oil)
        self._safe_m = a.safe_radial_clearance_um * 1e-6
        self._rate_m_s = a.rate_um_s * 1e-6
        self._delay_s = a.time_to_live_ms * 1e-3 + 3.0 * a.time_constant_s
        self._speeds = (o.speed_min_rpm * pi / 30, o.speed_max_rpm * pi / 30)
        self._loads = (o.load_min_N, o.load_max_N)
        self._speed_ramp = o.speed_ramp_max_rpm_s * pi / 30
        self._load_ramp = o.load_ramp_max_N_s
        self._min_m, self._max_m = b.radial_clearance_min_um * 1e-6, b.radial_clearance_max_um * 1e-6
        self._above = self._capacities(self._max_m)
        self._below = self._capacities(self._min_m)

    def interval(
        self, speed_rad_s: float, load_low_N: float, load_high_N: float, temperature_C: float,
        peak_to_peak_m: float = 0.0,
    ) -> tuple[float, float] | None:
        """Admissible radial clearances now, able to retreat in time; None when not even safe is one.

        Parameters
        ----------
        speed_rad_s
            Shaft speed, positive.
        load_low_N, load_high_N
            Smallest and largest credible static load.
        temperature_C
            Oil outlet temperature.
        peak_to_peak_m
            Measured vibration, larger axis; it may fill at most ``limits.clearance_share`` of a clearance
            narrower than the safe one (the safe one itself stays: protection watches it).
        """
        if not speed_rad_s > 0.0:
            return None
        now = self._bounds(speed_rad_s, speed_rad_s, load_low_N, load_high_N, temperature_C, speed_rad_s)
        low_m = max(now[0], self._min_m, min(peak_to_peak_m / self._share, self._safe_m))
        high_m = min(now[1], self._max_m)
        if not low_m <= self._safe_m <= high_m:
            return None
        reach_s = max(self._max_m - self._safe_m, self._safe_m - self._min_m) / self._rate_m_s + self._delay_s
        for k in range(int(reach_s / STEP_S) + 1):
            low_t, high_t = self._bounds_after((k + 1) * STEP_S, speed_rad_s, load_low_N, load_high_N, temperature_C)
            run_m = self._rate_m_s * max(0.0, k * STEP_S - self._delay_s)
            low_m = max(low_m, min(low_t, self._safe_m) - run_m)
            high_m = min(high_m, max(high_t, self._safe_m) + run_m)
        return low_m, high_m

    def fixed_range(self) -> tuple[float, float] | None:
        """Fixed clearances (m) that are admissible over the whole declared speed, load and inlet range."""
        whirl_m = self._whirl_bound(self._speeds[1], self._loads[0])
        viscosity = self._viscosity.thinnest(self._oil.inlet_max_C)
        need = self._film_need(self._speeds, self._loads[1]) / viscosity
        count = round((self._max_m - self._min_m) / GRID_M)
        fits = [c for c in (self._min_m + i * GRID_M for i in range(count + 1))
                if self._capacity(c) >= need and c <= whirl_m]
        return (fits[0], fits[-1]) if fits else None

    def admits_fixed(self, clearance_m: float) -> bool:
        """Whether ``clearance_m`` is admissible over the whole declared range."""
        need = self._film_need(self._speeds, self._loads[1]) / self._viscosity.thinnest(self._oil.inlet_max_C)
        return self._capacity(clearance_m) >= need and clearance_m <= self._whirl_bound(self._speeds[1], self._loads[0])

    # ------------------------------------------------------------------ the two laws

    def _whirl_bound(self, speed_rad_s: float, load_N: float) -> float:
        """Largest stable clearance at the highest speed and smallest load."""
        number = WHIRL_NUMBER * SPEED_MARGIN
        return number * number * load_N / (self._mass_kg * speed_rad_s * speed_rad_s) - CLEARANCE_ERROR_M

    def _film_need(self, speeds: tuple[float, float], load_N: float) -> float:
        """Largest ``W / w`` in the range of speeds; the normal unbalance turns with the load.

        ``W/w + U w`` is convex in the speed, so one of the ends is the worst.
        """
        return max(load_N / w + self._unbalance_kg_m * w for w in speeds)

    def _capacity(self, clearance_m: float) -> float:
        """Smallest ``W / (mu w)`` at which the film thins to the limit, for a bearing as built near this."""
        smallest = float("inf")
        for c in (clearance_m - CLEARANCE_ERROR_M, clearance_m, clearance_m + CLEARANCE_ERROR_M):
            eccentricity = 1.0 - self._min_film_m / c
            if eccentricity <= 0.0:
                return 0.0
            smallest = min(smallest, load_per_viscous_speed(eccentricity, c, self._radius_m, self._length_m))
        return smallest

    def _capacities(self, end_m: float) -> list[float]:
        """Running minimum of capacity from the safe clearance to ``end_m`` in :data:`GRID_M`, negated.

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
        """Connected run of clearances around the safe one whose capacity is at least ``need``."""
        up = bisect_right(self._above, -need)
        down = bisect_right(self._below, -need)
        if not up or not down:
            return self._max_m, self._min_m
        return self._safe_m - (down - 1) * GRID_M, self._safe_m + (up - 1) * GRID_M

    def _bounds(
        self, slow_rad_s: float, fast_rad_s: float, load_low_N: float, load_high_N: float, temperature_C: float,
        present_rad_s: float,
    ) -> tuple[float, float]:
        """Both laws over a box of speed and load.

        Film heating goes with speed (friction power with its square, side flow with itself), so the
        excess of the outlet over the warmest inlet is scaled to the slow end, where the film is judged.
        """
        outlet_C = temperature_C + TEMPERATURE_ERROR_C
        inlet_C = min(outlet_C, self._oil.inlet_max_C)
        hottest = min(inlet_C + (outlet_C - inlet_C) * slow_rad_s / present_rad_s, self._oil.film_max_C)
        need = self._film_need((slow_rad_s, fast_rad_s), load_high_N) / self._viscosity.thinnest(hottest)
        low_m, high_m = self._film_bounds(need)
        return low_m, min(high_m, self._whirl_bound(fast_rad_s, load_low_N))

    def _bounds_after(
        self, t_s: float, speed_rad_s: float, load_low_N: float, load_high_N: float, temperature_C: float,
    ) -> tuple[float, float]:
        """Both laws over all that the declared ramps can reach in ``t_s``."""
        slow = min(speed_rad_s, max(self._speeds[0], speed_rad_s - self._speed_ramp * t_s))
        fast = max(speed_rad_s, min(self._speeds[1], speed_rad_s + self._speed_ramp * t_s))
        light = min(load_low_N, max(self._loads[0], load_low_N - self._load_ramp * t_s))
        heavy = max(load_high_N, min(self._loads[1], load_high_N + self._load_ramp * t_s))
        return self._bounds(slow, fast, light, heavy, temperature_C, speed_rad_s)


def check_safe(config: Config, source: ConfigFile) -> None:
    """Refuse a configuration whose safe clearance is not admissible everywhere.

    Raises
    ------
    ConfigError
        ``L/D`` outside the verified domain, no fixed clearance admissible over the declared range, or the
        safe one not among them.
    """
    ratio = 0.5 * config.bearing.length_m / config.bearing.journal_radius_m
    if ratio > LENGTH_OVER_DIAMETER_MAX:
        raise source.error("bearing.length_m", config.bearing.length_m, (
            f"L/D = {ratio:.2f}; the guard's bounds are verified up to {LENGTH_OVER_DIAMETER_MAX:g}: "
            "shorten it or use monitor equipment for long bearings"))
    shield = Shield(config)
    fixed = shield.fixed_range()
    safe_um = config.actuator.safe_radial_clearance_um
    o = config.operating
    declared = (f"{o.speed_min_rpm:g} .. {o.speed_max_rpm:g} rpm, {o.load_min_N:g} .. {o.load_max_N:g} N, "
                f"oil up to {config.oil.inlet_max_C:g} degC")
    if fixed is None:
        raise source.error("operating", None, (
            f"no fixed clearance is admissible over {declared}; narrow operating.* or oil.inlet_max_C, "
            "or lower limits.min_film_um"))
    if not shield.admits_fixed(safe_um * 1e-6):
        raise source.error("actuator.safe_radial_clearance_um", safe_um, (
            f"not admissible over {declared}; choose {fixed[0] * 1e6:.0f} .. {fixed[1] * 1e6:.0f} um"))
