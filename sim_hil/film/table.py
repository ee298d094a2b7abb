"""Table of the unfed Reynolds film: at one length over diameter the force is a function of two
numbers.

They are the eccentricity ratio and the angle from the eccentricity to the effective squeeze
velocity; speed, viscosity, clearance and radius scale out exactly. `table_kernel` evaluates it.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sim_hil.whole_file import whole_file

from .bearing import Bearing
from .force import pressure_force, side_flow
from .pressure import unsolved_film
from .records import FilmError, FilmNotConverged, Floats
from .solver import solve_pressure
from .spline import line_coefficients, ring_coefficients
from .table_kernel import EPS_TABLE, table_force

__all__ = ["FilmTable", "table_force"]

_DATA = Path(__file__).parent / "data"
_RATE_STEP = 0.01
SHAPES = (0.1, 0.13, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
"""Lengths over diameters of the shipped tables, from the least to the greatest that a machine may
have."""
CELLS, GRID = (40, 56), (96, 12)
"""Of a standard table: cells of eccentricity and angle, and its coarser film mesh."""


@dataclass(frozen=True)
class FilmTable:
    """Spline coefficients for `table_kernel.table_force`.

    Parameters
    ----------
    length_over_diameter
        The one bearing shape that the table holds for.
    coefficients
        Uniform bicubic B-spline coefficients, shape (cells of -log(1 - eps) + 3, cells of the angle
        + 3, 5).
    """

    length_over_diameter: float
    coefficients: Floats

    @classmethod
    def build(
        cls,
        length_over_diameter: float,
        cells: tuple[int, int] | None = None,
        grid: tuple[int, int] | None = None,
    ) -> "FilmTable":
        """Compute the table with `film_force`, extrapolated from `grid` and twice that grid
        (Richardson).

        Some seven thousand film solutions at each grid with the standard cells: about a minute.
        """
        values = _reduced_film(length_over_diameter, *_nodes(cells or CELLS), grid or GRID)
        return cls(length_over_diameter, _spline_coefficients(values))

    @classmethod
    def load(cls, length_over_diameter: float) -> "FilmTable":
        """The shipped table of that shape, or the cubic through the four nearest ones.

        Every tabulated value is smooth in the logarithm of the shape: forces and flows between the
        shipped ones are within 1e-3 of the film, as those of a table of their own are.

        Raises
        ------
        FilmError
            No bearing of that shape is described.
        """
        low, high = SHAPES[0], SHAPES[-1]
        if not low <= length_over_diameter <= high:
            raise FilmError(
                f"length/diameter {length_over_diameter:g}: films are tabulated from {low:g} to "
                f"{high:g}; correct bearing.length_m or bearing.journal_radius_m"
            )
        if length_over_diameter in SHAPES:
            return _read(_DATA / _file_name(length_over_diameter))
        first = min(max(bisect_right(SHAPES, length_over_diameter) - 2, 0), len(SHAPES) - 4)
        near = SHAPES[first : first + 4]
        mixed = sum(
            weight * _read(_DATA / _file_name(shape)).coefficients
            for weight, shape in zip(_lagrange(near, length_over_diameter), near, strict=True)
        )
        return cls(length_over_diameter, np.ascontiguousarray(mixed))

    def nodes(self) -> tuple[Floats, Floats]:
        """Eccentricity ratios and angles, rad, that the table goes through."""
        return _nodes((self.coefficients.shape[0] - 3, self.coefficients.shape[1] - 3))

    def with_film(self, force: Floats, flow: Floats, velocity: Floats) -> "FilmTable":
        """The film of another model, with this table's answer to a moving clearance.

        Parameters
        ----------
        force, flow, velocity
            Scaled force (eps, gamma, 2) and flow (eps, gamma) at the nodes, with the eccentricity
            along x, at the unit squeeze velocity (eps, gamma, 2).
        """
        values = _logarithms(force, flow, velocity)
        values = np.concatenate([values, np.zeros((*flow.shape, 2))], axis=-1)
        film = _spline_coefficients(values)[..., :3]
        joined = np.concatenate([film, self.coefficients[..., 3:]], axis=-1)
        return FilmTable(self.length_over_diameter, np.ascontiguousarray(joined))

    def save(self, folder: Path = _DATA) -> Path:
        """Write the table where `load` finds it; returns the file."""
        path = folder / _file_name(self.length_over_diameter)
        with whole_file(path) as stream:
            np.savez_compressed(
                stream,
                length_over_diameter=self.length_over_diameter,
                coefficients=self.coefficients,
            )
        return path


def _read(path: Path) -> FilmTable:
    with np.load(path) as stored:
        coefficients = np.asarray(stored["coefficients"], dtype=np.float64)
        return FilmTable(float(stored["length_over_diameter"]), np.ascontiguousarray(coefficients))


def _lagrange(shapes: tuple[float, ...], at: float) -> list[float]:
    """Weights of values at the shapes for the value at another, over their logarithms."""
    return [
        math.prod(math.log(at / other) / math.log(one / other) for other in shapes if other != one)
        for one in shapes
    ]


def _file_name(length_over_diameter: float) -> str:
    shape = f"{length_over_diameter:.9g}".replace(".", "p")
    return f"table_ld{shape}.npz"


def _nodes(cells: tuple[int, int]) -> tuple[Floats, Floats]:
    eps = -np.expm1(np.log1p(-EPS_TABLE) * np.arange(cells[0] + 1) / cells[0])
    return eps, np.pi * np.arange(cells[1] + 1) / cells[1]


def _reduced_film(
    length_over_diameter: float, eps: Floats, gamma: Floats, grid: tuple[int, int]
) -> Floats:
    """Table values (a, d, q, a', d') of `table_kernel`, shape (eps, gamma, 5)."""
    velocity = np.stack([np.cos(gamma), np.sin(gamma)], axis=-1)
    coarse, fine = (
        np.array([_squeezed(length_over_diameter, e, velocity, each) for e in eps])
        for each in (grid, (2 * grid[0], 2 * grid[1]))
    )
    found = (4 * fine - coarse) / 3
    still, opening, closing = (
        _logarithms(film[..., :2], film[..., 2], velocity) for film in np.moveaxis(found, 2, 0)
    )
    rates = (opening - closing)[..., :2] / (2 * _RATE_STEP)
    return np.concatenate([still, rates], axis=-1)


def _squeezed(
    length_over_diameter: float, eps: float, velocity: Floats, grid: tuple[int, int]
) -> Floats:
    """Scaled force and flow (Fx, Fy, Q) with the journal at `eps` on x, for each squeeze velocity
    of 1 m/s: without, with an opening and with a closing clearance, shape (velocity, 3, 3).

    What the walls deliver is linear in the velocities, and the mesh is that of the position alone:
    both are made once.
    """
    c = 1e-3
    bearing = Bearing(1.0, 2 * length_over_diameter, c, c**3 / 12, 0.0, grid=grid)
    place = np.array([c * eps, 0.0])
    film, across = (unsolved_film(bearing, place, v) for v in np.eye(2))
    widening = unsolved_film(replace(bearing, clearance_rate_m_s=_RATE_STEP), place, np.zeros(2))
    rows = []
    ruptured = np.zeros((3, *film.supply.shape), dtype=bool)
    for vx, vy in velocity:
        for k, share in enumerate((0.0, 1.0, -1.0)):
            supply = vx * film.supply + vy * across.supply + share * widening.supply
            pressure = film.pressure.copy()
            if not solve_pressure(
                pressure, film.mesh.fixed, film.around, film.axial, supply, 0.0, ruptured[k], True
            ):
                raise FilmNotConverged(
                    f"rupture boundary not settled at eccentricity ratio {eps:.6g}"
                )
            solved = replace(film, pressure=pressure, supply=supply)
            force = pressure_force(solved) * bearing.pressure_scale_Pa_s
            rows.append([*force, side_flow(bearing, solved)])
    return np.array(rows).reshape(-1, 3, 3)


def _logarithms(force: Floats, flow: Floats, velocity: Floats) -> Floats:
    """Log of the force, its turn from the direction against the velocity, and the flow."""
    turn = np.arctan2(force[..., 1], force[..., 0]) - np.arctan2(
        -velocity[..., 1], -velocity[..., 0]
    )
    turn = np.remainder(turn + np.pi, 2 * np.pi) - np.pi
    turn[:, [0, -1]] = 0.0
    return np.stack([np.log(np.hypot(force[..., 0], force[..., 1])), turn, flow], axis=-1)


def _spline_coefficients(values: Floats) -> Floats:
    """Uniform cubic B-spline coefficients through values (eps, gamma, 5), one more on each side and
    a spare."""
    even = np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    whole_turn = np.concatenate([values, even * values[:, -2:0:-1]], axis=1)
    ring = ring_coefficients(line_coefficients(whole_turn, 0), 1)
    around = np.arange(-1, values.shape[1] + 1)
    return np.ascontiguousarray(ring[:, around % whole_turn.shape[1]])
