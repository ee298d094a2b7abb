"""The film within a step of the machine: taken in the middle of the step, linear about a forecast.

The mean velocity of the journal over the step is forecast from its last acceleration, the force and
its slopes ``K = dF/de``, ``C = dF/dw`` on the journal's place and velocity against the housing are
evaluated there, and what the forecast missed is solved for linearly.  The forecast is right to
second order, so that what the film's curvature adds is of fourth: one film a step gives an accurate
midpoint rule.  Where the squeeze of the answer has turned against that of the forecast the film is
evaluated once more at the answer (Newton): a ruptured film resists approach up to 10^4 times more
than retreat, and slopes of a retreating journal would throw an approaching one through the wall.

In contact, and for a journal that crosses its gap in a step, the film is not smooth over a step:
there the step is linearly implicit Euler (Hairer and Wanner, Solving ODEs II, IV.7), ``dF = C dw +
dt K (w + dw)``: first order, damped at any stiffness.
"""

from __future__ import annotations

from sim_hil.jit import inlined
from sim_hil.rotor.bearing import bearing_point, gap
from sim_hil.rotor.film_law import Forces, Law
from sim_hil.rotor.parameters import Eight, FilmOil, FilmParameters, Four, Two

NEAR_CONTACT = 0.01
"""Gap, relative to the clearance, below which a step is Euler's."""
NEWTON = 4
"""Evaluations of the film in a step at most."""
_TURNED_SHARE = 0.1
"""Share by which the squeeze velocity may differ from that for which the slopes were taken."""
_STALE_SHARE = 0.1
"""Share of that from which on slopes are not kept for the next step."""
_CROSSED_SHARE = 0.5


@inlined
def near(film: FilmParameters, ex: float, ey: float, c: float) -> bool:
    """Whether a journal at ``(ex, ey)`` is in contact."""
    if film.pads > 0.0:
        thin: bool = gap(film, ex, ey, c) <= NEAR_CONTACT * c
        return thin
    y, reach = ey + film.drop, (1.0 - NEAR_CONTACT) * c
    return ex * ex + y * y >= reach * reach


@inlined
def crossing(thin: float, ex: float, ey: float, wx: float, wy: float, c: float, dt: float) -> bool:
    """Whether the journal is in contact, or moves by half its smallest film ``thin`` outwards or
    inwards within a step."""
    along, half = (ex * wx + ey * wy) * dt, _CROSSED_SHARE * thin
    return thin <= NEAR_CONTACT * c or along * along >= half * half * (ex * ex + ey * ey)


@inlined
def linear_answer(
    force: Two,
    slopes: Eight,
    forecast: Two,
    at: Four,
    push: Two,
    mobility: Two,
    reach: float,
    rough: bool,
    dt: float,
) -> Four:
    """Force at the velocity that the linear film answers with, N, and how far that velocity is from
    its forecast, m/s: fx, fy, dx, dy.

    ``reach``: time over which the velocity moves the journal until the film counts, s.
    """
    kxx, kxy, kyx, kyy, cxx, cxy, cyx, cyy = slopes
    ux, uy = forecast
    fx, fy = force
    if rough:  # the film was evaluated at the start of the way
        fx += reach * (kxx * ux + kxy * uy)
        fy += reach * (kyx * ux + kyy * uy)
    span = dt if rough else 0.5 * dt
    mx, my = span * mobility[0], span * mobility[1]
    gxx, gxy, gyx, gyy = cxx + reach * kxx, cxy + reach * kxy, cyx + reach * kyx, cyy + reach * kyy
    rx, ry = at[2] - ux + span * push[0] + mx * fx, at[3] - uy + span * push[1] + my * fy
    axx, axy, ayx, ayy = 1 - mx * gxx, -mx * gxy, -my * gyx, 1 - my * gyy
    per = 1 / (axx * ayy - axy * ayx)
    dx, dy = (ayy * rx - axy * ry) * per, (axx * ry - ayx * rx) * per
    return fx + gxx * dx + gxy * dy, fy + gyx * dx + gyy * dy, dx, dy


@inlined
def meet_film(
    film: FilmParameters,
    law: Law,
    oil: FilmOil,
    held: Eight,
    fresh: bool,
    rough: bool,
    tries: int,
    at: Four,
    ahead: Two,
    push: Two,
    mobility: Two,
    back: float,
    omega: float,
    c: float,
    c_rate: float,
    dt: float,
) -> tuple[Forces, Four, Eight, bool]:
    """The film over a step of the journal.

    Parameters
    ----------
    held, fresh
        Slopes of an earlier step, and whether to take new ones.
    rough
        Whether the step is Euler's.
    tries
        Evaluations of the film at least.
    at, ahead, push
        Journal at the start; forecast of its mean velocity; acceleration without the film.
    mobility
        Acceleration of the journal against the housing by a unit force, in x and y, 1/kg.
    back
        Time from `at` to where the film counts, s: the middle of the step.

    Returns
    -------
    forces, mean, slopes, stale
        Forces of the film where it was evaluated last; mean force of the step, N, and the
        journal's velocity that it acted at; slopes of the film, and whether the next step needs
        new ones because the forecast of this one left them something to do.
    """
    ex, ey, ux, uy = at[0], at[1], ahead[0], ahead[1]
    reach, into = (dt, 0.0) if rough else (back, back)
    half = 0.5 * omega
    for i in range(NEWTON):
        x, y = ex + into * ux, ey + into * uy
        force, held = bearing_point(
            law, film, oil, held, fresh or i > 0, x, y, ux, uy, omega, c, c_rate
        )
        fx, fy, dx, dy = linear_answer(
            (force[0], force[1]), held, (ux, uy), at, push, mobility, reach, rough, dt
        )
        sx, sy = ux + half * y, uy - half * x
        turned_x, turned_y = dx + half * into * dy, dy - half * into * dx
        ux, uy = ux + dx, uy + dy
        allowed = _TURNED_SHARE * _TURNED_SHARE * (sx * sx + sy * sy)
        missed = turned_x * turned_x + turned_y * turned_y
        if i + 1 >= tries and (rough or missed < allowed):
            break
    return force, (fx, fy, ux, uy), held, missed >= _STALE_SHARE * _STALE_SHARE * allowed
