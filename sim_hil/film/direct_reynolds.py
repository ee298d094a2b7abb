"""The direct film with Reynolds rupture, callable from other compiled kernels: the check of what
the table says.

Solver and scales are those of `solver`, on one half of an even mesh: the pressure is found at each
call by the active set method, which starts from where the film was ruptured at the call before.
"""

import math
from typing import NamedTuple

import numpy as np

from sim_hil.jit import allocating

from .mesh import build_mesh
from .records import Floats
from .solver import around_conductance, axial_conductance, solve_pressure


class ReynoldsLaw(NamedTuple):
    """Mesh and memory of the film; `ruptured` (theta, z) is written and belongs to one thread.

    `ring` holds cos and sin at the stations and at the faces after them, shape (4, theta); `z_gap`,
    `z_width` and `z_weight` the axial mesh of one half, in journal radii; `fixed` the nodes at the
    end. The side flow is taken from the `table`.
    """

    ring: Floats
    z_gap: Floats
    z_width: Floats
    z_weight: Floats
    fixed: np.ndarray
    ruptured: np.ndarray
    table: Floats

    @classmethod
    def make(
        cls, table: Floats, length_over_diameter: float, stations: int = 48, intervals: int = 10
    ) -> "ReynoldsLaw":
        """A film with that many stations around and intervals along the whole length."""
        mesh = build_mesh(
            radius_m=1.0,
            length_m=2 * length_over_diameter,
            feed=(),
            end_pressure_Pa=(0.0, 0.0),
            nodes=(stations, intervals),
            hmax_rad=0.0,
            eccentricity_ratio=0.0,
            inlet_Pa=None,
        )
        theta, face = mesh.theta, mesh.theta_face
        ring = np.array([np.cos(theta), np.sin(theta), np.cos(face), np.sin(face)])
        ruptured = np.zeros(mesh.fixed.shape, np.bool_)
        return cls(ring, mesh.z_gap, mesh.z_width, mesh.z_weight, mesh.fixed, ruptured, table)


@allocating
def reynolds_force(
    law: ReynoldsLaw,
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
) -> tuple[float, float, float]:
    """Force on the journal (fx, fy), N, and braking friction torque, N m; arguments as
    `table_force`.

    The eccentricity must be below the clearance. No pressure at all where the rupture does not
    settle.
    """
    n, m = law.fixed.shape
    gap = 2 * math.pi / n
    chord = 2 * math.sin(gap / 2)  # integral of the cosine over a cell, over its middle value
    x, y = ex / c, ey / c
    sx, sy = (vx + 0.5 * omega * ey) / c, (vy - 0.5 * omega * ex) / c
    around = around_conductance(
        1.0 - x * law.ring[2] - y * law.ring[3], np.full(n, gap), law.z_width
    )
    axial = axial_conductance(1.0 - x * law.ring[0] - y * law.ring[1], np.full(n, gap), law.z_gap)
    rate = (sx * law.ring[0] + sy * law.ring[1]) * chord - c_rate / c * gap
    supply = rate.reshape(-1, 1) * law.z_width.reshape(1, -1)
    p = np.zeros((n, m))
    if not solve_pressure(p, law.fixed, around, axial, supply, 0.0, law.ruptured, True):
        law.ruptured[:] = False
        p[:] = 0.0
    fx = fy = 0.0
    for i in range(n):
        line = 0.0
        for j in range(m):
            line += p[i, j] * law.z_weight[j]
        fx -= line * law.ring[0, i]
        fy -= line * law.ring[1, i]
    scale = 24 * mu * (R / c) ** 2 * R * R * chord
    fx *= scale
    fy *= scale
    sense = -1.0 if omega < 0 else 1.0
    shear = 2 * math.pi * mu * abs(omega) * R * R * R * L / (c * math.sqrt(1 - x * x - y * y))
    return fx, fy, shear + sense * 0.5 * (ex * fy - ey * fx)
