"""Fluid film of a journal bearing: force, friction, flow, equilibrium and its linear coefficients."""

from .force import film_force
from .records import Feed, FilmError, FilmForce, FilmMemory, FilmNotConverged, JournalOutsideClearance

__all__ = [
    "Feed",
    "FilmError",
    "FilmForce",
    "FilmMemory",
    "FilmNotConverged",
    "JournalOutsideClearance",
    "film_force",
]
