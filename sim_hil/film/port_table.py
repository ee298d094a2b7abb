"""Table of the film with any openings: `port_kernel` says of what and evaluates it.

Tabulated are, over the place of the journal, what a full film does to one unit of velocity and of
pressure in each opening; restrictors, viscosity, clearance and supply are not in it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_py.machine import FeedPort
from firmware_py.machine.restrictor import Opening, opening, restrictor
from sim_hil.jit import allocating

from .bearing import Bearing
from .port_kernel import EACH, STATIONS, PortLaw, port_force
from .pressure import SolvedFilm, unsolved_film
from .records import FeedPatch, Floats
from .restricted import _assemble, _feed_flows, _spread, eliminate_many
from .solver import fold
from .spline import line_coefficients, ring_coefficients
from .table import FilmTable
from .table_kernel import EPS_TABLE

__all__ = ["PortLaw", "PortTable", "port_force"]

_DATA = Path(__file__).parent / "data"
_CLEARANCE = 1e-3
_VERSION = 2
"""Of what the table holds and how it is made: another one is another file."""


@dataclass(frozen=True)
class PortTable:
    """Spline coefficients for `port_kernel.port_force`.

    Parameters
    ----------
    length_over_diameter, openings
        What it was made for; lengths of the openings in journal radii.
    table, bare
        As in `PortLaw`.
    """

    length_over_diameter: float
    openings: tuple[Opening, ...]
    table: Floats
    bare: Floats

    @classmethod
    def build(
        cls,
        length_over_diameter: float,
        openings: Sequence[Opening],
        cells: tuple[int, int] = (14, 48),
        grid: tuple[int, int] = (96, 14),
    ) -> PortTable:
        """Solve the full film at every node of a table with that many cells: a few milliseconds
        each."""
        eps = -np.expm1(np.log1p(-EPS_TABLE) * np.arange(cells[0] + 1) / cells[0])
        alpha = 2 * np.pi * np.arange(cells[1]) / cells[1]
        bearing = _unit_bearing(length_over_diameter, openings, grid)
        values = np.array([[_columns(bearing, e, a) for a in alpha] for e in eps])
        unfed = _unit_bearing(length_over_diameter, (), grid)
        bare = np.array([_bare(unfed, e, 2 * cells[1]) for e in eps])
        return cls(length_over_diameter, tuple(openings), _wrapped(values), _wrapped(bare))

    @property
    def key(self) -> str:
        """Hash of all that decides the table."""
        return _key(self.length_over_diameter, self.openings)

    @classmethod
    def of(cls, length_over_diameter: float, openings: Sequence[Opening]) -> PortTable:
        """The table of these openings: shipped, made before, or made now and kept in the user's
        cache."""
        name = f"ports_{_key(length_over_diameter, openings)}.npz"
        for path in (_DATA / name, cache_folder() / name):
            if path.exists():
                with np.load(path) as stored:
                    return cls(
                        length_over_diameter,
                        tuple(openings),
                        np.ascontiguousarray(stored["table"], dtype=np.float64),
                        np.ascontiguousarray(stored["bare"], dtype=np.float64),
                    )
        made = cls.build(length_over_diameter, openings)
        made.save(cache_folder())
        return made

    def save(self, folder: Path = _DATA) -> Path:
        """Write the table, whole or not at all, where `of` finds it; returns the file."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"ports_{self.key}.npz"
        part = path.with_suffix(f".{os.getpid()}.npz")
        np.savez_compressed(part, table=self.table, bare=self.bare)
        part.replace(path)
        return path

    def law(self, unfed: Floats, restrictors: Floats, own_Pa: Floats) -> PortLaw:
        """What `port_force` needs; `restrictors` and `own_Pa` as in `PortLaw`."""
        angles = np.array([one.angle_rad for one in self.openings])
        middle, chord = 2 * np.pi * np.arange(STATIONS) / STATIONS, 2 * np.sin(np.pi / STATIONS)
        ring = chord * np.array([np.cos(middle), np.sin(middle)])
        return PortLaw(unfed, self.table, self.bare, angles, restrictors, own_Pa, ring)


def port_law(
    ports: Sequence[FeedPort], radius_m: float, length_m: float, density_kg_m3: float
) -> PortLaw:
    """The film of a bearing with these openings.

    Raises
    ------
    FilmError
        No table of the unfed film of that shape is shipped.
    """
    shape = length_m / (2 * radius_m)
    places = [_in_radii(opening(port, radius_m), radius_m) for port in ports]
    laws = [restrictor(port, radius_m, density_kg_m3) for port in ports]
    own = [np.nan if p.pressure_bar is None else 1e5 * p.pressure_bar for p in ports]
    return PortTable.of(shape, places).law(
        FilmTable.load(shape).coefficients,
        np.array([law[:4] for law in laws]),
        np.array(own),
    )


def cache_folder() -> Path:
    """Where tables of other machines are kept."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "orbitd" / "film"


def _in_radii(one: Opening, radius_m: float) -> Opening:
    return one._replace(axial_m=one.axial_m / radius_m, length_m=one.length_m / radius_m)


def _key(length_over_diameter: float, openings: Sequence[Opening]) -> str:
    numbers = [_VERSION, length_over_diameter, *(x for one in openings for x in one)]
    text = ",".join(f"{float(x):.9g}" for x in numbers)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _unit_bearing(
    length_over_diameter: float, openings: Sequence[Opening], grid: tuple[int, int]
) -> Bearing:
    """Radius and pressure scale of one: its scaled pressures are pascals."""
    return Bearing(
        radius_m=1.0,
        length_m=2 * length_over_diameter,
        clearance_m=_CLEARANCE,
        viscosity_Pa_s=_CLEARANCE**2 / 12,
        speed_rad_s=0.0,
        rupture="full",
        feed=tuple(
            FeedPatch(
                "orifice" if one.elliptic else "groove",
                one.angle_rad,
                one.width_rad,
                one.length_m,
                1.0,
                one.axial_m,
            )
            for one in openings
        ),
        grid=grid,
    )


def _columns(bearing: Bearing, eps: float, alpha: float) -> Floats:
    """One node of the table.

    Scaled: H by `h^-3`, G by `h^1.5` of either opening, which leaves smooth functions.
    """
    radial = np.array([np.cos(alpha), np.sin(alpha)])
    axes = np.array([radial, [-radial[1], radial[0]]])
    place = eps * bearing.clearance_m * radial
    films = [unsolved_film(bearing, place, bearing.clearance_m * axis) for axis in axes]
    film, count = films[0], len(bearing.feed)
    fields, flows = _unit_fields(
        film.mesh.fixed,
        np.asarray(film.mesh.place),
        film.around,
        film.axial,
        np.array([one.supply for one in films]),
        count,
    )
    gain, drawn = flows[:count].T, flows[count:].T
    gain = (gain + gain.T) / 2
    hydro = -np.linalg.solve(gain, drawn)
    height = np.array([1 - eps * np.cos(alpha - f.angle_rad) for f in bearing.feed])
    columns = np.empty(EACH * count + count * (count + 1) // 2)
    for k in range(count):
        at = EACH * k
        columns[at : at + 2] = hydro[k] * height[k] ** 3
        columns[at + 2 : at + EACH] = _stations(film, fields[k], STATIONS, 0.0)
    lower = np.tril_indices(count)
    scaled = gain * film.mesh.copies / np.outer(height**1.5, height**1.5)
    columns[EACH * count :] = scaled[lower]
    return columns


def _stations(film: SolvedFilm, field: Floats, count: int, start: float) -> Floats:
    """Mean over the width of each of `STATIONS` of the integral along the axis, at `count` places
    around from angle `start` on."""
    mesh = film.mesh
    line = field @ mesh.z_weight * mesh.copies
    angle = np.append(mesh.theta, mesh.theta[0] + 2 * np.pi)
    line = np.append(line, line[0])
    steps = np.diff(angle) * (line[1:] + line[:-1]) / 2
    summed = np.append(0.0, np.cumsum(steps))
    turn = summed[-1]

    def integral(at: Floats) -> Floats:
        laps = np.floor((at - angle[0]) / (2 * np.pi))
        return np.asarray(np.interp(at - 2 * np.pi * laps, angle, summed) + laps * turn)

    width = 2 * np.pi / STATIONS
    middle = start + 2 * np.pi * np.arange(count) / count
    return np.asarray((integral(middle + width / 2) - integral(middle - width / 2)) / width)


def _bare(bearing: Bearing, eps: float, count: int) -> Floats:
    """The unfed full film around from the direction of the journal on, for a unit velocity along it
    and across, shape (count, 2)."""
    place = np.array([eps * bearing.clearance_m, 0.0])
    films = [unsolved_film(bearing, place, bearing.clearance_m * axis) for axis in np.eye(2)]
    fields, _ = _unit_fields(
        films[0].mesh.fixed,
        np.asarray(films[0].mesh.place),
        films[0].around,
        films[0].axial,
        np.array([one.supply for one in films]),
        0,
    )
    return np.column_stack([_stations(films[0], field, count, 0.0) for field in fields])


def _wrapped(values: Floats) -> Floats:
    """Spline coefficients through values (eps, turn, columns)."""
    whole = ring_coefficients(line_coefficients(values, 0), 1)
    around = np.arange(-1, values.shape[1] + 2)
    return np.ascontiguousarray(whole.take(around, axis=1, mode="wrap"))


@allocating
def _unit_fields(
    fixed: np.ndarray,
    place: np.ndarray,
    around: Floats,
    axial: Floats,
    supplies: Floats,
    count: int,
) -> tuple[Floats, Floats]:
    """Full films at unit pressure of each opening, then at each supply of the walls, without
    pressure at the ends; and the flow out of each opening in each of them, (fields, openings)."""
    n, m = fixed.shape
    sides = count + supplies.shape[0]
    none, ring = np.zeros((n, m)), np.zeros((n, m), np.bool_)
    band, rhs = np.empty((n * m, 4 * m + 1)), np.zeros((n * m, 1 + sides))
    _assemble(
        none, fixed, place, ring, around, axial, none, none, none, 1, 0.0, False, band,
        rhs[:, : 1 + count],
    )  # fmt: skip
    for s in range(supplies.shape[0]):
        for i in range(n):
            for j in range(m):
                if not fixed[i, j]:
                    rhs[fold(i, n) * m + j, 1 + count + s] = supplies[s, i, j]
    eliminate_many(band, rhs)
    fields, flows = np.empty((sides, n, m)), np.zeros((sides, count))
    void = np.empty((n, m))
    for s in range(sides):
        _spread(1 + s, rhs, fixed, ring, 0.0, False, fields[s], void)
        _feed_flows(fields[s], none, place, around, axial, none, 1, flows[s])
        if s >= count:
            for i in range(n):
                for j in range(m):
                    if place[i, j] >= 0:
                        flows[s, place[i, j]] -= supplies[s - count, i, j]
    return fields, flows
