"""Damping of the film and modes of the rigid rotor on it, where the device's own laws end."""

from __future__ import annotations

from math import pi
from typing import Final, NamedTuple

from firmware_py.machine import Machine, RotorDrawing
from sim_hil.film import equilibrium
from sim_hil.film.bore import PadBore
from sim_hil.rotor.modes import Floats, Modes, Support, modes

TURNING: Final = 1e-3
"""Share of the speed below which an eigenvalue is no whirl but a return without swinging."""


class Whirling(NamedTuple):
    """A damped mode: its frequency, share of critical damping (negative: unstable), and its sense
    (+1 with the rotation)."""

    frequency_rpm: float
    damping_ratio: float
    sense: int


class LinearFilm(NamedTuple):
    """Stiffness and damping, axis 0 along the load, axis 1 at 90 degrees in the direction of
    rotation; modes by rising frequency."""

    stiffness_N_m: tuple[tuple[float, ...], ...]
    damping_N_s_m: tuple[tuple[float, ...], ...]
    modes: tuple[Whirling, ...]


def linear_film(
    machine: Machine, clearance_m: float, viscosity_Pa_s: float, speed_rad_s: float, load_N: float
) -> LinearFilm:
    """The unfed Reynolds film of ``machine`` around its equilibrium, between its pads where it has
    them and turbulent where it is, and the rotor on it.

    Raises
    ------
    FilmError
        A load that the film does not carry.
    """
    bearing = machine.bearing
    state = equilibrium(
        load_N=load_N,
        radius_m=bearing.journal_radius_m,
        length_m=bearing.length_m,
        clearance_m=clearance_m,
        viscosity_Pa_s=viscosity_Pa_s,
        speed_rad_s=speed_rad_s,
        pads=PadBore.of(machine.pads),
        density_kg_m3=machine.lubricant.density_kg_m3,
    )
    found = _modes(machine.rotor, state.stiffness_N_m, state.damping_N_s_m, speed_rad_s)
    rows = zip(found.frequency_rad_s, found.damping_ratio, found.forward, strict=True)
    return LinearFilm(
        tuple(tuple(map(float, row)) for row in state.stiffness_N_m),
        tuple(tuple(map(float, row)) for row in state.damping_N_s_m),
        tuple(
            Whirling(float(rad_s) * 30.0 / pi, float(ratio), int(sense))
            for rad_s, ratio, sense in rows
            if rad_s > TURNING * speed_rad_s
        ),
    )


def _modes(
    rotor: RotorDrawing,
    stiffness_N_m: Floats,
    damping_N_s_m: Floats,
    speed_rad_s: float,
) -> Modes:
    """Of the whole drawing on coupling and film; of a rotor that was weighed, of its mass at the
    bearing."""
    drawn = (
        rotor.mass_kg,
        rotor.diametral_inertia_kg_m2,
        rotor.polar_inertia_kg_m2,
        rotor.coupling_to_cg_m,
        rotor.bearing_to_cg_m,
        rotor.coupling_stiffness_N_m,
        rotor.coupling_damping_N_s_m,
    )
    figures = [value for value in drawn if value is not None]
    if len(figures) < len(drawn):
        film = Support(0.0, stiffness_N_m, damping_N_s_m)
        return modes(rotor.mass_at_bearing_kg, 1.0, 0.0, [film], speed_rad_s)
    mass, j_d, j_p, to_coupling, to_bearing, stiffness, damping = figures
    supports = [
        Support(-to_coupling, stiffness, damping),
        Support(to_bearing, stiffness_N_m, damping_N_s_m),
    ]
    return modes(mass, j_d, j_p, supports, speed_rad_s)
