"""Film force of a finite-length plain journal bearing: the Reynolds equation with a rupture
rule."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from . import solver, turbulence
from .bearing import DEFAULT_GRID, Bearing
from .bore import PadBore
from .pressure import SolvedFilm, pad_steps, solve_film
from .records import Couette, FeedPatch, FilmError, FilmForce, FilmMemory, Floats, Inlet, Rupture


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
    feed: Sequence[FeedPatch] = (),
    end_pressure_Pa: tuple[float, float] = (0.0, 0.0),
    cavitation_pressure_Pa: float = 0.0,
    couette: Couette = "full",
    clearance_rate_m_s: float = 0.0,
    memory: FilmMemory | None = None,
    fields: bool = False,
    grid: tuple[int, int] = DEFAULT_GRID,
    pads: PadBore | None = None,
    density_kg_m3: float = 0.0,
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
        `full`: none, negative pressures stay; `gumbel`: pressures below cavitation cut off;
        `reynolds`: Swift-Stieber, by complementarity; `jfo`: mass-conserving, steady or with
        `memory`.
    inlet
        `periodic`: closed ring; `groove_hmax`: an axial line at the thickest film, at ambient
        pressure.
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
    pads
        Fixed pads instead of a round bore; `clearance_m` is then that of the circle inscribed in
        them, and the grooves between them are at ambient pressure.
    density_kg_m3
        Of the lubricant, for the turbulent film (:mod:`sim_hil.film.turbulence`); 0: laminar at any
        speed.

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
    The pressure part of the friction torque is `(e x F) / 2`: the integral of `h/2 dp/dtheta` by
    parts. It holds for every rupture rule here because the pressure is continuous around the ring.
    """
    bearing = Bearing(
        radius_m,
        length_m,
        clearance_m,
        viscosity_Pa_s,
        speed_rad_s,
        rupture,
        inlet,
        (*feed, *(pads.grooves(length_m) if pads else ())),
        (float(end_pressure_Pa[0]), float(end_pressure_Pa[1])),
        cavitation_pressure_Pa,
        couette,
        clearance_rate_m_s,
        grid,
        pads,
        density_kg_m3,
    )
    bearing.check_memory(memory)
    position, velocity = _states(position_m, velocity_m_s)
    batch = position.shape[:-1]
    states = zip(
        position.reshape(-1, 2), velocity.reshape(-1, 2), _memories(memory, batch), strict=True
    )
    results = [evaluate(bearing, e, v, m, fields) for e, v, m in states]
    return stack(results, batch, fields)


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


def _memories(memory: FilmMemory | None, batch: tuple[int, ...]) -> list[FilmMemory | None]:
    """One memory per state."""
    count = int(np.prod(batch))
    if memory is None or (np.ndim(memory.fill) == 0 and memory.feed_pressure_Pa is None):
        return [memory] * count

    def each(values: Floats | float | None, axes: int) -> list[Floats | None]:
        if values is None:
            return [None] * count
        array = np.asarray(values, dtype=np.float64)
        inner = array.shape[array.ndim - axes :] if array.ndim else ()
        return list(np.broadcast_to(array, batch + inner).reshape(count, *inner))

    fills, feeds = each(memory.fill, 2), each(memory.feed_pressure_Pa, 1)
    return [
        FilmMemory(memory.dt_s, 1.0 if fill is None else fill, feed)
        for fill, feed in zip(fills, feeds, strict=True)
    ]


def evaluate(
    bearing: Bearing,
    position: Floats,
    velocity: Floats,
    memory: FilmMemory | None = None,
    fields: bool = False,
) -> FilmForce:
    """`film_force` of one state, position and velocity of shape (2,), SI."""
    film = solve_film(bearing, position, velocity, memory)
    mesh = film.mesh
    scale = bearing.pressure_scale_Pa_s
    force = pressure_force(film) * (scale * bearing.radius_m**2)
    pressure, fill, z = _whole_length(film)
    feeds = range(len(bearing.feed)) if film.feeds is not None else None
    feed_Pa = None if feeds is None else film.feed_pressure * scale
    return FilmForce(
        force_N=force,
        friction_torque_N_m=np.asarray(_friction(bearing, film, position, force)),
        side_flow_m3_s=np.asarray(side_flow(bearing, film)),
        inflow_m3_s=np.asarray(_port_flow(bearing, film)),
        min_film_m=np.asarray(bearing.gap_m(position)),
        max_pressure_Pa=film.pressure.max() * scale,
        memory=FilmMemory(memory.dt_s, fill, feed_Pa) if memory is not None else None,
        feed_pressure_Pa=feed_Pa,
        feed_flow_m3_s=np.array([_port_flow(bearing, film, k) for k in feeds]) if feeds else None,
        pressure_Pa=pressure * scale if fields else None,
        fill=fill if fields else None,
        theta_rad=np.remainder(mesh.theta, 2 * np.pi) if fields else None,
        z_m=z * bearing.radius_m if fields else None,
    )


def pressure_force(film: SolvedFilm) -> Floats:
    """Integral of the scaled pressure over the journal (x, y)."""
    mesh = film.mesh
    after, before = mesh.theta_face, np.roll(mesh.theta_face, 1)
    line = film.pressure @ mesh.z_weight * mesh.copies
    return np.array(
        [-line @ (np.sin(after) - np.sin(before)), line @ (np.cos(after) - np.cos(before))]
    )


def _friction(bearing: Bearing, film: SolvedFilm, position: Floats, force: Floats) -> float:
    """Torque on the journal against its rotation, N m: shear of the moving wall plus `(e x F) /
    2`."""
    if bearing.couette == "full" and not bearing.density_kg_m3:
        eps = np.hypot(*position) / bearing.clearance_m
        ring = (
            2 * np.pi / np.sqrt(1 - eps**2)
            if bearing.pads is None
            else bearing.pads.shear(position / bearing.clearance_m)
        )
        shear = ring * bearing.length_m
    else:
        mesh = film.mesh
        fill = film.fill if bearing.couette == "filled" else np.ones(film.fill.shape)
        if bearing.pads is not None:  # the grooves between pads are deep
            fill = np.where(mesh.port, 0.0, fill)
        sheared = turbulence.shear(bearing, film.thickness) / film.thickness
        ring = (fill * sheared[:, None]).T @ mesh.theta_width
        shear = mesh.copies * (mesh.z_weight @ ring) * bearing.radius_m
    gain = bearing.viscosity_Pa_s * bearing.radius_m**3 / bearing.clearance_m
    pressure_part = (position[0] * force[1] - position[1] * force[0]) / 2
    if bearing.pads is not None:
        line = film.pressure @ film.mesh.z_weight * film.mesh.copies
        lean = float(line @ pad_steps(bearing.pads, film.mesh)) / 2
        pressure_part -= (
            lean * bearing.clearance_m * bearing.pressure_scale_Pa_s * (bearing.radius_m**2)
        )
    sense = -1.0 if bearing.speed_rad_s < 0 else 1.0
    return float(gain * abs(bearing.speed_rad_s) * shear + sense * pressure_part)


def side_flow(bearing: Bearing, film: SolvedFilm) -> float:
    """Flow out of both ends, m3/s: that of the end faces and what the walls deliver to the half
    cells there."""
    mesh = film.mesh
    p = film.uncut if bearing.rupture == "gumbel" else film.pressure
    side = 0.0
    lower, upper = bearing.end_pressure_Pa
    for end, inner, value in ((-1, -2, upper), (0, 1, lower))[: 3 - mesh.copies]:
        out = film.axial[:, end] * (p[:, inner] - p[:, end])
        whole = ~mesh.port[:, end]
        if bearing.rupture == "reynolds":  # the half cell at a ruptured end takes nothing up
            whole &= p[:, inner] > bearing.floor
        out = np.where(whole, out + film.supply[:, end], out)
        if bearing.rupture in ("gumbel", "reynolds") and value == bearing.cavitation_pressure_Pa:
            out = np.maximum(out, 0.0)  # none can be drawn in without pressure
        side += float(out.sum())
    return side * mesh.copies * bearing.clearance_m * bearing.radius_m**2


def _port_flow(bearing: Bearing, film: SolvedFilm, feed: int | None = None) -> float:
    """Flow from the ports into the film, m3/s; of all, or of one feed."""
    mesh = film.mesh
    flow = 0.0
    for i, j in zip(*np.nonzero(mesh.port if feed is None else mesh.place == feed), strict=True):
        flow += solver.outflow(film.pressure, i, j, film.around, film.axial) - film.supply[i, j]
    return flow * mesh.copies * bearing.clearance_m * bearing.radius_m**2


def _whole_length(film: SolvedFilm) -> tuple[Floats, Floats, Floats]:
    """Pressure, fill and axial nodes over both halves."""
    mesh = film.mesh
    if mesh.copies == 1:
        return film.pressure, film.fill, mesh.z

    def both(a: Floats) -> Floats:
        return np.concatenate([a[..., :0:-1], a], axis=-1)

    z = np.concatenate([-mesh.z[:0:-1], mesh.z])
    return both(film.pressure), both(film.fill), z


def stack(results: list[FilmForce], batch: tuple[int, ...], fields: bool) -> FilmForce:
    """Put the batch axes back."""

    def stacked(name: str) -> Floats:
        values = np.stack([getattr(r, name) for r in results])
        return np.asarray(values.reshape(batch + values.shape[1:]))

    def optional(name: str) -> Floats | None:
        return None if getattr(results[0], name) is None else stacked(name)

    memory = None
    if results[0].memory is not None:
        fills = np.stack([r.memory.fill for r in results if r.memory is not None])
        memory = FilmMemory(
            results[0].memory.dt_s,
            fills.reshape(batch + fills.shape[1:]),
            optional("feed_pressure_Pa"),
        )
    return FilmForce(
        force_N=stacked("force_N"),
        friction_torque_N_m=stacked("friction_torque_N_m"),
        side_flow_m3_s=stacked("side_flow_m3_s"),
        inflow_m3_s=stacked("inflow_m3_s"),
        min_film_m=stacked("min_film_m"),
        max_pressure_Pa=stacked("max_pressure_Pa"),
        memory=memory,
        feed_pressure_Pa=optional("feed_pressure_Pa"),
        feed_flow_m3_s=optional("feed_flow_m3_s"),
        pressure_Pa=stacked("pressure_Pa") if fields else None,
        fill=stacked("fill") if fields else None,
        theta_rad=stacked("theta_rad") if fields else None,
        z_m=stacked("z_m") if fields else None,
    )
