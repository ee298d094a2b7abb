"""May a clearance be advised, and which one instead: the predictor's check as pure functions.

A clearance is good when the expected minimum film and damping ratio keep their limits with a
reserve, and the peak-to-peak stays below its share of the smaller of present and new clearance.
Pessimism about load and oil is the guard's part.  The policy on the device
(:mod:`firmware_py.brain.policy`) and whoever evaluates policies call the same functions.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.prediction import Outlook
from firmware_py.config import Config

FILM_RESERVE_M: Final = 5e-7
WHIRL_RESERVE: Final = 0.03
"""What the expected film and damping ratio must have above their limits."""

Floats = NDArray[np.float64]


class OverruleLimits(NamedTuple):
    """What a clearance is held against: smallest film, share of the clearance that vibration may
    fill, and where to go when nothing is good."""

    min_film_m: float
    swing_share: float
    safe_m: float

    @classmethod
    def of(cls, config: Config) -> OverruleLimits:
        """The limits of the configuration."""
        return cls(
            config.limits.min_film_um * 1e-6,
            config.limits.clearance_share,
            config.machine.actuator.safe_radial_clearance_um * 1e-6,
        )


class Room(NamedTuple):
    """By how much film (m), damping ratio and peak-to-peak (m) keep their limits, shape (n,)
    each."""

    film_m: Floats
    whirl: Floats
    swing_m: Floats


class Choice(NamedTuple):
    """The clearance to advise, and why it is not the wish; empty when it is."""

    clearance_m: float
    overruled: str


def room(outlook: Outlook, present_m: float, limits: OverruleLimits) -> Room:
    """Room of each clearance of ``outlook``, with the clearance now at ``present_m``."""
    swing_m = limits.swing_share * np.minimum(outlook.clearance_m, present_m)
    return Room(
        outlook.min_film_m[:, 1] - limits.min_film_m - FILM_RESERVE_M,
        outlook.whirl_margin[:, 1] - WHIRL_RESERVE,
        swing_m - outlook.peak_to_peak_m[:, 1] - outlook.residual_m,
    )


def good(outlook: Outlook, present_m: float, limits: OverruleLimits) -> NDArray[np.bool_]:
    """Which clearances of ``outlook`` are good, shape (n,)."""
    film, whirl, swing = room(outlook, present_m, limits)
    return np.asarray(outlook.possible & (film >= 0) & (whirl >= 0) & (swing >= 0))


def choose(
    outlook: Outlook, present_m: float, interval_m: tuple[float, float], limits: OverruleLimits
) -> Choice:
    """The wish if its forecast is good, else the good candidate of least expected power, else the
    safe clearance.

    Parameters
    ----------
    outlook
        Of the candidates, and last of the wish.
    interval_m
        What the guard admits: a candidate outside is none.
    """
    admitted = good(outlook, present_m, limits)
    wish_m = float(outlook.clearance_m[-1])
    if admitted[-1]:
        return Choice(wish_m, "")
    why = f"actor's {wish_m * 1e6:.0f} um overruled: {fault(outlook, -1, present_m, limits)}"
    low_m, high_m = interval_m
    inside = (outlook.clearance_m >= low_m) & (outlook.clearance_m <= high_m)
    candidates = np.flatnonzero((admitted & inside)[:-1])
    if not len(candidates):
        return Choice(limits.safe_m, f"{why}; no candidate is good")
    best = candidates[np.argmin(outlook.power_W[candidates, 1])]
    return Choice(float(outlook.clearance_m[best]), why)


def fault(outlook: Outlook, index: int, present_m: float, limits: OverruleLimits) -> str:
    """What is not good about one clearance; empty when it is good."""
    film, whirl, swing = (float(rows[index]) for rows in room(outlook, present_m, limits))
    film_um = outlook.min_film_m[index, 1] * 1e6
    swing_um = outlook.peak_to_peak_m[index, 1] * 1e6
    ratio = outlook.whirl_margin[index, 1]
    checks = [
        (bool(outlook.possible[index]), "the film may not carry the load"),
        (film >= 0, f"minimum film {film_um:.1f} um is {-film * 1e6:.1f} short"),
        (whirl >= 0, f"damping ratio {ratio:.2f} is {-whirl:.2f} short"),
        (swing >= 0, f"peak-to-peak {swing_um:.1f} um is {-swing * 1e6:.1f} too much"),
    ]
    return ", ".join(text for holds, text in checks if not holds)
