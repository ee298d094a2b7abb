"""What goes into and comes out of the fluid-film model.

Frame: x right, y up, angles and speed positive from x to y. Forces act on the journal, clearances
are radial, `z` runs along the axis from the middle plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Required, TypedDict

import numpy as np
from numpy.typing import NDArray

from firmware_py.machine.restrictor import NONE, Restrictor

if TYPE_CHECKING:
    from .bore import PadBore

Floats = NDArray[np.float64]
Rupture = Literal["full", "gumbel", "reynolds", "jfo"]
Inlet = Literal["periodic", "groove_hmax"]
Couette = Literal["full", "filled"]


class FilmError(ValueError):
    """The film cannot be computed; the message names the cause, the value and the limit."""


class JournalOutsideClearance(FilmError):
    """The journal touches or leaves the bearing: there is no film to compute."""


class FilmNotConverged(FilmError):
    """The rupture boundary or the equilibrium did not settle."""


@dataclass(frozen=True)
class FeedPatch:
    """A supply port, at its supply pressure or behind a restrictor.

    Parameters
    ----------
    kind
        `groove`: a rectangle of `width_rad` times `length_m`; `orifice`: an ellipse of these two
        diameters, computed as the rectangle of equal area and aspect.
    angle_rad, width_rad
        Centre and circumferential extent, rad.
    length_m
        Axial extent, m.
    pressure_Pa
        Pressure of the supply, Pa; without a restrictor that of the port.
    axial_m
        Centre along the axis, m, from the middle plane.
    restrictor
        What stands between supply and port.
    """

    kind: Literal["groove", "orifice"]
    angle_rad: float
    width_rad: float
    length_m: float
    pressure_Pa: float
    axial_m: float = 0.0
    restrictor: Restrictor = NONE

    @property
    def restricted(self) -> bool:
        """Whether the port's pressure is another than that of the supply."""
        return any((*self.restrictor[:4],))


class FilmRules(TypedDict, total=False):
    """The film arguments of `film_force` that stay the same over a batch of equilibria."""

    radius_m: Required[float]
    length_m: Required[float]
    rupture: Rupture
    inlet: Inlet
    feed: Sequence[FeedPatch]
    end_pressure_Pa: tuple[float, float]
    cavitation_pressure_Pa: float
    couette: Couette
    clearance_rate_m_s: float
    grid: tuple[int, int]
    pads: "PadBore | None"
    density_kg_m3: float


class FilmArguments(FilmRules, total=False):
    """The film arguments of `film_force` that describe bearing, oil and rules, for functions that
    pass them on."""

    clearance_m: Required[float]
    viscosity_Pa_s: Required[float]
    speed_rad_s: Required[float]


@dataclass(frozen=True)
class FilmMemory:
    """Fill of the film one time step ago; the JFO film needs it to follow a moving journal.

    Parameters
    ----------
    dt_s
        Time since the fill was that, s.
    fill
        Liquid share of the gap, shape (..., theta, z) on the grid of the call that returned it; or
        a number.
    feed_pressure_Pa
        Pressure in each feed's port then, Pa, shape (..., feeds); None: no feed stores anything.
    """

    dt_s: float
    fill: Floats | float = 1.0
    feed_pressure_Pa: Floats | None = None


@dataclass(frozen=True)
class FilmForce:
    """Film force on the journal and what belongs to it; leading axes are the batch.

    Parameters
    ----------
    force_N
        Force on the journal (x, y), N, shape (..., 2).
    friction_torque_N_m
        Film torque on the journal against its rotation (positive = braking, for either sense), N m.
        At zero speed: against the positive sense. Dissipated power is `torque * |speed| - force .
        velocity`.
    side_flow_m3_s
        Flow out of both ends, m3/s.
    inflow_m3_s
        Flow from the feeds into the film, m3/s.
    min_film_m, max_pressure_Pa
        Smallest gap, m, and highest pressure, Pa.
    memory
        For the next step of a film with memory, else None.
    feed_pressure_Pa, feed_flow_m3_s
        Pressure in each feed's port, Pa, and flow out of it, m3/s, shape (..., feeds); None without
        a restrictor.
    pressure_Pa, fill, theta_rad, z_m
        Fields, shape (..., theta, z) and their coordinates (..., theta), (..., z), when asked for.
    """

    force_N: Floats
    friction_torque_N_m: Floats
    side_flow_m3_s: Floats
    inflow_m3_s: Floats
    min_film_m: Floats
    max_pressure_Pa: Floats
    memory: FilmMemory | None = None
    feed_pressure_Pa: Floats | None = None
    feed_flow_m3_s: Floats | None = None
    pressure_Pa: Floats | None = None
    fill: Floats | None = None
    theta_rad: Floats | None = None
    z_m: Floats | None = None
