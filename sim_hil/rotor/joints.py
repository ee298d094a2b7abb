"""Bolted feet: bilinear contact with preload and gap, and dry friction along the joint.

Normal force of bolt ``i`` on the body for its lift ``u`` (up positive), preload (clamp) ``P``,
contact stiffness ``k``, gap ``g`` and bolt stiffness ``k_b``::

    N(u) = -k u                       u <= P / k         clamped: contact and bolt, one spring
         = -P                         P / k < u < P/k+g  lifted off, bolt head not yet reached
         = -P - k_b (u - P / k - g)   above              the bolt stops the lift: impact

With lost preload (``P = 0``) only weight holds the foot down.  Along the joint a Jenkins element
(spring ``k_t`` in series with a Coulomb slider ``mu max(0, P - k u)``) sticks or slips.  Source:
bilinear looseness after Goldman and Muszynska (J. Eng. Gas Turbines Power 113, 1991); Jenkins
element after Iwan.
"""

from __future__ import annotations

from sim_hil.jit import inlined
from sim_hil.rotor.parameters import Floats, Foot


@inlined
def normal_force(
    lift: float, stiffness: float, clamp: float, gap: float, bolt_stiffness: float
) -> float:
    """Force on the body, N, for a lift in m (see the module)."""
    opening = lift - clamp / stiffness
    if opening <= 0.0:
        return -stiffness * lift
    return -clamp - bolt_stiffness * max(0.0, opening - gap)


@inlined
def foot_forces(
    foot: Foot,
    x: float,
    y: float,
    roll: float,
    vx: float,
    vy: float,
    v_roll: float,
    slip: Floats,
    first: int,
) -> tuple[float, float, float]:
    """Force (x, y) and moment of the four feet on the body; ``slip[first:first+4]`` is updated.

    The roll turns the feet at ``(x_i, -depth)`` by ``(depth roll, x_i roll)``.
    """
    fx = fy = moment = 0.0
    shift = x + foot.depth * roll
    v_shift = vx + foot.depth * v_roll
    for i in range(4):
        k = foot.stiffness[i]
        lift = y + foot.x[i] * roll
        normal = normal_force(lift, k, foot.clamp[i], foot.gap[i], foot.bolt_stiffness)
        pressing = max(0.0, foot.clamp[i] - k * lift)
        tangential = 0.0
        if pressing > 0.0:
            normal -= foot.damping[i] * (vy + foot.x[i] * v_roll)
            k_t = foot.tangential_share * k
            limit = foot.friction * pressing
            tangential = -k_t * (shift - slip[first + i])
            if tangential > limit:
                slip[first + i] = shift + limit / k_t
                tangential = limit
            elif tangential < -limit:
                slip[first + i] = shift - limit / k_t
                tangential = -limit
            else:
                tangential -= foot.tangential_share * foot.damping[i] * v_shift
        else:
            slip[first + i] = shift
        fx += tangential
        fy += normal
        moment += foot.x[i] * normal + foot.depth * tangential
    return fx, fy, moment
