"""Damping of the film and modes of the rigid rotor on it, where the device's own laws end."""

from __future__ import annotations

from math import cos, inf, isnan, pi, sin
from typing import Final, NamedTuple

from firmware_py.machine import Machine, RotorDrawing
from firmware_py.machine.supply import nominal_bar
from sim_hil.film import equilibrium
from sim_hil.film.bore import PadBore
from sim_hil.film.feeding import feed_patches
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
    """The film around its equilibrium, and the rotor on it.

    Parameters
    ----------
    stiffness_N_m, damping_N_s_m
        Axis 0 along the load, axis 1 at 90 degrees in the direction of rotation.
    modes
        By rising frequency.
    eccentricity, attitude_rad, film_m, friction_W
        Where the shaft rests, its smallest film, and what it costs, W.
    flow_m3_s
        From all feeds.
    feed_Pa, feed_film_m
        Pressure in each opening and film at its middle; empty where none has a restrictor.
    feed_flow_m3_s
        Flow through each.
    whirl_kg
        Mass at the bearing of a rigid rotor that just whirls here; inf: none does.
    """

    stiffness_N_m: tuple[tuple[float, ...], ...]
    damping_N_s_m: tuple[tuple[float, ...], ...]
    modes: tuple[Whirling, ...]
    eccentricity: float
    attitude_rad: float
    film_m: float
    friction_W: float
    flow_m3_s: float
    feed_Pa: tuple[float, ...]
    feed_film_m: tuple[float, ...]
    feed_flow_m3_s: tuple[float, ...]
    whirl_kg: float


def linear_film(
    machine: Machine, clearance_m: float, viscosity_Pa_s: float, speed_rad_s: float, load_N: float
) -> LinearFilm:
    """The Reynolds film of ``machine`` around its equilibrium, and the rotor on it: between its
    pads where it has them, turbulent where it is, unfed or with its feed ports at the supply
    pressure of normal service.

    Raises
    ------
    FilmError
        A load that the film does not carry.
    """
    bearing = machine.bearing
    feeds = feed_patches(
        machine.feed_port,
        bearing.journal_radius_m,
        machine.lubricant.density_kg_m3,
        1e5 * nominal_bar(machine.feed),
    )
    state = equilibrium(
        load_N=load_N,
        radius_m=bearing.journal_radius_m,
        length_m=bearing.length_m,
        clearance_m=clearance_m,
        viscosity_Pa_s=viscosity_Pa_s,
        speed_rad_s=speed_rad_s,
        pads=PadBore.of(machine.pads),
        density_kg_m3=machine.lubricant.density_kg_m3,
        feed=feeds,
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
        state.eccentricity_ratio,
        state.attitude_rad,
        float(state.film.min_film_m),
        float(state.film.friction_torque_N_m) * speed_rad_s,
        float(state.film.inflow_m3_s),
        _floats(state.film.feed_pressure_Pa),
        tuple(
            clearance_m - float(state.position_m @ [cos(f.angle_rad), sin(f.angle_rad)])
            for f in feeds
        ),
        _floats(state.film.feed_flow_m3_s),
        inf
        if isnan(state.threshold)
        else (state.threshold / speed_rad_s) ** 2 * state.load_N / clearance_m,
    )


def _floats(values: Floats | None) -> tuple[float, ...]:
    return () if values is None else tuple(map(float, values))


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
