"""Pressure and fill of one journal state."""

from dataclasses import dataclass, field

import numpy as np

from . import solver
from .bearing import Bearing
from .bore import PadBore
from .conserving import solve_conserving
from .mesh import Mesh, build_mesh
from .records import FilmError, FilmMemory, FilmNotConverged, Floats, JournalOutsideClearance
from .restricted import ScaledFeeds, solve_restricted
from .turbulence import resistance


@dataclass(frozen=True)
class SolvedFilm:
    """One solved film on its mesh, scaled as in `solver`.

    `supply` is what the walls deliver to each cell, `uncut` the pressure before Guembel's rule cut
    it off.
    """

    mesh: Mesh
    thickness: Floats
    thickness_face: Floats
    pressure: Floats
    uncut: Floats
    fill: Floats
    supply: Floats
    around: Floats
    axial: Floats
    feeds: ScaledFeeds | None = None
    feed_pressure: Floats = field(default_factory=lambda: np.zeros(0))


def solve_film(
    bearing: Bearing, position: Floats, velocity: Floats, memory: FilmMemory | None = None
) -> SolvedFilm:
    """Pressure and fill of one state, position and velocity of shape (2,), SI."""
    film = unsolved_film(bearing, position, velocity, memory)
    if bearing.rupture == "jfo":
        sweeps = _conserve(bearing, film, _film_rate(bearing, film.mesh, velocity), memory)
    else:
        sweeps = _rupture(bearing, film)
    if sweeps == 0:
        eps = float(np.hypot(*position)) / bearing.clearance_m
        raise FilmNotConverged(
            f"rupture boundary not settled after {solver.MAX_SWEEPS} sweeps at eccentricity ratio "
            f"{eps:.6g}"
        )
    return film


def unsolved_film(
    bearing: Bearing, position: Floats, velocity: Floats, memory: FilmMemory | None = None
) -> SolvedFilm:
    """The film of one state before its pressure is known: only the fixed pressures are filled
    in."""
    x, y = at = position / bearing.clearance_m
    eps = float(np.hypot(x, y))
    dense = max(0.0, 1 - bearing.gap_m(position) / bearing.clearance_m) if bearing.pads else eps
    if bearing.gap_m(position) <= 0:
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
        hmax_rad=float(np.arctan2(-y, -x)) if eps > 0 and memory is None else 0.0,
        eccentricity_ratio=dense if memory is None else 0.0,
        inlet_Pa=bearing.inlet_pressure_Pa,
        pads=bearing.pads,
    )
    thickness, thickness_face = (
        bearing.thickness(theta, at) for theta in (mesh.theta, mesh.theta_face)
    )
    # Rotation and squeeze act only through v_s, so a pure whirl at omega/2 vanishes exactly.
    squeeze = velocity - bearing.speed_rad_s / 2 * np.array([-position[1], position[0]])
    rate = _film_rate(bearing, mesh, squeeze) + pad_wedge(bearing, mesh)
    supply = -rate[:, None] * mesh.z_width
    around = solver.around_conductance(thickness_face, mesh.theta_gap, mesh.z_width)
    axial = solver.axial_conductance(thickness, mesh.theta_width, mesh.z_gap)
    if bearing.density_kg_m3:
        around = around / resistance(bearing, thickness_face)[0][:, None]
        axial = axial / resistance(bearing, thickness)[1][:, None]
    _close_grooves(mesh, around, axial)
    restricted = any(f.restricted for f in bearing.feed)
    return SolvedFilm(
        mesh=mesh,
        thickness=thickness,
        thickness_face=thickness_face,
        pressure=mesh.fixed_Pa / bearing.pressure_scale_Pa_s,
        uncut=np.empty(mesh.fixed.shape),
        fill=np.ones(mesh.fixed.shape),
        supply=supply,
        around=around,
        axial=axial,
        feeds=_scaled_feeds(bearing, mesh, position, memory) if restricted else None,
        feed_pressure=np.zeros(len(bearing.feed)),
    )


def pad_wedge(bearing: Bearing, mesh: Mesh) -> Floats:
    """Integral over each station's cell of what the turning journal meets in the pads' own shape,
    1/s; not even where pads are stepped."""
    if bearing.pads is None:
        return np.zeros(mesh.theta.size)
    return np.asarray(bearing.speed_rad_s / 2 * pad_steps(bearing.pads, mesh))


def pad_steps(pads: PadBore, mesh: Mesh) -> Floats:
    """By how much the pads' own film grows over each station's cell, over the clearance."""
    faces = pads.thickness(mesh.theta_face)
    return np.asarray(faces - np.roll(faces, 1))


def _scaled_feeds(
    bearing: Bearing, mesh: Mesh, position: Floats, memory: FilmMemory | None
) -> ScaledFeeds:
    """The feeds of one state; the film at each is that in its middle."""
    count, scale = len(bearing.feed), bearing.pressure_scale_Pa_s
    unit = bearing.clearance_m * bearing.radius_m**2  # of flow
    numbers = np.zeros((5, count))
    before_Pa = None if memory is None else memory.feed_pressure_Pa
    for k, feed in enumerate(bearing.feed):
        theta = np.array([feed.angle_rad])
        share = bearing.thickness(theta, position / bearing.clearance_m)
        film_m = bearing.clearance_m * float(share[0])
        quadratic, linear = feed.restrictor.resistance(bearing.viscosity_Pa_s, film_m)
        numbers[:3, k] = feed.pressure_Pa, quadratic * unit**2, linear * unit
        if memory is not None and before_Pa is not None:
            stored = feed.restrictor.stored_m3_Pa(float(before_Pa[k]))
            numbers[3:, k] = stored / memory.dt_s * scale / unit / mesh.copies, before_Pa[k]
    return ScaledFeeds(
        place=np.where(mesh.place < count, mesh.place, -1),
        supply=numbers[0] / scale,
        quadratic=numbers[1] * mesh.copies**2 / scale,
        linear=numbers[2] * mesh.copies / scale,
        store=numbers[3],
        before=numbers[4] / scale,
    )


def _fill_feeds(film: SolvedFilm) -> None:
    """Give the ports the pressure that was found for their feed."""
    if film.feeds is not None:
        place = film.feeds.place
        film.pressure[place >= 0] = film.feed_pressure[place[place >= 0]]


def _close_grooves(mesh: Mesh, around: Floats, axial: Floats) -> None:
    """A groove as long as the bearing is closed at its ends; else its leakage would grow without
    limit."""
    for end, face in ((-1, -1), (0, 0))[: 3 - mesh.copies]:
        port = mesh.port[:, end]
        axial[port, face] = 0.0
        around[port | np.roll(port, -1), end] = 0.0


def _rupture(bearing: Bearing, film: SolvedFilm) -> int:
    """Fill in the pressure of a rule that does not conserve mass, and the streamers; returns the
    sweeps."""
    mesh, pressure = film.mesh, film.pressure
    ruptured = np.zeros(
        film.supply.shape, dtype=bool
    )  # too much rupture heals one cell a sweep, too little at once
    complementary = bearing.rupture == "reynolds"
    if film.feeds is None:
        sweeps = solver.solve_pressure(
            pressure,
            mesh.fixed,
            film.around,
            film.axial,
            film.supply,
            bearing.floor,
            ruptured,
            complementary,
        )
    else:
        none = np.zeros(ruptured.shape)
        sweeps = _restrict(bearing, film, none, none, none, ruptured, complementary, mixed=False)
    film.uncut[:] = pressure
    if bearing.rupture == "gumbel":
        ruptured = pressure < bearing.floor
        np.maximum(pressure, bearing.floor, out=pressure)
    _copy_to_ends(mesh, ruptured)
    film.fill[:] = solver.streamer_fill(
        ruptured & ~mesh.port,
        film.thickness_face,
        pressure,
        film.around,
        film.axial,
        mesh.z_width,
        bearing.speed_rad_s,
    )
    # Only at the ports does this rule know of the streamers: they bring less than a full gap would.
    # A restrictor's balance is that of the rule, without them.
    if film.feeds is None:
        film.supply[mesh.port] += _void_transport(bearing, film)[mesh.port]
    return int(sweeps)


def _restrict(
    bearing: Bearing,
    film: SolvedFilm,
    void: Floats,
    drag: Floats,
    kept: Floats,
    ruptured: np.ndarray,
    complementary: bool,
    mixed: bool,
) -> int:
    """Fill in the pressure of film and feeds, and the void share of the mass-conserving film."""
    assert film.feeds is not None
    sweeps = solve_restricted(
        film.pressure,
        void,
        film.mesh.fixed,
        ruptured,
        film.around,
        film.axial,
        film.supply,
        drag,
        kept,
        -1 if bearing.speed_rad_s < 0 else 1,
        bearing.floor,
        complementary,
        mixed,
        film.feeds,
        film.feed_pressure,
        np.zeros((film.feed_pressure.size,) * 2),
    )
    _fill_feeds(film)
    return int(sweeps)


def _conserve(bearing: Bearing, film: SolvedFilm, rate: Floats, memory: FilmMemory | None) -> int:
    """Fill in the pressure and the fill of the mass-conserving film; returns the sweeps.

    `rate` is the integral of dH/dt over each station's cell.
    """
    mesh = film.mesh
    if memory is None:
        kept = np.maximum(rate, 0.0)[:, None] * mesh.z_width
        supply = film.supply
    else:
        content = (film.thickness * mesh.theta_width)[:, None] * mesh.z_width
        kept = content / memory.dt_s
        if np.any(content < memory.dt_s * rate[:, None] * mesh.z_width):
            raise FilmError(
                f"memory.dt_s = {memory.dt_s}: too long for this velocity, the journal would have "
                f"been outside "
                "the clearance one step ago; shorten it"
            )
        void_before = 1 - _half_of(memory.fill, mesh)
        supply = film.supply - (kept - rate[:, None] * mesh.z_width) * void_before
    void, drag = np.zeros(mesh.fixed.shape), _drag(bearing, film)
    if film.feeds is None:
        sweeps = solve_conserving(
            film.pressure,
            void,
            mesh.fixed,
            film.supply < 0,
            film.around,
            film.axial,
            supply,
            drag,
            kept,
            -1 if bearing.speed_rad_s < 0 else 1,
            bearing.floor,
        )
    else:
        film.supply[:] = supply
        sweeps = _restrict(bearing, film, void, drag, kept, supply < 0, True, mixed=True)
    _copy_to_ends(mesh, void)
    film.fill[:] = np.where(mesh.port, 1.0, 1 - void)
    film.supply[:] = supply + _void_transport(bearing, film) + kept * (1 - film.fill)
    return int(sweeps)


def _drag(bearing: Bearing, film: SolvedFilm) -> Floats:
    """Flow that the turning wall drags through each face between stations of a full gap."""
    return abs(bearing.speed_rad_s) / 2 * film.thickness_face[:, None] * film.mesh.z_width


def _void_transport(bearing: Bearing, film: SolvedFilm) -> Floats:
    """What each cell gains because voids, not oil, leave it with the turning wall, less those that
    come in."""
    void, drag = 1 - film.fill, _drag(bearing, film)
    if bearing.speed_rad_s < 0:
        through = drag * np.roll(void, -1, axis=0)
        return np.roll(through, 1, axis=0) - through
    through = drag * void
    return through - np.roll(through, 1, axis=0)


def _copy_to_ends(mesh: Mesh, field: np.ndarray) -> None:
    """Give the nodes of known pressure at the ends the state of their inner neighbours."""
    field[:, -1] = field[:, -2]
    if mesh.copies == 1:
        field[:, 0] = field[:, 1]


def _half_of(fill: Floats | float, mesh: Mesh) -> Floats:
    """A remembered fill on the meshed part of the film."""
    whole = np.asarray(fill, dtype=np.float64)
    part = whole[..., -mesh.z.size :] if whole.ndim else whole
    if whole.ndim and part.shape != mesh.fixed.shape:
        raise FilmError(f"memory.fill has shape {whole.shape}: it belongs to another grid or feed")
    return np.broadcast_to(part, mesh.fixed.shape)


def _film_rate(bearing: Bearing, mesh: Mesh, velocity: Floats) -> Floats:
    """Integral of dH/dt over each station's cell for a journal velocity, 1/s."""
    after, before = mesh.theta_face, np.roll(mesh.theta_face, 1)
    rate = bearing.clearance_rate_m_s * mesh.theta_width
    rate = (
        rate
        - velocity[0] * (np.sin(after) - np.sin(before))
        + velocity[1] * (np.cos(after) - np.cos(before))
    )
    return np.asarray(rate / bearing.clearance_m)
