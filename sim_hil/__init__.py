"""The rotor rig in software: what stands in for the machine when there is none."""

from .film import Equilibrium, Feed, FilmForce, equilibrium, film_force

__all__ = ["Equilibrium", "Feed", "FilmForce", "equilibrium", "film_force"]
