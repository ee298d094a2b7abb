"""Fluid film of a journal bearing: force, friction, flow, equilibrium and its linear
coefficients."""

from .equilibrium import Equilibria, Equilibrium, equilibrium
from .force import film_force
from .records import (
    FeedPatch,
    FilmError,
    FilmForce,
    FilmMemory,
    FilmNotConverged,
    JournalOutsideClearance,
)
from .thermal import ThermalEquilibrium, thermal_equilibrium

__all__ = [
    "Equilibria",
    "Equilibrium",
    "FeedPatch",
    "FilmError",
    "FilmForce",
    "FilmMemory",
    "FilmNotConverged",
    "JournalOutsideClearance",
    "ThermalEquilibrium",
    "equilibrium",
    "film_force",
    "thermal_equilibrium",
]
