"""Table of the film with one axial groove: `fed_kernel` says of what and evaluates it.

Tabulated is the difference to the unfed film, over the four numbers on which it depends at one
length over diameter and one shape of groove.

Shipped: the groove of the `bench` rig (L/D = 1/2, 20 degrees, 0.8 of the length). Against the
solver at random unseen states (eccentricity ratio to 0.95, supply 0.5 to 3 bar), error of the force
over the unfed force plus supply pressure times projected area: with the journal opposite the groove
median 0.15 %, largest 0.8 % (of the net force, where the two nearly cancel: 0.4 and 3.8 %);
anywhere median 0.15 %, 95 % below 1.2 %, largest 6 % with the journal close before the groove. Side
flow: median 0.3 %, 95 % below 2.5 %.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .bearing import Bearing
from .fed_kernel import FedLaw, fed_force
from .force import pressure_force, side_flow
from .pressure import SolvedFilm, unsolved_film
from .records import FeedPatch, FilmError, FilmNotConverged, Floats
from .solver import solve_pressure
from .spline import line_coefficients, ring_coefficients
from .table import FilmTable
from .table_kernel import EPS_TABLE

__all__ = ["FedLaw", "FedTable", "fed_force"]

_DATA = Path(__file__).parent / "data"
_CLEARANCE = 1e-3


@dataclass(frozen=True)
class FedTable:
    """Spline coefficients for `fed_kernel.fed_force`.

    Parameters
    ----------
    length_over_diameter, width_rad, length_share
        The bearing, and the extent of its groove: around, rad, and along, as a share of the
        bearing.
    groove
        As in `FedLaw`; the file holds it in single precision.
    """

    length_over_diameter: float
    width_rad: float
    length_share: float
    groove: Floats

    @classmethod
    def build(
        cls,
        length_over_diameter: float,
        width_rad: float,
        length_share: float,
        cells: tuple[int, int, int, int] = (14, 18, 24, 7),
        grid: tuple[int, int] = (80, 12),
    ) -> "FedTable":
        """Solve the film at every node of a table with that many cells: some three milliseconds
        each."""
        eps = -np.expm1(np.log1p(-EPS_TABLE) * np.arange(cells[0] + 1) / cells[0])
        alpha = np.pi * np.arange(cells[1] + 1) / cells[1]
        gamma = 2 * np.pi * np.arange(cells[2]) / cells[2]
        tau = np.arange(cells[3] + 1) / cells[3]
        groove = FeedPatch("groove", 0.0, width_rad, 2 * length_over_diameter * length_share, 1.0)
        bearing = Bearing(
            radius_m=1.0,
            length_m=2 * length_over_diameter,
            clearance_m=_CLEARANCE,
            viscosity_Pa_s=_CLEARANCE**2 / 12,
            speed_rad_s=0.0,
            feed=(groove,),
            grid=grid,
        )
        values = np.array([[_turns(bearing, e, a, gamma, tau) for a in alpha] for e in eps])
        return cls(length_over_diameter, width_rad, length_share, _coefficients(values))

    @classmethod
    def load(cls, length_over_diameter: float, width_rad: float, length_share: float) -> "FedTable":
        """The shipped table of that bearing and groove.

        Raises
        ------
        FilmError
            No such table is shipped.
        """
        path = _DATA / _file_name(length_over_diameter, width_rad, length_share)
        if not path.exists():
            shipped = sorted(p.name for p in _DATA.glob("fed_*.npz"))
            raise FilmError(
                f"no film table for length/diameter {length_over_diameter} and a groove of "
                f"{width_rad:g} rad and "
                f"{length_share:g} of the length (shipped: {shipped}); make one with FedTable.build"
            )
        with np.load(path) as stored:
            return cls(
                length_over_diameter,
                width_rad,
                length_share,
                np.ascontiguousarray(stored["groove"], dtype=np.float64),
            )

    def save(self, folder: Path = _DATA) -> Path:
        """Write the table where `load` finds it; returns the file."""
        path = folder / _file_name(self.length_over_diameter, self.width_rad, self.length_share)
        np.savez_compressed(path, groove=self.groove.astype(np.float32))
        return path

    def law(self, groove_angle_rad: float) -> FedLaw:
        """What `fed_force` needs, with the middle of the groove at that angle."""
        return FedLaw(
            FilmTable.load(self.length_over_diameter).coefficients,
            self.groove,
            float(groove_angle_rad),
        )


def _file_name(length_over_diameter: float, width_rad: float, length_share: float) -> str:
    numbers = (length_over_diameter, np.degrees(width_rad), length_share)
    return "fed_ld{}_w{}_l{}.npz".format(*(f"{n:.4g}".replace(".", "p") for n in numbers))


def _turns(bearing: Bearing, eps: float, alpha: float, gamma: Floats, tau: Floats) -> Floats:
    """(D_r, D_t, D_q) of `fed_kernel` with the journal there, shape (gamma, tau, 3); the groove is
    at angle zero."""
    radial = np.array([np.cos(alpha), np.sin(alpha)])
    axes = np.array([radial, [-radial[1], radial[0]]])
    place = eps * bearing.clearance_m * radial
    films = [unsolved_film(bearing, place, bearing.clearance_m * axis) for axis in axes]
    return np.array(
        [_one_turn(bearing, films, axes, np.array([np.cos(g), np.sin(g)]), tau) for g in gamma]
    )


def _one_turn(
    bearing: Bearing, films: list[SolvedFilm], axes: Floats, direction: Floats, tau: Floats
) -> Floats:
    """The values at one direction of the squeeze velocity, from no supply pressure to nothing else,
    (tau, 3).

    The bearing has a radius of one and a pressure scale of one, so that its scaled pressures are
    pascals.
    """
    film = replace(films[0], supply=direction[0] * films[0].supply + direction[1] * films[1].supply)
    ruptured = film.supply < 0
    ends = film.mesh.fixed & ~film.mesh.port
    unfed = _solved(film, 0.0, 1.0, ends, ruptured.copy())
    force, flow = pressure_force(unfed), side_flow(bearing, unfed)
    area = 2 * bearing.radius_m * bearing.length_m
    rows = []
    for share in tau:
        squeeze = (1 - share) / max(np.hypot(*force), 1e-300)
        supply_Pa = share / area
        total = squeeze + supply_Pa
        squeeze, supply_Pa = squeeze / total, supply_Pa / total
        fed = _solved(film, supply_Pa, squeeze, film.mesh.fixed, ruptured)
        scale = squeeze * np.hypot(*force) + area * supply_Pa
        more = axes @ (pressure_force(fed) - squeeze * force) / scale
        more_flow = (
            (side_flow(bearing, fed) - squeeze * flow) / bearing.clearance_m / (scale / area)
        )
        rows.append([*more, more_flow])
    return np.array(rows)


def _solved(
    film: SolvedFilm,
    supply_Pa: float,
    squeeze: float,
    held: NDArray[np.bool_],
    ruptured: NDArray[np.bool_],
) -> SolvedFilm:
    """The Reynolds film at that supply pressure and share of the squeeze; `ruptured` is the guess
    and the answer."""
    mesh = film.mesh
    pressure = np.where(mesh.port & held, supply_Pa, 0.0)
    supply = squeeze * film.supply
    if not solve_pressure(pressure, held, film.around, film.axial, supply, 0.0, ruptured, True):
        raise FilmNotConverged(
            f"rupture boundary not settled at supply {supply_Pa:.6g}, squeeze {squeeze:.6g}"
        )
    return replace(film, pressure=pressure, supply=supply)


def _coefficients(values: Floats) -> Floats:
    """Spline coefficients through values (eps, half turn from the groove, turn from the
    eccentricity, tau, 3)."""
    back = -np.arange(values.shape[2]) % values.shape[2]
    other_half = values[:, -2:0:-1, back] * np.array([1.0, -1.0, 1.0])
    half_turn = values.shape[1]
    whole = ring_coefficients(np.concatenate([values, other_half], axis=1), 1)
    whole = ring_coefficients(whole, 2)
    whole = whole.take(np.arange(-1, half_turn + 1), axis=1, mode="wrap")
    whole = whole.take(np.arange(-1, values.shape[2] + 2), axis=2, mode="wrap")
    return np.ascontiguousarray(line_coefficients(line_coefficients(whole, 0), 3))
