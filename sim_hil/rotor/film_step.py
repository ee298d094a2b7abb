"""What film and contact add within a step of the machine: linearly implicit, in two ways.

In running the slopes ``J = dF/dw`` of the film force on the journal's velocity ``w`` against the
housing are held over a sampling period and the force is taken near the middle of the step, ``dF =
theta J dw`` (second order).

That fails where the film is not smooth over a step.  A ruptured film resists approach up to 10^4
times more than retreat, and at standstill, where nothing but ``w`` squeezes it, slopes held from a
retreating journal throw an approaching one through the wall.  The same holds near contact, and for
a journal that crosses its gap in a step. There the slopes are fresh, include position (``K =
dF/de``, the contact's stiffness with it), and the step is linearly implicit Euler (Hairer and
Wanner, Solving ODEs II, IV.7), ``dF = J dw + dt K (w + dw)``: first order, damped at any stiffness.
"""

from __future__ import annotations

import math

from sim_hil.jit import inlined, kernel
from sim_hil.rotor.bearing import bearing_force, gap
from sim_hil.rotor.film_law import Forces, Law
from sim_hil.rotor.kernel import relative
from sim_hil.rotor.parameters import Eight, FilmOil, FilmParameters, Plant, Six, State

THETA = 0.55
"""Share of the new velocity in the film force: 1/2 is centred, a little more damps the stiffest
modes."""
NEAR_CONTACT = 0.02
"""Gap, relative to the clearance, below which a step is Euler's."""
_TURNED_SHARE = 0.5
_CROSSED_SHARE = 0.5


@kernel
def film_slopes(
    law: Law,
    film: FilmParameters,
    oil: FilmOil,
    f0: Forces,
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    c_rate: float,
) -> Eight:
    """Forward differences of the film force from ``f0``, the force there: dF/de (xx, xy, yx, yy),
    then dF/dv."""
    de = 1e-5 * max(gap(film, ex, ey, c), 0.01 * c)
    dv = 1e-4 * (c * abs(omega) + abs(vx) + abs(vy)) + 1e-9
    f1 = bearing_force(law, film, oil, ex + de, ey, vx, vy, omega, c, c_rate)
    f2 = bearing_force(law, film, oil, ex, ey + de, vx, vy, omega, c, c_rate)
    f3 = bearing_force(law, film, oil, ex, ey, vx + dv, vy, omega, c, c_rate)
    f4 = bearing_force(law, film, oil, ex, ey, vx, vy + dv, omega, c, c_rate)
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


@inlined
def crossing(film: float, wx: float, wy: float, c: float, dt: float) -> bool:
    """Whether the journal is near contact, or crosses its smallest ``film`` within a step."""
    return film <= NEAR_CONTACT * c or math.sqrt(wx * wx + wy * wy) * dt >= _CROSSED_SHARE * film


@inlined
def turned(sx: float, sy: float, held_x: float, held_y: float) -> bool:
    """Whether the squeeze velocity is no longer the one of the held slopes."""
    dx, dy = sx - held_x, sy - held_y
    return dx * dx + dy * dy >= _TURNED_SHARE * _TURNED_SHARE * (held_x * held_x + held_y * held_y)


@inlined
def film_reaction(
    plant: Plant,
    st: State,
    law: Law,
    renew: bool,
    omega: float,
    c: float,
    c_rate: float,
    oil: FilmOil,
    dt: float,
) -> Six:
    """``G`` (xx, xy, yx, yy), N s/m, and ``r`` (x, y), N, of ``dF = G dw + r`` over the step to
    come.

    ``renew`` takes fresh slopes, kept in ``st.film`` with the squeeze velocity that they belong to.
    """
    held = st.film
    ex, ey = relative(plant, st.q)
    wx, wy = relative(plant, st.v)
    sx, sy = wx + 0.5 * omega * ey, wy - 0.5 * omega * ex
    smooth = not crossing(gap(plant.film, ex, ey, c), wx, wy, c, dt) and not turned(
        sx, sy, held[4], held[5]
    )
    kxx = kxy = kyx = kyy = 0.0
    if renew or not smooth:
        force = bearing_force(law, plant.film, oil, ex, ey, wx, wy, omega, c, c_rate)
        slopes = film_slopes(law, plant.film, oil, force, ex, ey, wx, wy, omega, c, c_rate)
        kxx, kxy, kyx, kyy, held[0], held[1], held[2], held[3] = slopes
        held[4], held[5] = sx, sy
    if smooth:
        return THETA * held[0], THETA * held[1], THETA * held[2], THETA * held[3], 0.0, 0.0
    gxx, gxy, gyx, gyy = (
        held[0] + dt * kxx,
        held[1] + dt * kxy,
        held[2] + dt * kyx,
        held[3] + dt * kyy,
    )
    return gxx, gxy, gyx, gyy, dt * (kxx * wx + kxy * wy), dt * (kyx * wx + kyy * wy)
