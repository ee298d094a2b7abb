"""The way back to the retreat clearance: what speed and load may become meanwhile, and how far
whirl grows."""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec

GROWTH_TURNS: Final = 0.5
"""Whirl grows the slower the less the clearance exceeds its bound, and has not grown while excess
times turns is less.

An orbit fills half the clearance after 1.8 turns over the excess (36 turns at 5 %), 0.75 at the
least where unbalance alone nearly does (the rotor of :mod:`sim_hil.film.whirl_onset`)."""


class Ramp(msgspec.Struct, frozen=True):
    """A ramp of the machine known ahead: it starts and ends so many seconds from now, at this speed
    and load."""

    start_s: float
    end_s: float
    speed_rad_s: float
    load_N: float


class Box(msgspec.Struct, frozen=True):
    """All speeds and loads of the film that the machine may have at one instant."""

    slow_rad_s: float
    fast_rad_s: float
    light_N: float
    heavy_N: float


class Outrun(NamedTuple):
    """End of a step of the retreat: the clearance that just whirls, how far the retreat has come,
    and turns.

    The turns are half of those of the steps before and after it: the trapezoidal rule.
    """

    whirl_m: float
    run_m: float
    turns: float


def before_whirl_has_grown(outrun: list[Outrun]) -> float:
    """Widest clearance whose retreat, wider than whirl admits for a while, ends before whirl has
    grown."""
    slope_1_m = grown = 0.0
    widest_m = float("inf")
    for step in sorted(outrun, key=lambda step: step.whirl_m + step.run_m):
        if widest_m <= step.whirl_m + step.run_m:
            break  # it never exceeds this one, nor the rest
        slope_1_m += step.turns / step.whirl_m
        grown += step.turns * (step.run_m / step.whirl_m + 1.0)
        widest_m = (GROWTH_TURNS + grown) / slope_1_m
    return widest_m


def along(ramp: Ramp, added_N: tuple[float, float], start: Box, t_s: float) -> Box:
    """``start`` moved along ``ramp`` until ``t_s``, which lies after its start; a groove adds to
    the ramp's load."""
    first_s = max(ramp.start_s, 0.0)
    share = 1.0 if t_s >= ramp.end_s else (t_s - first_s) / (ramp.end_s - first_s)
    speed, rest = share * ramp.speed_rad_s, 1.0 - share
    light_N, heavy_N = (share * (ramp.load_N + more) for more in added_N)
    return Box(
        rest * start.slow_rad_s + speed,
        rest * start.fast_rad_s + speed,
        rest * start.light_N + light_N,
        rest * start.heavy_N + heavy_N,
    )


def hull(a: Box, b: Box) -> Box:
    """The smallest box that holds both."""
    return Box(
        min(a.slow_rad_s, b.slow_rad_s),
        max(a.fast_rad_s, b.fast_rad_s),
        min(a.light_N, b.light_N),
        max(a.heavy_N, b.heavy_N),
    )
