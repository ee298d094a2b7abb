"""Rub: the shaft touches a ring of the stator that stands out of line.

The ring has the radial gap ``g0`` and leaves the gap ``g`` above where the shaft ran before, so
that its middle is ``g0 - g`` below there.  Where the shaft at distance ``e`` from that middle goes
deeper than the gap,

    N = k (e - g0),   friction mu N against the sliding of the shaft's surface,  v_s = R omega + v_t

linear contact with Coulomb friction (Muszynska, Partial Physical Contact..., 1989; Choy and
Padovan, J. Sound Vib. 113, 1987).  Contact over a part of the orbit truncates the wave (orders 2,
3, ...; fractions where it skips turns); the friction drives backward whirl and brakes the shaft.
"""

from __future__ import annotations

import math

from sim_hil.jit import inlined
from sim_hil.rotor.parameters import Excite

_SLIDING_M_S = 1e-3
"""Friction is full well above this speed, and passes smoothly through zero below."""


@inlined
def rub_force(
    excite: Excite, dx: float, dy: float, vx: float, vy: float, surface: float
) -> tuple[float, float, float]:
    """Force (x, y) on the shaft and its braking friction, N.

    Parameters
    ----------
    dx, dy, vx, vy
        Shaft against where it ran before, m, and its velocity, m/s.
    surface
        Speed of the shaft's surface, ``R omega``, m/s.
    """
    y = dy + excite.rub_clearance - excite.rub_gap
    e = math.hypot(dx, y)
    depth = e - excite.rub_clearance
    if excite.rub_stiffness <= 0.0 or depth <= 0.0:
        return 0.0, 0.0, 0.0
    nx, ny = dx / e, y / e
    normal = excite.rub_stiffness * depth
    sliding = surface + (nx * vy - ny * vx)
    drag = excite.rub_friction * normal * sliding / math.hypot(sliding, _SLIDING_M_S)
    return -normal * nx + drag * ny, -normal * ny - drag * nx, drag
