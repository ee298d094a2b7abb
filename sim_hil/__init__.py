"""The rotor rig in software: what stands in for the machine when there is none."""

from .film import Feed, FilmForce, film_force

__all__ = ["Feed", "FilmForce", "film_force"]
