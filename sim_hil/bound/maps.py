"""Fixed settings through a duty: what each costs and where it is admissible, over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, Protocol

import numpy as np

from sim_hil.bound.case import BoundCase, Profile, TargetPlan
from sim_hil.bound.kept import kept_profile
from sim_hil.bound.limits import ORBIT_SHARE
from sim_hil.rotor.parameters import Floats

Judge = Callable[[Sequence[TargetPlan]], Sequence[Profile]]
"""Runs plans of one duty and tells what each came to, bin by bin."""


class Mapper(Protocol):
    """Like the built-in `map`; a pool's `map` computes side by side."""

    def __call__(self, work: Callable[[Any], Any], items: Iterable[Any], /) -> Iterable[Any]:
        """`work` over `items`, in order."""


def judged_alone(case: BoundCase, mapper: Mapper = map) -> Judge:
    """By the rotor alone on the table film; profiles are kept in the user's cache."""
    return lambda plans: list(mapper(partial(kept_profile, case), plans))


@dataclass(frozen=True)
class Map:
    """Profiles over supply pressures and clearances: shape (pressures, clearances, bins);
    clearances every 1 um.

    Margins are not below zero where admissible.
    """

    pressure_Pa: Floats
    clearance_m: Floats
    power_W: Floats
    film_margin_m: Floats
    orbit_margin: Floats

    @property
    def admissible(self) -> np.ndarray:
        """Where both limits hold."""
        return np.asarray((self.film_margin_m >= 0) & (self.orbit_margin >= 0))


def build_map(case: BoundCase, spacing_um: int, pressures_Pa: Iterable[float], judge: Judge) -> Map:
    """Run each pressure with a clearance every `spacing_um`, and interpolate the clearances to 1
    um."""
    b, pressures = case.rig.bearing, np.array(list(pressures_Pa), dtype=np.float64)
    low, high = round(b.clearance_min_m * 1e6), round(b.clearance_max_m * 1e6)
    known = sorted({*range(low, high + 1, spacing_um), high})
    plans = [TargetPlan.fixed(c * 1e-6, p) for p, c in product(pressures.tolist(), known)]
    profiles = judge(plans)
    grid = np.arange(low, high + 1, dtype=np.float64)

    def spread(name: str) -> Floats:
        rows = np.stack([getattr(p, name) for p in profiles]).reshape(
            pressures.size, len(known), -1
        )
        above = np.clip(np.searchsorted(known, grid), 1, len(known) - 1)
        left, right = np.take(known, above - 1), np.take(known, above)
        share = ((grid - left) / (right - left))[:, None]
        return np.asarray((1 - share) * rows[:, above - 1] + share * rows[:, above])

    return Map(
        pressures,
        grid * 1e-6,
        spread("power_W"),
        spread("min_film_m") - case.limits.min_film_m,
        ORBIT_SHARE - spread("orbit_share"),
    )
