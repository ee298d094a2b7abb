"""What the compiled plant needs, grouped by part: named tuples of numbers, free of reference
counts.

Frame: x right, y up, z along the axis from the coupling to the bearing; angles and speed positive
from x to y.  SI throughout.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Two = tuple[float, float]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Six = tuple[float, float, float, float, float, float]
Eight = tuple[float, float, float, float, float, float, float, float]

N_SENSORS: Final = 8
N_TRUTH: Final = 14
TRUTH_COLUMNS: Final = (
    "angle_rad",
    "speed_rad_s",
    "load_N",
    "clearance_m",
    "pressure_Pa",
    "oil_C",
    "viscosity_Pa_s",
    "eccentricity_x_m",
    "eccentricity_y_m",
    "min_film_m",
    "shaft_power_W",
    "side_flow_m3_s",
    "film_force_x_N",
    "film_force_y_N",
)
"""Columns of the truth at each sampling instant; the angle runs on over the turns."""


class Foot(NamedTuple):
    """One body on four bolts (:mod:`sim_hil.rotor.joints`); fours have one entry per bolt."""

    mass: float
    inertia: float
    depth: float
    axis_height: float
    x: Four
    stiffness: Four
    damping: Four
    clamp: Four
    gap: Four
    tangential_share: float
    friction: float
    bolt_stiffness: float


class Shaft(NamedTuple):
    """Rigid rotor: mass, inertias, distances to coupling and bearing, coupling, unbalance at the
    bearing."""

    mass: float
    diametral: float
    polar: float
    to_coupling: float
    to_bearing: float
    coupling_stiffness: float
    coupling_damping: float
    unbalance: float
    unbalance_angle: float


class FilmParameters(NamedTuple):
    """Bearing and oil (:mod:`sim_hil.rotor.bearing`).

    ``share`` is the part of the film that is filled, ``wear`` adds radial clearance, and ``drop``
    is how far wear has moved the middle of the bore in the direction of the load; the pads are
    those of :class:`sim_hil.film.pad_shape.PadShape`, none in a round bore.
    """

    radius: float
    length: float
    viscosity: float
    viscosity_slope: float
    reference_C: float
    inlet_C: float
    heat_capacity_per_m3: float
    thermal_capacity: float
    jacket_flow: float
    share: float
    wear: float
    drop: float
    pressure_needed: float
    windage: float
    thermal: float
    pads: float
    pad_angle: float
    pad_half_arc: float
    pad_shift: float
    pad_nearest: float


class FilmOil(NamedTuple):
    """The oil in the film now: viscosity, Pa s, share of the film that it fills, that bears, and
    supply, Pa."""

    viscosity: float
    filled: float
    bears: float
    supply: float


class Excite(NamedTuple):
    """Forces beside the unbalance; ``misaligned_kg_m`` runs round at twice the speed,
    ``misaligned_N_m`` stands.

    ``rub``: a stator ring around the shaft at the bearing (:mod:`sim_hil.rotor.stator`).
    """

    motor_unbalance: float
    motor_angle: float
    line_force: float
    line_rad_s: float
    tooth_force: float
    teeth: float
    ambient: float
    misaligned_kg_m: float
    misaligned_N_m: float
    rub_gap: float
    rub_clearance: float
    rub_stiffness: float
    rub_friction: float


class ContactParameters(NamedTuple):
    """Circuit of the contact channel: its voltage, V, series resistor, ohm, and the film's
    resistance over the smallest film, ohm/m."""

    volt: float
    ohm: float
    film_ohm_per_m: float


class Pickup(NamedTuple):
    """How motion becomes sensor signals; ``lag_share`` is how far each sensor follows in one step,
    ``probe`` the directions (x, y) in which the two displacement probes look."""

    probe: tuple[Two, Two]
    mode_rad_s: Three
    mode_damping: float
    mode_gain: float
    roughness: float
    sound: float
    tooth_sound: float
    lag_share: Eight
    runout_cos: tuple[Three, Three]
    runout_sin: tuple[Three, Three]
    contact: ContactParameters


class ActuatorParameters(NamedTuple):
    """Clearance and pressure actuator; ``pressure_gain`` below 1 is a lost supply.

    ``shut_off``, Pa, at no flow and ``flow_max``, m3/s, at no pressure are the ends of what the
    pump gives; ``hold_up``, s, is the time constant after its loss (0: that of the pressure).
    """

    rate: float
    time_constant: float
    backlash: float
    pressure_dead_time: float
    pressure_time_constant: float
    pressure_slew: float
    pressure_gain: float
    shut_off: float
    flow_max: float
    hold_up: float


class Plant(NamedTuple):
    """All parameters of one build with its present faults."""

    shaft: Shaft
    pedestal: Foot
    motor: Foot
    film: FilmParameters
    excite: Excite
    pickup: Pickup
    act: ActuatorParameters


class State(NamedTuple):
    """Everything that changes; advanced in place by the kernel.

    ``q``, ``v``: rotor x, y, tilt dx/dz, tilt dy/dz; pedestal x, y, roll; motor x, y, roll. ``a``:
    their accelerations in the last step.  ``slip``: slip of the eight feet.  ``mode``: three
    housing modes, position and velocity.  ``lag``: sensor lags.  ``ring``: anti-alias history, each
    instant stored twice.  ``film``: slopes of the film force, and 1 where they are stale
    (:mod:`sim_hil.rotor.film_step`).
    ``ahead``: velocities at the instant of the positions, forecast from ``a``. ``scalar``: the
    named indices below.
    """

    q: Floats
    v: Floats
    a: Floats
    slip: Floats
    mode: Floats
    lag: Floats
    ring: Floats
    film: Floats
    ahead: Floats
    scalar: Floats


ANGLE: Final = 0
TIME: Final = 1
DEMAND: Final = 2
POSITION: Final = 3
CLEARANCE: Final = 4
PRESSURE: Final = 5
OIL: Final = 6
RING: Final = 7
MEAN_X: Final = 8
MEAN_Y: Final = 9
POWER: Final = 10
FLOW: Final = 11
TURNS: Final = 12
DELAY_PHASE: Final = 13
DELAY_AT: Final = 14
DELAY: Final = 15
N_DELAY: Final = 16
"""Pressure targets of the dead time, oldest at ``DELAY_AT``: a ring that a new one enters every
sixteenth of it."""
N_SCALARS: Final = DELAY + N_DELAY


def three(values: Iterable[float]) -> Three:
    """Three floats."""
    a, b, c = (float(x) for x in values)
    return a, b, c


def four(values: Iterable[float]) -> Four:
    """Four floats."""
    a, b, c, d = (float(x) for x in values)
    return a, b, c, d


def new_state(
    taps: int, clearance_m: float, pressure_Pa: float, oil_C: float, angle_rad: float
) -> State:
    """A machine at rest in the middle of its clearance, with ``taps`` instants of filter
    history."""
    scalar = np.zeros(N_SCALARS)
    scalar[[DEMAND, POSITION, CLEARANCE]] = clearance_m
    scalar[PRESSURE] = pressure_Pa
    scalar[DELAY:] = pressure_Pa
    scalar[OIL] = oil_C
    scalar[ANGLE] = angle_rad
    return State(
        q=np.zeros(10),
        v=np.zeros(10),
        a=np.zeros(10),
        slip=np.zeros(8),
        mode=np.zeros(6),
        lag=np.zeros(N_SENSORS),
        ring=np.zeros((2 * taps, N_SENSORS)),
        film=np.zeros(9),
        ahead=np.zeros(10),
        scalar=scalar,
    )
