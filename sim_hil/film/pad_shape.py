"""Fixed pads in compiled code: smallest film, reach and shear, all over the clearance.

The gap of a pad whose centre is shifted by `s` from that of the bearing, with the journal at
`(x, y)`, is `1 + s - |s + (x, y)| cos(t - t_0)`: one circle in another.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_hil.jit import inlined, kernel


class PadShape(NamedTuple):
    """Numbers of a `PadBore`: pads (0: a round bore), middle of the first, half arc, shift, and how
    far from its middle each stands nearest."""

    pads: int
    angle: float
    half_arc: float
    shift: float
    nearest: float


@kernel
def pad_gap(
    count: int, angle: float, half_arc: float, shift: float, nearest: float, x: float, y: float
) -> tuple[float, float, float]:
    """Smallest film over clearance with the journal at (x, y) over clearance, and its direction."""
    least, least_x, least_y = 1e30, 1.0, 0.0
    for k in range(count):
        middle = angle + 2 * math.pi * k / count
        at = middle + nearest
        sx, sy = shift * math.cos(at) + x, shift * math.sin(at) + y
        far = math.sqrt(sx * sx + sy * sy)
        away = math.atan2(sy, sx) - middle
        away -= 2 * math.pi * math.floor(away / (2 * math.pi) + 0.5)
        lean = min(max(away, -half_arc), half_arc)
        for end in (lean, -half_arc, half_arc):
            film = 1.0 + shift - far * math.cos(end - away)
            if film < least:
                least, least_x, least_y = film, math.cos(middle + end), math.sin(middle + end)
    return least, least_x, least_y


@kernel
def pad_reach(
    count: int, angle: float, half_arc: float, shift: float, nearest: float, ux: float, uy: float
) -> float:
    """How far the journal goes in the direction (ux, uy) until it touches, over the clearance."""
    reach, outer = 1e30, 1.0 + shift
    for k in range(count):
        middle = angle + 2 * math.pi * k / count
        at = middle + nearest
        sx, sy = shift * math.cos(at), shift * math.sin(at)
        along = sx * ux + sy * uy
        far = -along + math.sqrt(max(0.0, along * along - shift * shift + outer * outer))
        px, py = sx + far * ux, sy + far * uy
        if px * math.cos(middle) + py * math.sin(middle) >= outer * math.cos(half_arc):
            reach = min(reach, far)
        for end in (middle - half_arc, middle + half_arc):
            ex, ey = math.cos(end), math.sin(end)
            towards = ux * ex + uy * ey
            if towards > 1e-9:
                reach = min(reach, (outer - sx * ex - sy * ey) / towards)
    return reach


@kernel
def pad_shear(
    count: int, angle: float, half_arc: float, shift: float, nearest: float, x: float, y: float
) -> float:
    """Integral of the clearance over the film around all pads, in closed form (Sommerfeld)."""
    total, outer = 0.0, 1.0 + shift
    for k in range(count):
        middle = angle + 2 * math.pi * k / count
        at = middle + nearest
        sx, sy = shift * math.cos(at) + x, shift * math.sin(at) + y
        far = math.sqrt(sx * sx + sy * sy)
        away = middle - math.atan2(sy, sx)
        away -= 2 * math.pi * math.floor(away / (2 * math.pi) + 0.5)
        total += _turned(outer, far, away + half_arc) - _turned(outer, far, away - half_arc)
    return total


@inlined
def _turned(outer: float, far: float, angle: float) -> float:
    """Antiderivative of 1 / (outer - far cos(angle)) over one turn."""
    square = outer * outer - far * far
    turns = math.floor(angle / (2 * math.pi) + 0.5)
    half = math.tan(0.5 * (angle - 2 * math.pi * turns))
    if square > 1e-12:
        root = math.sqrt(square)
        value: float = (2 * math.atan((outer + far) / root * half) + 2 * math.pi * turns) / root
        return value
    root = math.sqrt(max(-square, 1e-12))
    up, down = (outer + far) * half - root, (outer + far) * half + root
    return math.log(max(abs(up), 1e-300) / max(abs(down), 1e-300)) / root
