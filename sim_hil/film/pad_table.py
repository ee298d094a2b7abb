"""Table of the film between fixed pads: `pad_kernel` says of what and evaluates it.

No table is shipped: that of a machine is computed once, a minute or two, and kept in the user's
cache.  Against the solver on a finer grid at random unseen states of a lemon of preload 0.5
(eccentricity to 0.9 of its reach, at rest and moving at up to 0.15 of c omega): error of the force
median 0.7 % of it, 90 % below 2 % and largest 7 % of it and 10 N together.
"""

from __future__ import annotations

import fcntl
import hashlib
import math
import os
import sys
from dataclasses import astuple, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from sim_hil.whole_file import whole_file

from .bearing import Bearing
from .bore import PadBore
from .force import pressure_force, side_flow
from .pad_kernel import PadLaw
from .pad_shape import PadShape
from .pressure import SolvedFilm, pad_steps, unsolved_film
from .records import FilmNotConverged, Floats
from .solver import solve_pressure
from .spline import line_coefficients, ring_coefficients
from .table_kernel import EPS_TABLE

_CLEARANCE = 1e-3
_SOURCES = (
    "bearing",
    "bore",
    "force",
    "mesh",
    "pad_table",
    "pressure",
    "records",
    "solver",
    "spline",
)
CELLS = (20, 48, 28, 8)
"""Of eccentricity, of the whole turn around the bore, of the turn from the eccentricity, and of the
share of the pads' own wedge."""
GRID = (96, 14)


@dataclass(frozen=True)
class PadTable:
    """Spline coefficients for `pad_kernel.pad_force`, as in `PadLaw`."""

    bore: PadBore
    length_over_diameter: float
    size: Floats
    share: Floats

    @classmethod
    def build(
        cls,
        bore: PadBore,
        length_over_diameter: float,
        cells: tuple[int, int, int, int] | None = None,
        grid: tuple[int, int] | None = None,
    ) -> PadTable:
        """Solve the film at every node: some 0.3 ms each, a hundred thousand with the
        standard cells."""
        n_eps, around, n_gamma, n_tau = cells or CELLS
        n_alpha = max(6, math.ceil(around / bore.count))
        aligned = replace(bore, angle_rad=0.0)
        eps = -np.expm1(np.log1p(-EPS_TABLE) * np.arange(n_eps + 1) / n_eps)
        pitch = 2 * math.pi / bore.count
        alpha = pitch * np.arange(n_alpha) / n_alpha - pitch / 2
        gamma = 2 * math.pi * np.arange(n_gamma) / n_gamma
        tau = np.arange(n_tau + 1) / n_tau
        length = 2 * length_over_diameter
        bearing = Bearing(
            1.0,
            length,
            _CLEARANCE,
            _CLEARANCE**2 / 12,
            0.0,
            feed=aligned.grooves(length),
            grid=grid or GRID,
            pads=aligned,
        )
        values = np.array([[_turns(bearing, e, a, gamma, tau) for a in alpha] for e in eps])
        # with the wedge's friction, which stands where the forces of equal pads cancel
        square = np.mean(np.sum(values[..., [0, 1, 3]] ** 2, axis=-1), axis=1)
        size = 0.5 * np.log(square + 1e-4 * square.max(axis=-1, keepdims=True))
        values[..., [0, 1, 3]] /= np.exp(size)[:, None, :, :, None]
        return cls(bore, length_over_diameter, _size_coefficients(size), _coefficients(values))

    @classmethod
    def load(cls, bore: PadBore, length_over_diameter: float) -> PadTable:
        """The table of that bore: computed once by one process, which others wait for."""
        aligned = replace(bore, angle_rad=0.0)
        name = hashlib.sha256(repr((astuple(aligned), length_over_diameter)).encode()).hexdigest()
        folder = _cache()
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"pads_{name[:16]}.npz"
        with (folder / f"{path.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                print(
                    f"film of {bore.count} pads, length/diameter {length_over_diameter:g}: "
                    "computed once, a minute or two",
                    file=sys.stderr,
                )
                built = cls.build(aligned, length_over_diameter)
                with whole_file(path) as stream:
                    np.savez_compressed(stream, size=built.size, share=built.share)
        with np.load(path) as stored:
            size, share = (np.ascontiguousarray(stored[name]) for name in ("size", "share"))
            return cls(bore, length_over_diameter, size, share)

    @property
    def law(self) -> PadLaw:
        """What `pad_force` needs."""
        return PadLaw(shape_of(self.bore), self.size, self.share)


def shape_of(bore: PadBore | None) -> PadShape:
    """The numbers of a bore for the kernels."""
    if bore is None:
        return PadShape(0, 0.0, 0.0, 0.0, 0.0)
    return PadShape(
        bore.count,
        float(bore.angle_rad),
        0.5 * bore.arc_rad,
        bore.shift,
        (bore.offset - 0.5) * bore.arc_rad,
    )


@cache
def _cache() -> Path:
    """One folder for each state of the sources that a table depends on."""
    digest = hashlib.sha256(repr((CELLS, GRID)).encode())
    for name in _SOURCES:
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "orbitd" / f"pads-{digest.hexdigest()[:16]}"


def _turns(bearing: Bearing, eps: float, alpha: float, gamma: Floats, tau: Floats) -> Floats:
    """Scaled (F_r, F_t, Q, wedge's friction) with the journal there, shape (gamma, tau, 4)."""
    assert bearing.pads is not None
    radial = np.array([math.cos(alpha), math.sin(alpha)])
    axes = np.array([radial, [-radial[1], radial[0]]])
    place = eps * bearing.pads.reach(alpha) * bearing.clearance_m * radial
    film, across = (unsolved_film(bearing, place, bearing.clearance_m * axis) for axis in axes)
    steps = pad_steps(bearing.pads, film.mesh)
    wedge = np.zeros(film.supply.shape)
    if bearing.pads.shift > 0.0:
        wedge = -(steps / bearing.pads.shift)[:, None] * film.mesh.z_width
    rows = []
    ruptured = np.zeros((tau.size, *film.supply.shape), dtype=bool)
    for g in gamma.tolist():
        squeeze = math.cos(g) * film.supply + math.sin(g) * across.supply
        for k, share in enumerate(tau.tolist()):
            supply = (1 - share) * squeeze + share * wedge
            rows.append(_solved(bearing, film, supply, ruptured[k], axes, steps))
    return np.array(rows).reshape(gamma.size, tau.size, 4)


def _solved(
    bearing: Bearing,
    film: SolvedFilm,
    supply: Floats,
    ruptured: np.ndarray,
    axes: Floats,
    steps: Floats,
) -> list[float]:
    """The values of one film; `ruptured` is the guess and the answer."""
    mesh, pressure = film.mesh, film.pressure.copy()
    if not solve_pressure(
        pressure, mesh.fixed, film.around, film.axial, supply, 0.0, ruptured, True
    ):
        raise FilmNotConverged("rupture boundary not settled between pads")
    solved = replace(film, pressure=pressure, supply=supply)
    force = axes @ pressure_force(solved)
    line = pressure @ mesh.z_weight * mesh.copies
    flow = side_flow(bearing, solved) / bearing.clearance_m
    return [*force, flow, float(line @ steps) / 2]


def _size_coefficients(size: Floats) -> Floats:
    """Through values (eps, gamma, tau)."""
    whole = ring_coefficients(size, 1).take(np.arange(-1, size.shape[1] + 2), axis=1, mode="wrap")
    return np.ascontiguousarray(line_coefficients(line_coefficients(whole, 0), 2))


def _coefficients(values: Floats) -> Floats:
    """Through values (eps, alpha around a pad, gamma, tau, 4)."""
    whole = ring_coefficients(ring_coefficients(values, 1), 2)
    for axis in (1, 2):
        around = np.arange(-1, values.shape[axis] + 2)
        whole = whole.take(around, axis=axis, mode="wrap")
    return np.ascontiguousarray(line_coefficients(line_coefficients(whole, 0), 3))
