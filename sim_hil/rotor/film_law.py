"""One call for the film force, whatever stands behind it; chosen by type when a kernel is compiled.

A law is the coefficient array of a `FilmTable`, a `FedLaw`, a `PadLaw`, a `PortLaw`, a
`DirectLaw`, a `ReynoldsLaw`, a `LinearLaw`, or a network of `network_law`. The supply pressure
counts for the `FedLaw` and the `PortLaw` alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from sim_hil.film.direct import DirectFilm, direct_force
from sim_hil.film.direct_reynolds import ReynoldsLaw, reynolds_force
from sim_hil.film.fed_kernel import FedLaw, fed_force
from sim_hil.film.pad_kernel import PadLaw, pad_force
from sim_hil.film.port_kernel import PortLaw, port_force
from sim_hil.film.table_kernel import (
    EPS_TABLE,
    contact_force,
    lookup,
    table_force,
)
from sim_hil.jit import inlined, kernel
from sim_hil.rotor.network_law import RawNetworkLaw, ReducedNetworkLaw, raw_forces, reduced_forces
from sim_hil.rotor.parameters import Floats

Forces = tuple[float, float, float, float]


class DirectLaw(NamedTuple):
    """The Guembel film solved at each call (`DirectFilm`); `work` belongs to one thread.

    The direct film has no side flow of its own: it is taken from the table.
    """

    ring: Floats
    axial: Floats
    work: Floats
    table: Floats

    @classmethod
    def make(cls, table: Floats, stations: int = 64, modes: int = 4) -> DirectLaw:
        """A law with that many stations around and cosine modes along."""
        film = DirectFilm.make(stations, modes)
        return cls(film.ring, film.axial, film.work, table)


class LinearLaw(NamedTuple):
    """Springs and dampers around one equilibrium: `F = F0 - K (e - e0) - C v`, in x and y, SI."""

    x: float
    y: float
    fx: float
    fy: float
    kxx: float
    kxy: float
    kyx: float
    kyy: float
    cxx: float
    cxy: float
    cyx: float
    cyy: float

    @classmethod
    def of(
        cls, rest: tuple[Floats, Floats], stiffness_N_m: Floats, damping_N_s_m: Floats
    ) -> LinearLaw:
        """The law around `rest`: position, m, and force there, N; K and C along x and y, shape (2,
        2)."""
        numbers = np.concatenate([*rest, np.ravel(stiffness_N_m), np.ravel(damping_N_s_m)])
        return cls._make(numbers.tolist())


Law = (
    Floats
    | FedLaw
    | PadLaw
    | PortLaw
    | DirectLaw
    | ReynoldsLaw
    | LinearLaw
    | ReducedNetworkLaw
    | RawNetworkLaw
)


@kernel
def _held_inside(ex: float, ey: float, c: float) -> tuple[float, float]:
    """The eccentricity, not beyond EPS_TABLE."""
    share = EPS_TABLE * c / max(math.hypot(ex, ey), EPS_TABLE * c)
    return ex * share, ey * share


@kernel
def _direct(
    law: DirectLaw,
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
) -> Forces:
    x, y = _held_inside(ex, ey, c)
    fx, fy, torque = direct_force(
        law.ring, law.axial, law.work, x, y, vx, vy, omega, c, mu, R, L, c_rate
    )
    forces: Forces = _touching(law.table, (fx, fy, torque), ex, ey, vx, vy, omega, c, R)
    return forces


@kernel
def _reynolds(
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
) -> Forces:
    x, y = _held_inside(ex, ey, c)
    film = reynolds_force(law, x, y, vx, vy, omega, c, mu, R, L, c_rate)
    forces: Forces = _touching(law.table, film, ex, ey, vx, vy, omega, c, R)
    return forces


@kernel
def _touching(
    table: Floats,
    film: tuple[float, float, float],
    ex: float,
    ey: float,
    vx: float,
    vy: float,
    omega: float,
    c: float,
    R: float,
) -> Forces:
    """A solved film with the contact, and the side flow of the table."""
    x, y = _held_inside(ex, ey, c)
    sx, sy = vx + 0.5 * omega * y, vy - 0.5 * omega * x
    squeeze = math.hypot(sx, sy)
    gamma = math.atan2(abs(x * sy - y * sx), x * sx + y * sy)
    flow = R * R * squeeze * lookup(table, math.hypot(x, y) / c, gamma)[2]
    contact_x, contact_y, rub = contact_force(ex, ey, omega, c)
    return film[0] + contact_x, film[1] + contact_y, film[2] + rub * R, flow


@kernel
def _linear(
    law: LinearLaw,
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
) -> Forces:
    dx, dy = ex - law.x, ey - law.y
    fx = law.fx - law.kxx * dx - law.kxy * dy - law.cxx * vx - law.cxy * vy
    fy = law.fy - law.kyx * dx - law.kyy * dy - law.cyx * vx - law.cyy * vy
    x, y = _held_inside(ex, ey, c)
    shear = (
        2
        * math.pi
        * mu
        * abs(omega)
        * R
        * R
        * R
        * L
        / (c * math.sqrt(1 - (x * x + y * y) / (c * c)))
    )
    sense = -1.0 if omega < 0 else 1.0
    return fx, fy, shear + sense * 0.5 * (ex * fy - ey * fx), 0.0


@inlined
def _tabulated(
    law: Floats,
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
) -> Forces:
    forces: Forces = table_force(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)
    return forces


@kernel
def _fed(
    law: FedLaw,
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
) -> Forces:
    fx, fy, torque, flow, _ = fed_force(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    return fx, fy, torque, flow


@kernel
def _ported(
    law: PortLaw,
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
) -> Forces:
    forces: Forces = port_force(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    return forces


_FED = {FedLaw: _fed, PortLaw: _ported}
_KERNELS = {
    DirectLaw: _direct,
    ReynoldsLaw: _reynolds,
    LinearLaw: _linear,
    PadLaw: pad_force,
    ReducedNetworkLaw: reduced_forces,
    RawNetworkLaw: raw_forces,
}


def film_law(
    law: Law,
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
    supply_Pa: float = 0.0,
) -> Forces:
    """Force (fx, fy), N, friction torque, N m, and side flow, m3/s; arguments as `table_force` and
    `fed_force`."""
    forces: Forces
    if isinstance(law, FedLaw | PortLaw):
        chosen = _FED[type(law)]
        forces = chosen(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)
    else:
        forces = _of_type(type(law))(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)
    return forces


def _of_type(kind: type) -> Callable[..., Forces]:
    chosen: Callable[..., Forces] = _KERNELS.get(kind, _tabulated)
    return chosen


@overload(film_law, jit_options={"forceinline": True})
def _film_law(  # type: ignore[no-untyped-def]
    law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa=0.0
):
    kind = law.instance_class if isinstance(law, types.BaseNamedTuple) else type(law)
    chosen = _of_type(kind)
    with_supply: Callable[..., Forces] = _FED.get(kind, _fed)

    def forces(  # type: ignore[no-untyped-def]
        law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa=0.0
    ):
        return chosen(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate)

    def fed(  # type: ignore[no-untyped-def]
        law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa=0.0
    ):
        return with_supply(law, ex, ey, vx, vy, omega, c, mu, R, L, c_rate, supply_Pa)

    return fed if kind in _FED else forces
