"""How thick the oil is beside its law, from the shaft power while nothing moves.

A batch of oil stays what it is, and so does the error of a thermometer: what one steady instant has shown holds for
the next.  ``P = w T + windage`` with the film's friction ``T c / (mu w)`` at a credible place bounds the viscosity;
best at high speed, where the bound on whirl needs it most.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.guard.bearing_laws import StaticFilm
from firmware_py.guard.viscosity import ViscosityTable

WINDAGE_ERROR: Final = 0.1
STEADY_S: Final = 0.5
STEADY_SPEED: Final = 1e-3
STEADY_M: Final = 1e-6
"""Power is that of the film where speed and clearance have kept within these for so long: nothing accelerates."""

FORGOTTEN_1_S: Final = 2e-4
"""What is known widens at this rate: oil ages, and other oil is filled in."""


class Steady(msgspec.Struct, frozen=True):
    """One instant of a machine that may be steady."""

    time_s: float
    speed_rad_s: float
    clearance_m: float
    temperature_C: float
    power_W: float


class OilInterval(msgspec.Struct, frozen=True):
    """Viscosity over that of the law at the outlet's reading; ``thinnest_wide`` if the bearing is as wide as may be."""

    thinnest: float
    thickest: float
    thinnest_wide: float


class OilState(msgspec.Struct):
    """What has been learnt, when, and since when the machine is steady (for snapshots)."""

    thinnest: float
    thickest: float
    thinnest_wide: float
    learnt_s: float = 0.0
    since: Steady | None = None


class OilEstimator:
    """Bounds of the viscosity, as shares of the law.

    Parameters
    ----------
    config
        Oil, rotor and how well its film is known; nothing is learnt where the film's friction or temperature are not.
    film
        Its film at rest.
    """

    def __init__(self, config: Config, film: StaticFilm) -> None:
        self._film, self._law = film, ViscosityTable(config.oil)
        self._windage_W_s3, self._power_error_W = config.rotor.windage_W_s3, config.rotor.shaft_power_error_W
        self._friction_error = config.bearing.friction_error_share
        self._at_outlet, self._coldest_C = config.oil.film_at_outlet, config.oil.inlet_min_C
        widest_m = (config.bearing.radial_clearance_max_um + config.bearing.radial_clearance_offset_um) * 1e-6
        self._error_m = config.bearing.radial_clearance_error_um * 1e-6
        self._wider = (widest_m + self._error_m) / (widest_m - self._error_m)
        self._learns = self._at_outlet and self._friction_error < 1.0

    def unknown(self) -> OilState:
        """Before anything was learnt."""
        return OilState(self._law.thinnest, self._law.thickest, self._law.thinnest)

    def interval(self, state: OilState) -> OilInterval:
        """What is known."""
        return OilInterval(state.thinnest, state.thickest, state.thinnest_wide)

    def thickest(self, oil: OilInterval, temperature_C: float) -> float:
        """Thickest film over the law at the reading, which may be as cold as the coldest inlet."""
        if self._at_outlet or temperature_C <= self._coldest_C:
            return oil.thickest
        return oil.thickest * self._law.law(self._coldest_C) / self._law.law(temperature_C)

    def learn(self, state: OilState, now: Steady, credible: tuple[int, int]) -> None:
        """Narrow what is known by the power at a place between two knots of the film.

        The same power in a wider bearing means thicker oil, and position then means less load all the same: the
        smallest load is that of the widest bearing, as long as the oil gains no more on the way than the load loses
        in the widest clearance, with its square.  A power that contradicts what is known is no news of the oil: all
        is forgotten.
        """
        if not self._learns or not self._steady(state, now):
            return
        self._forget(state, now.time_s)
        w, wind_W = now.speed_rad_s, self._windage_W_s3 * now.speed_rad_s * now.speed_rad_s * now.speed_rad_s
        law = self._law.law(now.temperature_C) * w * w
        low_W = now.power_W - self._power_error_W - (1.0 + WINDAGE_ERROR) * wind_W
        high_W = now.power_W + self._power_error_W - (1.0 - WINDAGE_ERROR) * wind_W
        narrow_m, wide_m = now.clearance_m - self._error_m, now.clearance_m + self._error_m
        low = low_W * narrow_m / (law * self._film.friction[credible[1]] * (1.0 + self._friction_error))
        high = high_W * wide_m / (law * self._film.friction[credible[0]] * (1.0 - self._friction_error))
        wide = low * min(wide_m / narrow_m, self._wider * self._wider)
        thinnest, thickest = max(state.thinnest, low), min(state.thickest, high)
        if thinnest > thickest:
            state.thinnest, state.thickest = self._law.thinnest, self._law.thickest
            state.thinnest_wide = self._law.thinnest
        else:
            state.thinnest, state.thickest, state.thinnest_wide = thinnest, thickest, max(state.thinnest_wide, wide)

    def _steady(self, state: OilState, now: Steady) -> bool:
        since = state.since
        if since is None or abs(now.speed_rad_s - since.speed_rad_s) > STEADY_SPEED * since.speed_rad_s:
            state.since = now
            return False
        return now.time_s - since.time_s >= STEADY_S

    def _forget(self, state: OilState, time_s: float) -> None:
        """Widen what was learnt by the time that has passed."""
        share = FORGOTTEN_1_S * max(0.0, time_s - state.learnt_s)
        state.learnt_s = time_s
        state.thinnest = max(self._law.thinnest, state.thinnest * (1.0 - min(share, 1.0)))
        state.thinnest_wide = max(self._law.thinnest, state.thinnest_wide * (1.0 - min(share, 1.0)))
        state.thickest = min(self._law.thickest, state.thickest * (1.0 + share))
