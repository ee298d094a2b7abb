"""Static equilibrium of the journal and the linear coefficients of the film around it."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from .balance import REST, direction, position_of_load, position_of_ratio
from .bearing import Bearing
from .force import evaluate, stack
from .records import FilmArguments, FilmError, FilmForce, FilmRules, Floats

_POSITION_STEP = 0.01
_VELOCITY_STEP = 0.05
_NEAR_WALL = 40.0
"""The velocity step follows the square of the gap from an eccentricity ratio of 0.85 on: one that
follows the eccentricity squeezes a thin film so hard that it ruptures elsewhere, and the damping
loses its symmetry (2.27 and 2.51 at 0.99)."""


@dataclass(frozen=True)
class Equilibrium:
    """Where the journal runs under a static load, and how the film resists small motions.

    Parameters
    ----------
    eccentricity_ratio, attitude_rad
        Eccentricity over clearance; angle from the load to the eccentricity, in the direction of
        rotation, rad.
    position_m, load_N
        Journal centre (x, y), m, and the load carried, N.
    sommerfeld
        `S = mu N L D / W (R/c)^2`, N in revolutions per second.
    friction_variable
        `(R/c) f` with `f = torque / (R W)`.
    film
        Force, torque, flows and smallest film there.
    stiffness_N_m, damping_N_s_m
        K and C, `F_i = -K_ij x_j - C_ij v_j`; axis 0 along the load, axis 1 at 90 degrees in the
        direction of rotation; shape (2, 2).
    stiffness, damping
        The same as `K c / W` and `C c omega / W`.
    whirl_ratio, threshold
        Whirl frequency over speed at the stability threshold of a rigid rotor, and `omega sqrt(c m
        / W)` there; NaN where the journal is stable at any speed (Lund 1966).
    """

    eccentricity_ratio: float
    attitude_rad: float
    position_m: Floats
    load_N: float
    sommerfeld: float
    friction_variable: float
    film: FilmForce
    stiffness_N_m: Floats
    damping_N_s_m: Floats
    stiffness: Floats
    damping: Floats
    whirl_ratio: float
    threshold: float

    @property
    def side_flow_m3_s(self) -> float:
        """Flow out of both ends, m3/s."""
        return float(self.film.side_flow_m3_s)


@dataclass(frozen=True)
class Equilibria:
    """The numbers of `Equilibrium` for a batch, which is their leading axes (attitude_rad: from -pi
    to pi)."""

    eccentricity_ratio: Floats
    attitude_rad: Floats
    position_m: Floats
    load_N: Floats
    sommerfeld: Floats
    friction_variable: Floats
    film: FilmForce
    stiffness_N_m: Floats
    damping_N_s_m: Floats
    stiffness: Floats
    damping: Floats
    whirl_ratio: Floats
    threshold: Floats

    @property
    def side_flow_m3_s(self) -> Floats:
        """Flow out of both ends, m3/s."""
        return self.film.side_flow_m3_s


@overload
def equilibrium(
    *,
    load_N: float | None = None,
    eccentricity_ratio: float | None = None,
    load_angle_rad: float = -np.pi / 2,
    **film: Unpack[FilmArguments],
) -> Equilibrium: ...


@overload
def equilibrium(
    *,
    clearance_m: ArrayLike,
    viscosity_Pa_s: ArrayLike,
    speed_rad_s: ArrayLike,
    load_N: ArrayLike | None = None,
    eccentricity_ratio: ArrayLike | None = None,
    load_angle_rad: ArrayLike = -np.pi / 2,
    **film: Unpack[FilmRules],
) -> Equilibria: ...


def equilibrium(
    *,
    clearance_m: ArrayLike,
    viscosity_Pa_s: ArrayLike,
    speed_rad_s: ArrayLike,
    load_N: ArrayLike | None = None,
    eccentricity_ratio: ArrayLike | None = None,
    load_angle_rad: ArrayLike = -np.pi / 2,
    **film: Unpack[FilmRules],
) -> Equilibrium | Equilibria:
    """Equilibrium under a given load, or at a given eccentricity ratio, with a load of given
    direction.

    Parameters
    ----------
    load_N, eccentricity_ratio
        One of the two: the static load on the journal, N, or the eccentricity over the clearance.
    load_angle_rad
        Direction of the load, rad; the default is downwards.
    clearance_m, viscosity_Pa_s, speed_rad_s, **film
        Bearing, oil and rules as in `film_force`. These three, the load, its angle and the
        eccentricity ratio may be arrays that broadcast: the answer is then `Equilibria`.

    Raises
    ------
    FilmError
        Both or neither given, out of range, or a film that carries no load.
    FilmNotConverged
        No equilibrium found, as for a load that is more than the film carries.
    """
    if (load_N is None) == (eccentricity_ratio is None):
        raise FilmError("give either load_N or eccentricity_ratio")
    asked = load_N if load_N is not None else eccentricity_ratio
    arrays = [
        np.asarray(a, dtype=np.float64)
        for a in (asked, load_angle_rad, clearance_m, viscosity_Pa_s, speed_rad_s)
    ]
    states = [_one(load_N is not None, film, *numbers) for numbers in np.broadcast(*arrays)]
    shape = np.broadcast_shapes(*(a.shape for a in arrays))
    return _stacked(states, shape) if shape else states[0]


def _one(
    by_load: bool,
    rules: FilmRules,
    asked: float,
    load_angle_rad: float,
    clearance_m: float,
    viscosity_Pa_s: float,
    speed_rad_s: float,
) -> Equilibrium:
    arguments: FilmArguments = {
        **rules,
        "clearance_m": float(clearance_m),
        "viscosity_Pa_s": float(viscosity_Pa_s),
        "speed_rad_s": float(speed_rad_s),
    }
    bearing = Bearing.of(arguments)
    bearing.check_memory(None)
    if not np.isfinite(load_angle_rad):
        raise FilmError(f"load_angle_rad = {load_angle_rad}: must be finite")
    if by_load:
        if not (np.isfinite(asked) and asked > 0):
            raise FilmError(f"load_N = {asked}: must be finite and above zero")
        position = position_of_load(bearing, asked * direction(load_angle_rad))
    else:
        if not 0 < asked < 1:
            raise FilmError(f"eccentricity_ratio = {asked}: must be above 0 and below 1")
        position = position_of_ratio(bearing, asked, load_angle_rad)
    return _describe(bearing, position, load_angle_rad)


def _stacked(states: list[Equilibrium], batch: tuple[int, ...]) -> Equilibria:
    """The numbers of many states as arrays."""
    if not states:
        raise FilmError(f"a batch of shape {batch} holds no state")
    numbers = {}
    for field in fields(Equilibria):
        if field.name != "film":
            values = np.stack([np.asarray(getattr(one, field.name)) for one in states])
            numbers[field.name] = values.reshape(batch + values.shape[1:])
    return Equilibria(film=stack([one.film for one in states], batch, False), **numbers)


def linear_coefficients(bearing: Bearing, position: Floats, axes: Floats) -> tuple[Floats, Floats]:
    """Stiffness and damping of the film at rest there, along the two orthonormal rows of `axes`,
    SI.

    Central differences, of second order in position and of fourth in velocity: with velocity the
    rupture boundary moves across the grid, whose grain a long step evens out (0.1 % of the largest
    coefficient at the standard grid).
    """
    c, e = bearing.clearance_m, float(np.hypot(*position))
    gap, own = bearing.gap_m(position), bearing.pads.shift * c if bearing.pads else 0.0
    reach = _POSITION_STEP * min(gap, max(4 * e, own, 1e-3 * c))
    supply = (
        max((abs(f.pressure_Pa) for f in bearing.feed), default=0.0) / bearing.pressure_scale_Pa_s
    )
    way = min(max(e, own, 1e-3 * c), _NEAR_WALL * gap**2 / c)
    rate = _VELOCITY_STEP * way * (abs(bearing.speed_rad_s) or supply or 1.0)

    def displaced(shift: Floats) -> Floats:
        return axes @ evaluate(bearing, position + shift, REST).force_N

    def moving(velocity: Floats) -> Floats:
        return axes @ evaluate(bearing, position, velocity).force_N

    def drop(at: Callable[[Floats], Floats], step: Floats) -> Floats:
        return (at(-step) - at(step)) / 2

    stiffness = [drop(displaced, reach * a) / reach for a in axes]
    damping = [
        (4 * drop(moving, rate * a) - drop(moving, 2 * rate * a) / 2) / (3 * rate) for a in axes
    ]
    return np.column_stack(stiffness), np.column_stack(damping)


def whirl_threshold(stiffness: Floats, damping: Floats) -> tuple[float, float]:
    """Whirl ratio and `omega sqrt(c m / W)` at the threshold from dimensionless K and C (Lund
    1966)."""
    (kxx, kxy), (kyx, kyy) = stiffness
    (cxx, cxy), (cyx, cyy) = damping
    effective = (kxx * cyy + kyy * cxx - kxy * cyx - kyx * cxy) / (cxx + cyy)
    squared = ((effective - kxx) * (effective - kyy) - kxy * kyx) / (cxx * cyy - cxy * cyx)
    if not (squared > 0 and effective > 0):
        return float("nan"), float("nan")
    return float(np.sqrt(squared)), float(np.sqrt(effective / squared))


def _wrapped(angle: float) -> float:
    return float(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


def _describe(bearing: Bearing, position: Floats, load_angle: float) -> Equilibrium:
    film = evaluate(bearing, position, REST)
    c, omega = bearing.clearance_m, abs(bearing.speed_rad_s)
    sense = -1.0 if bearing.speed_rad_s < 0 else 1.0
    load = float(np.hypot(*film.force_N))
    along = direction(load_angle)
    axes = np.array([along, sense * np.array([-along[1], along[0]])])
    stiffness, damping = linear_coefficients(bearing, position, axes)
    whirl_ratio, threshold = whirl_threshold(stiffness * c / load, damping * c * omega / load)
    return Equilibrium(
        eccentricity_ratio=float(np.hypot(*position) / c),
        attitude_rad=_wrapped(sense * (np.arctan2(position[1], position[0]) - load_angle)),
        position_m=position,
        load_N=load,
        sommerfeld=bearing.viscosity_Pa_s
        * omega
        / (2 * np.pi)
        * bearing.length_m
        * 2
        * bearing.radius_m
        / load
        * (bearing.radius_m / c) ** 2,
        friction_variable=float(film.friction_torque_N_m) / (load * c),
        film=film,
        stiffness_N_m=stiffness,
        damping_N_s_m=damping,
        stiffness=stiffness * c / load,
        damping=damping * c * omega / load,
        whirl_ratio=whirl_ratio,
        threshold=threshold,
    )
