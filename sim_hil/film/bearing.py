"""The bearing and the rules of its film: what stays while the journal moves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from .bore import PadBore
from .records import (
    Couette,
    FeedPatch,
    FilmArguments,
    FilmError,
    FilmMemory,
    Floats,
    Inlet,
    Rupture,
)
from .turbulence import GREATEST_RE

DEFAULT_GRID = (160, 20)
_THIN_FILM_LIMIT = 0.1


@dataclass(frozen=True)
class Bearing:
    """What stays while the journal moves; the fields are the keyword arguments of `film_force`."""

    radius_m: float
    length_m: float
    clearance_m: float
    viscosity_Pa_s: float
    speed_rad_s: float
    rupture: Rupture = "reynolds"
    inlet: Inlet = "periodic"
    feed: Sequence[FeedPatch] = ()
    end_pressure_Pa: tuple[float, float] = (0.0, 0.0)
    cavitation_pressure_Pa: float = 0.0
    couette: Couette = "full"
    clearance_rate_m_s: float = 0.0
    grid: tuple[int, int] = DEFAULT_GRID
    pads: PadBore | None = None
    density_kg_m3: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius_m", "length_m", "clearance_m", "viscosity_Pa_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise FilmError(f"{name} = {value}: must be finite and above zero")
        rest = (
            self.speed_rad_s,
            self.clearance_rate_m_s,
            self.cavitation_pressure_Pa,
            *self.end_pressure_Pa,
        )
        if not np.all(np.isfinite(rest)):
            raise FilmError(f"speed, clearance rate and pressures must be finite, got {rest}")
        if self.clearance_m > _THIN_FILM_LIMIT * self.radius_m:
            raise FilmError(
                f"clearance_m = {self.clearance_m}: above {_THIN_FILM_LIMIT} x radius_m = "
                f"{self.radius_m}, "
                "not a thin film; clearances are radial and in metres"
            )
        inertia = self.density_kg_m3 * abs(self.speed_rad_s) * self.radius_m * self.clearance_m
        if not 0.0 <= inertia <= GREATEST_RE * self.viscosity_Pa_s:
            raise FilmError(
                f"density_kg_m3 = {self.density_kg_m3}: Re = {inertia / self.viscosity_Pa_s:.3g} "
                f"in the clearance; the turbulent film is fitted from 0 to {GREATEST_RE:g}"
            )
        for name, choices in (("rupture", Rupture), ("inlet", Inlet), ("couette", Couette)):
            if getattr(self, name) not in get_args(choices):
                raise FilmError(f"{name} = {getattr(self, name)!r}: use one of {get_args(choices)}")
        lowest = min(*self.end_pressure_Pa, *(f.pressure_Pa for f in self.feed))
        if self.rupture != "full" and lowest < self.cavitation_pressure_Pa:
            raise FilmError(
                f"cavitation_pressure_Pa = {self.cavitation_pressure_Pa}: above a feed or end "
                f"pressure ({lowest})"
            )
        if len(self.grid) != 2 or self.grid[0] < 12 or self.grid[1] < 6:
            raise FilmError(
                f"grid = {self.grid}: needs at least 12 nodes around and 6 intervals along"
            )

    @classmethod
    def of(cls, arguments: FilmArguments) -> "Bearing":
        """The bearing that these arguments describe; the end pressures and feeds become tuples."""
        bearing = cls(**arguments)
        lower, upper = bearing.end_pressure_Pa
        grooves = bearing.pads.grooves(bearing.length_m) if bearing.pads else ()
        return replace(
            bearing,
            feed=(*bearing.feed, *grooves),
            end_pressure_Pa=(float(lower), float(upper)),
        )

    def thickness(self, theta: Floats, position: Floats) -> Floats:
        """Film over clearance, with the journal at `position` over clearance."""
        bore: Floats = 1 - position[0] * np.cos(theta) - position[1] * np.sin(theta)
        return bore if self.pads is None else bore + self.pads.thickness(theta) - 1

    def gap_m(self, position_m: Floats) -> float:
        """Smallest film with the journal there, below zero outside the bore."""
        if self.pads is None:
            return float(self.clearance_m - np.hypot(*position_m))
        return self.clearance_m * self.pads.smallest(position_m / self.clearance_m)

    @property
    def pressure_scale_Pa_s(self) -> float:
        """Pressure that belongs to a scaled pressure of 1/s (see `solver`)."""
        return 12 * self.viscosity_Pa_s * (self.radius_m / self.clearance_m) ** 2

    @property
    def floor(self) -> float:
        """Scaled cavitation pressure, 1/s."""
        return self.cavitation_pressure_Pa / self.pressure_scale_Pa_s

    @property
    def inlet_pressure_Pa(self) -> float | None:
        """Pressure of the inlet line at the thickest film: that of the surroundings."""
        return sum(self.end_pressure_Pa) / 2 if self.inlet == "groove_hmax" else None

    def check_memory(self, memory: FilmMemory | None) -> None:
        """Refuse a memory that the rules cannot use, and a steady conserving film that runs dry."""
        if memory is None:
            dry = max(self.end_pressure_Pa) <= self.cavitation_pressure_Pa
            if self.rupture == "jfo" and self.inlet == "periodic" and not self.feed and dry:
                raise FilmError(
                    "rupture = 'jfo' without memory: a film without feed, inlet line or end "
                    "pressure above "
                    "cavitation runs dry in the steady state; give one of them, or a memory"
                )
            return
        filled = self.rupture == "jfo" and self.inlet == "periodic"
        if not filled and memory.feed_pressure_Pa is None:
            raise FilmError(
                "memory: only the film with rupture = 'jfo' and inlet = 'periodic' has one"
            )
        if not (np.isfinite(memory.dt_s) and memory.dt_s > 0):
            raise FilmError(f"memory.dt_s = {memory.dt_s}: must be finite and above zero")
