"""Film force of a finite-length plain journal bearing: the Reynolds equation with a rupture rule."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from . import solver
from .mesh import Mesh, build_mesh
from .records import (
    Couette,
    Feed,
    FilmArguments,
    FilmError,
    FilmForce,
    FilmMemory,
    FilmNotConverged,
    Floats,
    Inlet,
    JournalOutsideClearance,
    Rupture,
)

DEFAULT_GRID = (160, 20)
_THIN_FILM_LIMIT = 0.1


@dataclass(frozen=True)
class Bearing:
    """What stays while the journal moves; the fields are the keyword arguments of `film_force`."""

    radius_m: float
    length_m: float
    clearance_m: float
    viscosity_Pa_s: float
    speed_rad_s: float
    rupture: Rupture = "reynolds"
    inlet: Inlet = "periodic"
    feed: Sequence[Feed] = ()
    end_pressure_Pa: tuple[float, float] = (0.0, 0.0)
    cavitation_pressure_Pa: float = 0.0
    couette: Couette = "full"
    clearance_rate_m_s: float = 0.0
    grid: tuple[int, int] = DEFAULT_GRID

    def __post_init__(self) -> None:
        for name in ("radius_m", "length_m", "clearance_m", "viscosity_Pa_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise FilmError(f"{name} = {value}: must be finite and above zero")
        rest = (self.speed_rad_s, self.clearance_rate_m_s, self.cavitation_pressure_Pa, *self.end_pressure_Pa)
        if not np.all(np.isfinite(rest)):
            raise FilmError(f"speed, clearance rate and pressures must be finite, got {rest}")
        if self.clearance_m > _THIN_FILM_LIMIT * self.radius_m:
            raise FilmError(
                f"clearance_m = {self.clearance_m}: above {_THIN_FILM_LIMIT} x radius_m = {self.radius_m}, "
                "not a thin film; clearances are radial and in metres"
            )
        for name, choices in (("rupture", Rupture), ("inlet", Inlet), ("couette", Couette)):
            if getattr(self, name) not in get_args(choices):
                raise FilmError(f"{name} = {getattr(self, name)!r}: use one of {get_args(choices)}")
        lowest = min(*self.end_pressure_Pa, *(f.pressure_Pa for f in self.feed))
        if self.rupture != "full" and lowest < self.cavitation_pressure_Pa:
            raise FilmError(
                f"cavitation_pressure_Pa = {self.cavitation_pressure_Pa}: above a feed or end pressure ({lowest})"
            )
        if len(self.grid) != 2 or self.grid[0] < 12 or self.grid[1] < 6:
            raise FilmError(f"grid = {self.grid}: needs at least 12 nodes around and 6 intervals along")

    @classmethod
    def of(cls, arguments: FilmArguments) -> "Bearing":
        """The bearing that these arguments describe; the end pressures and feeds become tuples."""
        bearing = cls(**arguments)
        lower, upper = bearing.end_pressure_Pa
        return replace(bearing, feed=tuple(bearing.feed), end_pressure_Pa=(float(lower), float(upper)))

    @property
    def pressure_scale_Pa_s(self) -> float:
        """Pressure that belongs to a scaled pressure of 1/s (see `solver`)."""
        return 12 * self.viscosity_Pa_s * (self.radius_m / self.clearance_m) ** 2

    @property
    def inlet_pressure_Pa(self) -> float | None:
        """Pressure of the inlet line at the thickest film: that of the surroundings."""
        return sum(self.end_pressure_Pa) / 2 if self.inlet == "groove_hmax" else None


@dataclass(frozen=True)
class Film:
    """One solved film on its mesh; `pressure` is scaled, see `solver`."""

    mesh: Mesh
    thickness: Floats
    thickness_face: Floats
    pressure: Floats
    fill: Floats
    supply: Floats
    around: Floats
    axial: Floats


def film_force(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    *,
    radius_m: float,
    length_m: float,
    clearance_m: float,
    viscosity_Pa_s: float,
    speed_rad_s: float,
    rupture: Rupture = "reynolds",
    inlet: Inlet = "periodic",
    feed: Sequence[Feed] = (),
    end_pressure_Pa: tuple[float, float] = (0.0, 0.0),
    cavitation_pressure_Pa: float = 0.0,
    couette: Couette = "full",
    clearance_rate_m_s: float = 0.0,
    memory: FilmMemory | None = None,
    fields: bool = False,
    grid: tuple[int, int] = DEFAULT_GRID,
) -> FilmForce:
    """Force, friction and flow of the film around a moving journal.

    Solves equation (3) of the paper with the journal as the moving surface,
    `div(h^3 grad p / 12 mu) = omega/2 dh/dtheta + dh/dt`, `h = c - x cos(theta) - y sin(theta)`.

    Parameters
    ----------
    position_m, velocity_m_s
        Journal centre and its velocity, m and m/s, shape (..., 2); they broadcast.
    radius_m, length_m, clearance_m
        Journal radius, bearing length, radial clearance, m.
    viscosity_Pa_s, speed_rad_s
        Oil viscosity and journal speed (any sign or zero).
    rupture
        `full`: none, negative pressures stay; `gumbel`: pressures below cavitation cut off; `reynolds`:
        Swift-Stieber, by complementarity; `jfo`: mass-conserving, steady or with `memory`.
    inlet
        `periodic`: closed ring; `groove_hmax`: an axial line at the thickest film, at ambient pressure.
    feed
        Ports of known pressure.
    end_pressure_Pa, cavitation_pressure_Pa
        At the lower-z and upper-z end; and in the ruptured film.
    couette
        Film shear in the ruptured part: as if filled (`full`), or only of the streamers (`filled`).
    clearance_rate_m_s
        Rate of change of the clearance, m/s.
    memory
        Fill one time step ago (`jfo` only); None for the steady film.
    fields
        Return pressure and fill with their coordinates.
    grid
        Nodes around, intervals along the whole length.

    Raises
    ------
    FilmError
        Absurd or non-finite parameters.
    JournalOutsideClearance
        The eccentricity is not below the clearance.
    FilmNotConverged
        The rupture boundary did not settle.

    Notes
    -----
    The pressure part of the friction torque is `(e x F) / 2`: the integral of `h/2 dp/dtheta` by parts. It
    holds for every rupture rule here because the pressure is continuous around the ring.
    """
    bearing = Bearing(
        radius_m, length_m, clearance_m, viscosity_Pa_s, speed_rad_s, rupture, inlet, tuple(feed),
        (float(end_pressure_Pa[0]), float(end_pressure_Pa[1])), cavitation_pressure_Pa, couette,
        clearance_rate_m_s, grid,
    )  # fmt: skip
    position, velocity = _states(position_m, velocity_m_s)
    batch = position.shape[:-1]
    results = [
        evaluate(bearing, e, v, fields) for e, v in zip(position.reshape(-1, 2), velocity.reshape(-1, 2), strict=True)
    ]
    return _stack(results, batch, fields)


def _states(position_m: ArrayLike, velocity_m_s: ArrayLike) -> tuple[Floats, Floats]:
    position = np.asarray(position_m, dtype=np.float64)
    velocity = np.asarray(velocity_m_s, dtype=np.float64)
    for name, value in (("position_m", position), ("velocity_m_s", velocity)):
        if value.shape[-1:] != (2,):
            raise FilmError(f"{name}: the last axis must hold (x, y), got shape {value.shape}")
        if not np.all(np.isfinite(value)):
            raise FilmError(f"{name}: must be finite")
    position, velocity = np.broadcast_arrays(position, velocity)
    return position, velocity


def solve_film(bearing: Bearing, position: Floats, velocity: Floats) -> Film:
    """Pressure and fill of one state, position and velocity of shape (2,), SI."""
    x, y = position / bearing.clearance_m
    eps = float(np.hypot(x, y))
    if eps >= 1:
        raise JournalOutsideClearance(
            f"eccentricity {eps * bearing.clearance_m:.6g} m is not below the radial clearance "
            f"{bearing.clearance_m:.6g} m: no film is left; use a contact model"
        )
    mesh = build_mesh(
        radius_m=bearing.radius_m,
        length_m=bearing.length_m,
        feed=bearing.feed,
        end_pressure_Pa=bearing.end_pressure_Pa,
        nodes=bearing.grid,
        hmax_rad=float(np.arctan2(-y, -x)) if eps > 0 else 0.0,
        eccentricity_ratio=eps,
        inlet_Pa=bearing.inlet_pressure_Pa,
    )
    thickness = 1 - x * np.cos(mesh.theta) - y * np.sin(mesh.theta)
    thickness_face = 1 - x * np.cos(mesh.theta_face) - y * np.sin(mesh.theta_face)
    supply = -_film_rate(bearing, mesh, position, velocity)[:, None] * mesh.z_width
    around = solver.around_conductance(thickness_face, mesh.theta_gap, mesh.z_width)
    axial = solver.axial_conductance(thickness, mesh.theta_width, mesh.z_gap)
    # A groove as long as the bearing is closed at its ends; else its leakage would grow without limit.
    axial[mesh.port[:, -1], -1] = 0.0
    if mesh.copies == 1:
        axial[mesh.port[:, 0], 0] = 0.0
    pressure = mesh.fixed_Pa / bearing.pressure_scale_Pa_s
    floor = bearing.cavitation_pressure_Pa / bearing.pressure_scale_Pa_s
    ruptured = supply < 0
    sweeps = solver.solve_pressure(
        pressure, mesh.fixed, around, axial, supply, floor, ruptured, bearing.rupture == "reynolds"
    )
    if sweeps == 0:
        raise FilmNotConverged(
            f"rupture boundary not settled after {solver.MAX_SWEEPS} sweeps at eccentricity ratio {eps:.6g}"
        )
    if bearing.rupture == "gumbel":
        ruptured = pressure < floor
        pressure = np.maximum(pressure, floor)
    ruptured[:, -1] = ruptured[:, -2]
    if mesh.copies == 1:
        ruptured[:, 0] = ruptured[:, 1]
    fill = solver.streamer_fill(
        ruptured & ~mesh.port, thickness_face, pressure, around, axial, mesh.z_width, bearing.speed_rad_s
    )
    return Film(mesh, thickness, thickness_face, pressure, fill, supply, around, axial)


def _film_rate(bearing: Bearing, mesh: Mesh, position: Floats, velocity: Floats) -> Floats:
    """Integral of `omega/2 dH/dtheta + dH/dt` over each station's cell, 1/s.

    Rotation and squeeze act only through `v_s = v - (omega/2) z x e`, so a pure whirl at omega/2 vanishes
    exactly.
    """
    after = mesh.theta_face
    before = np.roll(mesh.theta_face, 1)
    vx, vy = velocity + 0.5 * bearing.speed_rad_s * np.array([position[1], -position[0]])
    rate = bearing.clearance_rate_m_s * mesh.theta_width
    rate = rate - vx * (np.sin(after) - np.sin(before)) + vy * (np.cos(after) - np.cos(before))
    return np.asarray(rate / bearing.clearance_m)


def evaluate(bearing: Bearing, position: Floats, velocity: Floats, fields: bool = False) -> FilmForce:
    """`film_force` of one state, position and velocity of shape (2,), SI."""
    film = solve_film(bearing, position, velocity)
    mesh = film.mesh
    scale = bearing.pressure_scale_Pa_s
    after, before = mesh.theta_face, np.roll(mesh.theta_face, 1)
    line = film.pressure @ mesh.z_weight * (mesh.copies * scale * bearing.radius_m**2)
    force = np.array([-line @ (np.sin(after) - np.sin(before)), line @ (np.cos(after) - np.cos(before))])
    side, inflow = _flows(bearing, film)
    whole = _whole_length(film) if fields else (None, None, None)
    return FilmForce(
        force_N=force,
        friction_torque_N_m=np.asarray(_friction(bearing, film, position, force)),
        side_flow_m3_s=np.asarray(side),
        inflow_m3_s=np.asarray(inflow),
        min_film_m=bearing.clearance_m - np.hypot(*position),
        max_pressure_Pa=film.pressure.max() * scale,
        pressure_Pa=whole[0] * scale if whole[0] is not None else None,
        fill=whole[1],
        theta_rad=np.remainder(mesh.theta, 2 * np.pi) if fields else None,
        z_m=whole[2] * bearing.radius_m if whole[2] is not None else None,
    )


def _friction(bearing: Bearing, film: Film, position: Floats, force: Floats) -> float:
    """Torque on the journal against its rotation, N m: shear of the moving wall plus `(e x F) / 2`."""
    if bearing.couette == "full":
        eps = np.hypot(*position) / bearing.clearance_m
        shear = 2 * np.pi * bearing.length_m / np.sqrt(1 - eps**2)
    else:
        mesh = film.mesh
        ring = (film.fill / film.thickness[:, None]).T @ mesh.theta_width
        shear = mesh.copies * (mesh.z_weight @ ring) * bearing.radius_m
    gain = bearing.viscosity_Pa_s * bearing.radius_m**3 / bearing.clearance_m
    pressure_part = (position[0] * force[1] - position[1] * force[0]) / 2
    sense = -1.0 if bearing.speed_rad_s < 0 else 1.0
    return float(gain * abs(bearing.speed_rad_s) * shear + sense * pressure_part)


def _flows(bearing: Bearing, film: Film) -> tuple[float, float]:
    """Flow out of both ends and flow in from the ports, m3/s."""
    mesh, p = film.mesh, film.pressure
    unit = mesh.copies * bearing.clearance_m * bearing.radius_m**2
    side = 0.0
    lower, upper = bearing.end_pressure_Pa
    ends = [(-1, -2, upper)] if mesh.copies == 2 else [(-1, -2, upper), (0, 1, lower)]
    for end, inner, value in ends:
        out = film.axial[:, end] * (p[:, inner] - p[:, end])
        if bearing.rupture == "full":
            out = out + film.supply[:, end]
        else:  # the half cell at a ruptured end takes nothing up, and none can be drawn in without pressure
            floor = bearing.cavitation_pressure_Pa / bearing.pressure_scale_Pa_s
            out = np.where(p[:, inner] > floor, out + film.supply[:, end], out)
            out = np.maximum(out, 0.0) if value == bearing.cavitation_pressure_Pa else out
        side += float(out.sum())
    return side * unit, _port_flow(bearing, film) * unit


def _port_flow(bearing: Bearing, film: Film) -> float:
    """Scaled flow that the ports deliver: what leaves them less what the streamers bring."""
    mesh = film.mesh
    if not mesh.port.any():
        return 0.0
    flow = 0.0
    for i, j in zip(*np.nonzero(mesh.port), strict=True):
        flow += solver.outflow(film.pressure, i, j, film.around, film.axial) - film.supply[i, j]
    step = -1 if bearing.speed_rad_s < 0 else 1
    upstream = np.roll(film.fill, step, axis=0)
    face = film.thickness_face if step < 0 else np.roll(film.thickness_face, 1)
    missing = abs(bearing.speed_rad_s) / 2 * (face[:, None] * mesh.z_width) * (1 - upstream)
    return flow + float(missing[mesh.port].sum())


def _whole_length(film: Film) -> tuple[Floats, Floats, Floats]:
    """Pressure, fill and axial nodes over both halves."""
    mesh = film.mesh
    if mesh.copies == 1:
        return film.pressure, film.fill, mesh.z

    def both(a: Floats) -> Floats:
        return np.concatenate([a[..., :0:-1], a], axis=-1)

    z = np.concatenate([-mesh.z[:0:-1], mesh.z])
    return both(film.pressure), both(film.fill), z


def _stack(results: list[FilmForce], batch: tuple[int, ...], fields: bool) -> FilmForce:
    """Put the batch axes back."""

    def stacked(name: str) -> Floats:
        values = np.stack([getattr(r, name) for r in results])
        return np.asarray(values.reshape(batch + values.shape[1:]))

    return FilmForce(
        force_N=stacked("force_N"),
        friction_torque_N_m=stacked("friction_torque_N_m"),
        side_flow_m3_s=stacked("side_flow_m3_s"),
        inflow_m3_s=stacked("inflow_m3_s"),
        min_film_m=stacked("min_film_m"),
        max_pressure_Pa=stacked("max_pressure_Pa"),
        pressure_Pa=stacked("pressure_Pa") if fields else None,
        fill=stacked("fill") if fields else None,
        theta_rad=stacked("theta_rad") if fields else None,
        z_m=stacked("z_m") if fields else None,
    )
