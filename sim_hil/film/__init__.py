"""Fluid film of a journal bearing: force, friction, flow, equilibrium and its linear coefficients."""

from .equilibrium import Equilibrium, equilibrium
from .force import film_force
from .records import Feed, FilmError, FilmForce, FilmMemory, FilmNotConverged, JournalOutsideClearance

__all__ = [
    "Equilibrium",
    "Feed",
    "FilmError",
    "FilmForce",
    "FilmMemory",
    "FilmNotConverged",
    "JournalOutsideClearance",
    "equilibrium",
    "film_force",
]
