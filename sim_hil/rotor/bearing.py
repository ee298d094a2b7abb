"""The bearing with its oil: what the film law says once supply, wear and temperature have had their
share.

Starvation.  A feed that covers only the share ``s`` of what runs off at the ends fills a band of
width ``s L`` (streamlets between, as in the ruptured part of a fed film).  A film this narrow
carries ``s^2.5``: the exponent of the load in the length of the full Reynolds film, 2.8 to 2.2 at
eccentricity ratios 0.3 to 0.9 and L/D from 1/4 to 1/2 (`sim_hil.film.equilibrium`).  Shear and
outflow go with the wetted band, ``s``.  The band's place within the arc is not modelled.
"""

from __future__ import annotations

import math

from sim_hil.film.elementary import exp_of
from sim_hil.film.pad_shape import pad_gap
from sim_hil.film.table_kernel import EPS_TABLE
from sim_hil.jit import inlined
from sim_hil.rotor.film_law import Forces, Law, film_law
from sim_hil.rotor.film_slopes import film_point
from sim_hil.rotor.parameters import (
    FLOW,
    OIL,
    POWER,
    PRESSURE,
    Eight,
    FilmOil,
    FilmParameters,
    Floats,
)

LEAST_FED = 0.5
"""Share of the film that draws its oil itself from a feed without pressure."""


@inlined
def oil_now(film: FilmParameters, scalar: Floats) -> FilmOil:
    """The oil at its present temperature and supply."""
    fed = 1.0
    if film.pressure_needed > 0.0:
        fed = min(1.0, max(LEAST_FED, scalar[PRESSURE] / film.pressure_needed))
    filled = film.share * fed
    law = exp_of(-film.viscosity_slope * (scalar[OIL] - film.reference_C))
    bears = filled * filled * math.sqrt(filled)  # filled^2.5
    return FilmOil(film.viscosity * law, filled, bears, scalar[PRESSURE])


@inlined
def heat_oil(film: FilmParameters, scalar: Floats, dt: float) -> None:
    """One-node oil temperature: ``C dT/dt = P - rho c_p (Q_jacket + Q_side) (T - T_inlet)``."""
    carried = film.heat_capacity_per_m3 * (film.jacket_flow + max(0.0, scalar[FLOW]))
    flow_C = scalar[OIL] - film.inlet_C
    scalar[OIL] += film.thermal * dt * (scalar[POWER] - carried * flow_C) / film.thermal_capacity


@inlined
def gap(film: FilmParameters, ex: float, ey: float, c: float) -> float:
    """Smallest film, m, of a journal at ``(ex, ey)`` from the middle of the unworn bore."""
    y = ey + film.drop
    if film.pads > 0.0:
        least: float = pad_gap(
            int(film.pads),
            film.pad_angle,
            film.pad_half_arc,
            film.pad_shift,
            film.pad_nearest,
            ex / c,
            y / c,
        )[0]
        return c * least
    return c - math.sqrt(ex * ex + y * y)


@inlined
def bearing_force(
    law: Law,
    film: FilmParameters,
    oil: FilmOil,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    c_rate: float,
) -> Forces:
    """Force (fx, fy), N, friction torque, N m, and side flow, m3/s; arguments as `table_force`."""
    y, r = ey + film.drop, film.radius
    force = film_law(
        law, ex, y, vx, vy, omega, c, oil.viscosity * oil.bears, r, film.length, c_rate, oil.supply
    )
    filled: Forces = _filled(film, oil, force, ex, y, omega, c)
    return filled


@inlined
def bearing_point(
    law: Law,
    film: FilmParameters,
    oil: FilmOil,
    held: Eight,
    fresh: bool,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    c_rate: float,
) -> tuple[Forces, Eight]:
    """What :func:`bearing_force` gives, and the slopes of the force as ``film_point`` says."""
    y, r, mu = ey + film.drop, film.radius, oil.viscosity * oil.bears
    force, slopes = film_point(
        law, held, fresh, ex, y, vx, vy, omega, c, mu, r, film.length, c_rate, oil.supply
    )
    return _filled(film, oil, force, ex, y, omega, c), slopes


@inlined
def _filled(
    film: FilmParameters, oil: FilmOil, force: Forces, ex: float, y: float, omega: float, c: float
) -> Forces:
    """The film's forces with the friction and the outflow of a band that is not filled."""
    fx, fy, torque, flow = force
    if oil.filled != 1.0:
        r = film.radius
        eps = min(math.sqrt(ex * ex + y * y) / c, EPS_TABLE)
        shear = (
            2
            * math.pi
            * oil.viscosity
            * abs(omega)
            * r
            * r
            * r
            * film.length
            / (c * math.sqrt(1 - eps * eps))
        )
        torque += (oil.filled - oil.bears) * shear
    return fx, fy, torque, flow * oil.filled
