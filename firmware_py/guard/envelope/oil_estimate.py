"""How thick the oil is beside its law, from the shaft power while nothing moves.

A batch of oil stays what it is, and so does the error of a thermometer: what one steady instant has
shown holds for the next.  ``P = w T + windage`` with the film's friction ``T c / (mu w)`` at a
credible place bounds the viscosity; best at high speed, where the bound on whirl needs it most.
"""

from __future__ import annotations

from typing import Final

import msgspec

from firmware_py.config import Config
from firmware_py.machine.film import StaticFilm
from firmware_py.machine.lubricant import CredibleOil

WINDAGE_ERROR: Final = 0.1
"""Of the windage, as a share of it."""

STEADY_S: Final = 0.5
STEADY_SPEED: Final = 1e-3
STEADY_M: Final = 1e-6
STEADY_C: Final = 0.25
STEADY_POWER: Final = 0.1
STEADY_W: Final = 2.0
"""Power is that of the film where speed, clearance, temperature and power keep within these (of
speed and power a share of the highest) for two windows of that length: nothing accelerates, moves
or warms up, and readings of different age are of one state.  The first window lets the mean of the
shaft's place and the slower readings follow; the means of the second are what counts, so that noise
does not add up over a long time to what it never was."""

GAP_S: Final = 0.25
"""Looks further apart are not one window."""

FORGOTTEN_1_S: Final = 2e-4
"""What is known widens at this rate: oil ages, and other oil is filled in."""


class SteadyInstant(msgspec.Struct, frozen=True):
    """One instant of a machine that may be steady."""

    time_s: float
    speed_rad_s: float
    clearance_m: float
    temperature_C: float
    power_W: float

    def values(self) -> tuple[float, float, float, float]:
        """All but the time."""
        return self.speed_rad_s, self.clearance_m, self.temperature_C, self.power_W


class SteadyWindow(msgspec.Struct):
    """Instants that were steady together; ``settled``: so were those of the window before."""

    start_s: float
    last_s: float
    settled: bool
    count: int
    lows: tuple[float, float, float, float]
    highs: tuple[float, float, float, float]
    sums: tuple[float, float, float, float]
    places: tuple[int, int]

    @classmethod
    def of(cls, now: SteadyInstant, credible: tuple[int, int], *, settled: bool) -> SteadyWindow:
        """The window that begins now."""
        values = now.values()
        return cls(now.time_s, now.time_s, settled, 1, values, values, values, credible)

    def add(self, now: SteadyInstant, credible: tuple[int, int]) -> bool:
        """Take ``now`` in; whether all is steady still."""
        (w0, c0, t0, p0), (w1, c1, t1, p1) = self.lows, self.highs
        w, c, t, p = now.values()
        self.lows = min(w0, w), min(c0, c), min(t0, t), min(p0, p)
        self.highs = max(w1, w), max(c1, c), max(t1, t), max(p1, p)
        s0, s1, s2, s3 = self.sums
        self.sums = s0 + w, s1 + c, s2 + t, s3 + p
        self.count, self.last_s = self.count + 1, now.time_s
        self.places = min(self.places[0], credible[0]), max(self.places[1], credible[1])
        (w0, c0, t0, p0), (w1, c1, t1, p1) = self.lows, self.highs
        return (
            w1 - w0 <= STEADY_SPEED * w1
            and c1 - c0 <= STEADY_M
            and t1 - t0 <= STEADY_C
            and p1 - p0 <= STEADY_POWER * abs(p1) + STEADY_W
        )

    def mean(self) -> SteadyInstant:
        """Of all instants."""
        w, c, t, p = (total / self.count for total in self.sums)
        return SteadyInstant(self.last_s, w, c, t, p)


class OilInterval(msgspec.Struct, frozen=True):
    """Viscosity over that of the law at the outlet's reading; ``thinnest_wide`` if the bearing is
    as wide as may be."""

    thinnest: float
    thickest: float
    thinnest_wide: float


class OilState(msgspec.Struct):
    """What has been learnt, when, and the window that may be steady (for snapshots)."""

    thinnest: float
    thickest: float
    thinnest_wide: float
    learnt_s: float = 0.0
    window: SteadyWindow | None = None


class OilEstimator:
    """Bounds of the viscosity, as shares of the law.

    Parameters
    ----------
    config
        Oil, rotor and how well its film is known; nothing is learnt where the film's friction or
        temperature are not.
    film
        Its film at rest.
    """

    def __init__(self, config: Config, film: StaticFilm) -> None:
        self._film, self._law = film, CredibleOil(config.machine)
        self._windage_W_s3, self._power_error_W = (
            config.machine.rotor.windage_W_s3,
            config.machine.rotor.shaft_power_error_W,
        )
        self._friction_error = config.machine.bearing.friction_error_share
        self._at_outlet, self._coldest_C = (
            config.machine.lubricant.film_at_outlet,
            config.machine.lubricant.inlet_min_C,
        )
        widest_m = (
            config.machine.bearing.radial_clearance_max_um
            + config.machine.bearing.radial_clearance_offset_um
        ) * 1e-6
        self._error_m = config.machine.bearing.radial_clearance_error_um * 1e-6
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

    def learn(self, state: OilState, now: SteadyInstant, credible: tuple[int, int]) -> None:
        """Narrow what is known by the power at a place between two knots of the film.

        The same power in a wider bearing means thicker oil, and position then means less load all
        the same: the smallest load is that of the widest bearing, as long as the oil gains no more
        on the way than the load loses in the widest clearance, with its square.  A power that
        contradicts what is known is no news of the oil: all is forgotten.
        """
        self.forget(state, now.time_s)
        window = self._steady(state, now, credible) if self._learns else None
        if window is None:
            return
        now, credible = window.mean(), window.places
        w, wind_W = (
            now.speed_rad_s,
            self._windage_W_s3 * now.speed_rad_s * now.speed_rad_s * now.speed_rad_s,
        )
        law = self._law.law(now.temperature_C) * w * w
        low_W = now.power_W - self._power_error_W - (1.0 + WINDAGE_ERROR) * wind_W
        high_W = now.power_W + self._power_error_W - (1.0 - WINDAGE_ERROR) * wind_W
        narrow_m, wide_m = now.clearance_m - self._error_m, now.clearance_m + self._error_m
        low = (
            low_W
            * narrow_m
            / (law * self._film.friction[credible[1]] * (1.0 + self._friction_error))
        )
        high = (
            high_W
            * wide_m
            / (law * self._film.friction[credible[0]] * (1.0 - self._friction_error))
        )
        wide = low * min(wide_m / narrow_m, self._wider * self._wider)
        thinnest, thickest = max(state.thinnest, low), min(state.thickest, high)
        if thinnest > thickest:
            state.thinnest, state.thickest = self._law.thinnest, self._law.thickest
            state.thinnest_wide = self._law.thinnest
        else:
            state.thinnest, state.thickest, state.thinnest_wide = (
                thinnest,
                thickest,
                max(state.thinnest_wide, wide),
            )

    def _steady(
        self, state: OilState, now: SteadyInstant, credible: tuple[int, int]
    ) -> SteadyWindow | None:
        """The window that ``now`` completes, if the one before it was steady too."""
        window = state.window
        steady = (
            window is not None
            and 0.0 <= now.time_s - window.last_s <= GAP_S
            and window.add(now, credible)
        )
        if window is None or not steady:
            state.window = SteadyWindow.of(now, credible, settled=False)
            return None
        if now.time_s - window.start_s < STEADY_S - 1e-6:
            return None
        state.window = SteadyWindow.of(now, credible, settled=True)
        return window if window.settled else None

    def forget(self, state: OilState, time_s: float) -> None:
        """Widen what was learnt by the time that has passed."""
        share = FORGOTTEN_1_S * max(0.0, time_s - state.learnt_s)
        state.learnt_s = time_s
        state.thinnest = max(self._law.thinnest, state.thinnest * (1.0 - min(share, 1.0)))
        state.thinnest_wide = max(self._law.thinnest, state.thinnest_wide * (1.0 - min(share, 1.0)))
        state.thickest = min(self._law.thickest, state.thickest * (1.0 + share))
