"""Where a rotor out of balance begins to whirl: earlier than its linear threshold says.

The unbalance shakes the film once a turn, twice in each turn of the whirl, and feeds it as any
swing whose support is shaken at twice its frequency is fed.  A rigid rotor on two such films is
followed in time.
"""

from __future__ import annotations

import math

import numpy as np

from sim_hil.jit import kernel

from .equilibrium import equilibrium
from .records import Floats
from .table import FilmTable
from .table_kernel import table_force

_RADIUS_M, _SPEED, _CLEARANCE_M, _VISCOSITY = 0.02, 600.0, 60e-6, 0.01
"""Of no consequence: the answer has no dimension."""

_TURNS, _STEPS_A_TURN = 800, 100
_SWING_SHARE, _APART_SHARE = 0.45, 0.1
_NARROWEST, _WIDEST, _FINENESS = 0.60, 1.0, 0.01


def onset_share(table: FilmTable, eccentricity: float, unbalance_share: float) -> float:
    """Widest clearance without whirl over that of the linear threshold, one at most, to 0.01.

    Parameters
    ----------
    table
        The film.
    eccentricity
        Of the journal at rest in the clearance of the linear threshold.
    unbalance_share
        Turning force of the unbalance over the static load, ``U w^2 / W``.

    Notes
    -----
    It whirls where an orbit still fills a good part of the clearance after 800 turns and every
    second turn differs from the one before; one that fills it turn by turn the same is that of the
    unbalance alone.
    """
    length_m = 2 * _RADIUS_M * table.length_over_diameter
    rest = equilibrium(
        eccentricity_ratio=eccentricity,
        radius_m=_RADIUS_M,
        length_m=length_m,
        clearance_m=_CLEARANCE_M,
        viscosity_Pa_s=_VISCOSITY,
        speed_rad_s=_SPEED,
    )
    if math.isnan(rest.threshold):
        return _WIDEST
    mass = rest.threshold**2 * rest.load_N / (_CLEARANCE_M * _SPEED**2)
    for share in np.arange(_NARROWEST, _WIDEST + 0.5 * _FINENESS, _FINENESS).tolist():
        swing, apart = _orbit(
            table.coefficients,
            _VISCOSITY,
            mass,
            rest.load_N,
            unbalance_share * rest.load_N,
            share * _CLEARANCE_M,
            length_m,
            rest.position_m,
        )
        if swing > _SWING_SHARE and apart > _APART_SHARE:
            return float(share - _FINENESS)
    return _WIDEST


@kernel
def _orbit(
    coefficients: Floats,
    viscosity: float,
    mass: float,
    load: float,
    shaking: float,
    clearance: float,
    length: float,
    start: Floats,
) -> tuple[float, float]:
    """Peak-to-peak of the last tenth of the turns, and the most that one turn ends from where the
    last did, in clearances; by the midpoint rule."""
    x, y, vx, vy = start[0], start[1], 0.0, 0.0
    step = 2 * math.pi / (_SPEED * _STEPS_A_TURN)
    left, right, low, high = math.inf, -math.inf, math.inf, -math.inf
    apart, before_x, before_y = 0.0, x, y
    for turn in range(_TURNS):
        judged = turn >= _TURNS - _TURNS // 10
        for i in range(_STEPS_A_TURN):
            angle = 2 * math.pi * i / _STEPS_A_TURN
            fx, fy, _, _ = table_force(
                coefficients, x, y, vx, vy, _SPEED, clearance, viscosity, _RADIUS_M, length
            )
            ax, ay = (
                (fx + shaking * math.cos(angle)) / mass,
                (fy + shaking * math.sin(angle) - load) / mass,
            )
            mid_x, mid_y, mid_vx, mid_vy = (
                x + 0.5 * step * vx,
                y + 0.5 * step * vy,
                vx + 0.5 * step * ax,
                vy + 0.5 * step * ay,
            )
            angle += math.pi / _STEPS_A_TURN
            fx, fy, _, _ = table_force(
                coefficients,
                mid_x,
                mid_y,
                mid_vx,
                mid_vy,
                _SPEED,
                clearance,
                viscosity,
                _RADIUS_M,
                length,
            )
            vx += step * (fx + shaking * math.cos(angle)) / mass
            vy += step * (fy + shaking * math.sin(angle) - load) / mass
            x, y = x + step * mid_vx, y + step * mid_vy
            if judged:
                left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
        if judged:
            apart = max(apart, math.hypot(x - before_x, y - before_y))
        before_x, before_y = x, y
    return max(right - left, high - low) / clearance, apart / clearance
