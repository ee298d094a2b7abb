"""Table of the unfed Reynolds film: at one length over diameter the force is a function of two
numbers.

They are the eccentricity ratio and the angle from the eccentricity to the effective squeeze
velocity; speed, viscosity, clearance and radius scale out exactly. `table_kernel` evaluates it.
"""

import fcntl
import hashlib
import os
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from sim_hil.whole_file import whole_file

from .force import film_force
from .records import FilmError, Floats
from .spline import line_coefficients, ring_coefficients
from .table_kernel import EPS_TABLE, table_force

__all__ = ["FilmTable", "table_force"]

_DATA = Path(__file__).parent / "data"
_RATE_STEP = 0.01
_SOURCES = ("bearing", "force", "mesh", "pressure", "records", "solver", "spline", "table")
SHAPES = (0.1, 2.0)
"""Lengths over diameters that a machine may have."""
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
        """The table of that shape: the shipped one, else one that is computed once and kept in the
        user's cache.

        Raises
        ------
        FilmError
            No bearing of that shape is described.
        """
        low, high = SHAPES
        if not low <= length_over_diameter <= high:
            raise FilmError(
                f"length/diameter {length_over_diameter:g}: films are tabulated from {low:g} to "
                f"{high:g}; correct bearing.length_m or bearing.journal_radius_m"
            )
        path = _DATA / _file_name(length_over_diameter)
        if not path.exists():
            path = _kept(length_over_diameter)
        with np.load(path) as stored:
            return cls(
                float(stored["length_over_diameter"]), np.ascontiguousarray(stored["coefficients"])
            )

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


def _kept(length_over_diameter: float) -> Path:
    """The table of a shape that is not shipped: computed by one process, which others wait for."""
    folder = _cache()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / _file_name(length_over_diameter)
    with (folder / f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            print(
                f"film of length/diameter {length_over_diameter:g}: computed once, a minute or two",
                file=sys.stderr,
            )
            FilmTable.build(length_over_diameter).save(folder)
    return path


@cache
def _cache() -> Path:
    """One folder for each state of the sources that a table depends on."""
    digest = hashlib.sha256(repr((CELLS, GRID)).encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        if source.stem in _SOURCES:
            digest.update(source.read_bytes())
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "orbitd" / f"film-{digest.hexdigest()[:16]}"


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
    still = _polar(length_over_diameter, eps, gamma, grid, 0.0)
    opening = _polar(length_over_diameter, eps, gamma, grid, _RATE_STEP)
    closing = _polar(length_over_diameter, eps, gamma, grid, -_RATE_STEP)
    rates = (opening - closing)[..., :2] / (2 * _RATE_STEP)
    return np.concatenate([still, rates], axis=-1)


def _polar(
    length_over_diameter: float, eps: Floats, gamma: Floats, grid: tuple[int, int], rate: float
) -> Floats:
    """Log of the scaled force, its turn from the direction against v_s, and the scaled flow at
    |v_s| = 1 m/s."""
    c = 1e-3
    position = np.zeros((eps.size, gamma.size, 2))
    position[..., 0] = c * eps[:, None]
    velocity = np.stack(np.broadcast_arrays(np.cos(gamma), np.sin(gamma)), axis=-1)
    coarse, fine = (
        film_force(
            position,
            velocity,
            radius_m=1.0,
            length_m=2 * length_over_diameter,
            clearance_m=c,
            viscosity_Pa_s=c**3 / 12,
            speed_rad_s=0.0,
            clearance_rate_m_s=rate,
            grid=(k * grid[0], k * grid[1]),
        )
        for k in (1, 2)
    )
    force = (4 * fine.force_N - coarse.force_N) / 3
    flow = (4 * fine.side_flow_m3_s - coarse.side_flow_m3_s) / 3
    return _logarithms(force, flow, velocity)


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
