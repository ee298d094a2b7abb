"""Force of a film with its slopes by the journal's place and velocity, chosen by type as
:mod:`sim_hil.rotor.film_law`."""

from __future__ import annotations

import math

import numpy as np
from numba import types
from numba.extending import overload

from sim_hil.film.table_kernel import EPS_TABLE, table_force, table_slopes
from sim_hil.jit import kernel
from sim_hil.rotor.film_law import Forces, Law, film_law
from sim_hil.rotor.parameters import Eight


def knows_slopes(law: Law) -> bool:
    """Whether the slopes of the film cost little; known when a kernel is compiled."""
    return isinstance(law, np.ndarray)


@overload(knows_slopes)
def _knows_slopes(law):  # type: ignore[no-untyped-def]
    return (lambda law: True) if isinstance(law, types.Array) else (lambda law: False)


@kernel
def law_slopes(
    law: Law,
    f0: Forces,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    mu: float,
    R: float,
    L: float,
    c_rate: float,
    supply_Pa: float,
) -> Eight:
    """Forward differences of the film force from ``f0``, the force there: dF/de (xx, xy, yx, yy),
    N/m, then dF/dv, N s/m."""
    de = 1e-5 * max(c - math.sqrt(ex * ex + ey * ey), 0.01 * c)
    dv = 1e-4 * (c * abs(omega) + abs(vx) + abs(vy)) + 1e-9
    f1 = film_law(law, ex + de, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    f2 = film_law(law, ex, ey + de, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    f3 = film_law(law, ex, ey, vx + dv, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    f4 = film_law(law, ex, ey, vx, vy + dv, omega, c, mu, R, L, c_rate, supply_Pa)
    return (
        (f1[0] - f0[0]) / de,
        (f2[0] - f0[0]) / de,
        (f1[1] - f0[1]) / de,
        (f2[1] - f0[1]) / de,
        (f3[0] - f0[0]) / dv,
        (f4[0] - f0[0]) / dv,
        (f3[1] - f0[1]) / dv,
        (f4[1] - f0[1]) / dv,
    )


def film_point(
    law: Law,
    held: Eight,
    fresh: bool,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    mu: float,
    R: float,
    L: float,
    c_rate: float,
    supply_Pa: float,
) -> tuple[Forces, Eight]:
    """What :func:`film_law` gives, and its slopes as :func:`law_slopes`.

    The table knows its slopes within EPS_TABLE; others cost four more forces.  The slopes ``held``
    are given back unless ``fresh``.
    """
    force = film_law(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    return force, law_slopes(law, force, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)


@overload(film_point, jit_options={"forceinline": True})
def _film_point(  # type: ignore[no-untyped-def]
    law, held, fresh, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa
):
    def tabulated(  # type: ignore[no-untyped-def]
        law, held, fresh, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa
    ):
        inside = ex * ex + ey * ey < EPS_TABLE * EPS_TABLE * c * c
        if inside and fresh:
            return table_slopes(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)
        force = table_force(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)
        if inside:
            return force, held
        return force, law_slopes(law, force, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)

    def other(  # type: ignore[no-untyped-def]
        law, held, fresh, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa
    ):
        force = film_law(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
        if fresh:
            held = law_slopes(law, force, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
        return force, held

    return tabulated if isinstance(law, types.Array) else other
