"""Static equilibrium of the journal and the linear coefficients of the film around it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from .bearing import Bearing
from .force import evaluate
from .records import FilmArguments, FilmError, FilmForce, FilmNotConverged, Floats

_MAX_STEPS = 60
_RING_STARTS = 36
_TOLERANCE = 1e-8
_REST = np.zeros(2)


@dataclass(frozen=True)
class Equilibrium:
    """Where the journal runs under a static load, and how the film resists small motions.

    Parameters
    ----------
    eccentricity_ratio, attitude_rad
        Eccentricity over clearance; angle from the load to the eccentricity, in the direction of rotation, rad.
    position_m, load_N
        Journal centre (x, y), m, and the load carried, N.
    sommerfeld
        `S = mu N L D / W (R/c)^2`, N in revolutions per second.
    friction_variable
        `(R/c) f` with `f = torque / (R W)`.
    film
        Force, torque, flows and smallest film there.
    stiffness_N_m, damping_N_s_m
        K and C, `F_i = -K_ij x_j - C_ij v_j`; axis 0 along the load, axis 1 at 90 degrees in the direction of
        rotation; shape (2, 2).
    stiffness, damping
        The same as `K c / W` and `C c omega / W`.
    whirl_ratio, threshold
        Whirl frequency over speed at the stability threshold of a rigid rotor, and `omega sqrt(c m / W)` there;
        NaN where the journal is stable at any speed (Lund 1966).
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


def equilibrium(
    *,
    load_N: float | None = None,
    eccentricity_ratio: float | None = None,
    load_angle_rad: float = -np.pi / 2,
    **film: Unpack[FilmArguments],
) -> Equilibrium:
    """Equilibrium under a given load, or at a given eccentricity ratio, with a load of given direction.

    Parameters
    ----------
    load_N, eccentricity_ratio
        One of the two: the static load on the journal, N, or the eccentricity over the clearance.
    load_angle_rad
        Direction of the load, rad; the default is downwards.
    **film
        Bearing, oil and rules as in `film_force`.

    Raises
    ------
    FilmError
        Both or neither given, out of range, or a film that carries no load.
    FilmNotConverged
        No equilibrium found.
    """
    bearing = Bearing.of(film)
    bearing.check_memory(None)
    if (load_N is None) == (eccentricity_ratio is None):
        raise FilmError("give either load_N or eccentricity_ratio")
    if not np.isfinite(load_angle_rad):
        raise FilmError(f"load_angle_rad = {load_angle_rad}: must be finite")
    if eccentricity_ratio is not None:
        if not 0 < eccentricity_ratio < 1:
            raise FilmError(f"eccentricity_ratio = {eccentricity_ratio}: must be above 0 and below 1")
        position = _position_of_ratio(bearing, eccentricity_ratio, load_angle_rad)
    else:
        assert load_N is not None
        if not (np.isfinite(load_N) and load_N > 0):
            raise FilmError(f"load_N = {load_N}: must be finite and above zero")
        position = _position_of_load(bearing, load_N * _direction(load_angle_rad))
    return _describe(bearing, position, load_angle_rad)


def linear_coefficients(bearing: Bearing, position: Floats, axes: Floats) -> tuple[Floats, Floats]:
    """Stiffness and damping of the film at rest there, along the two orthonormal rows of `axes`, SI.

    Central differences. The step spans several cells of the rupture boundary: smaller ones show its graininess.
    """
    gap = bearing.clearance_m - np.hypot(*position)
    step = 0.01 * gap
    rate = step * (abs(bearing.speed_rad_s) or 1.0)

    def slope(axis: Floats, reach: float, moves: bool) -> Floats:
        forces = [
            evaluate(bearing, position + s * (not moves) * axis, s * moves * axis).force_N for s in (-reach, reach)
        ]
        return axes @ (forces[0] - forces[1]) / (2 * reach)

    stiffness = np.column_stack([slope(axis, step, False) for axis in axes])
    damping = np.column_stack([slope(axis, rate, True) for axis in axes])
    return stiffness, damping


def whirl_threshold(stiffness: Floats, damping: Floats) -> tuple[float, float]:
    """Whirl ratio and `omega sqrt(c m / W)` at the threshold from dimensionless K and C (Lund 1966)."""
    (kxx, kxy), (kyx, kyy) = stiffness
    (cxx, cxy), (cyx, cyy) = damping
    effective = (kxx * cyy + kyy * cxx - kxy * cyx - kyx * cxy) / (cxx + cyy)
    squared = ((effective - kxx) * (effective - kyy) - kxy * kyx) / (cxx * cyy - cxy * cyx)
    if not (squared > 0 and effective > 0):
        return float("nan"), float("nan")
    return float(np.sqrt(squared)), float(np.sqrt(effective / squared))


def _direction(angle: float) -> Floats:
    return np.array([np.cos(angle), np.sin(angle)])


def _wrapped(angle: float) -> float:
    return float(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Root between two points of different sign (regula falsi, Illinois variant)."""
    f_low, f_high = function(low), function(high)
    while abs(high - low) > _TOLERANCE and f_low != f_high:
        middle = high - f_high * (high - low) / (f_high - f_low)
        value = function(middle)
        if value == 0 or abs(middle - high) < _TOLERANCE:
            return middle
        if value * f_high < 0:
            low, f_low = high, f_high
        else:
            f_low /= 2
        high, f_high = middle, value
    return high


def _position_of_ratio(bearing: Bearing, ratio: float, load_angle: float) -> Floats:
    """Turn the journal around the ring until the film opposes the load.

    Unfed the force turns with the journal: one turn. Feeds break that; then every attitude of the ring is tried
    and of several the one that carries most is taken.
    """

    def place(angle: float) -> Floats:
        return ratio * bearing.clearance_m * _direction(angle)

    def along_and_across(angle: float) -> Floats:
        force = evaluate(bearing, place(angle), _REST).force_N
        if not np.any(force):
            raise FilmError("the film carries no load: it has neither speed nor feed")
        x, y = _direction(load_angle)
        return np.array([[-x, -y], [-y, x]]) @ force

    if not bearing.feed:
        carried, across = along_and_across(load_angle)
        return place(load_angle + np.arctan2(across, carried))
    angles = load_angle + np.linspace(0, 2 * np.pi, _RING_STARTS + 1)
    across = [along_and_across(a)[1] for a in angles]
    roots = [
        _root(lambda a: float(along_and_across(a)[1]), angles[i], angles[i + 1])
        for i in range(_RING_STARTS)
        if across[i] * across[i + 1] <= 0
    ]
    carried, angle = max((along_and_across(a)[0], a) for a in roots)
    if carried <= 0:
        raise FilmNotConverged(f"no attitude carries a load at eccentricity ratio {ratio}: the feeds outweigh it")
    return place(angle)


def _position_of_load(bearing: Bearing, load: Floats) -> Floats:
    """Damped Newton iteration on the balance of film force and load."""
    c = bearing.clearance_m
    size = float(np.hypot(*load))
    position = _short_bearing_guess(bearing, load)
    balance = evaluate(bearing, position, _REST).force_N + load
    for _ in range(_MAX_STEPS):
        if np.hypot(*balance) < _TOLERANCE * size:
            return position
        axes = np.eye(2)
        reach = 1e-4 * (c - np.hypot(*position))
        columns = [evaluate(bearing, position + reach * a, _REST).force_N + load - balance for a in axes]
        step = _solved(np.column_stack(columns) / reach, -balance)
        gap = c - np.hypot(*position)
        step *= min(1.0, 0.6 * gap / max(np.hypot(*step), 1e-300))
        for _ in range(12):
            trial = evaluate(bearing, position + step, _REST).force_N + load
            if np.hypot(*trial) < np.hypot(*balance):
                break
            step = step / 2
        position, balance = position + step, trial
    raise FilmNotConverged(
        f"no equilibrium found for a load of {size:.6g} N: {np.hypot(*balance):.3g} N out of balance at "
        f"eccentricity ratio {np.hypot(*position) / c:.6g}"
    )


def _solved(jacobian: Floats, right: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.solve(jacobian, right), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise FilmError("the film carries no load: it has neither speed nor feed") from error


def _short_bearing_guess(bearing: Bearing, load: Floats) -> Floats:
    """Equilibrium of the short bearing with pi film, a start for any length (Ocvirk 1952)."""
    ratio = np.linspace(0.01, 0.97, 97)
    scale = bearing.viscosity_Pa_s * abs(bearing.speed_rad_s) * bearing.radius_m / (4 * bearing.clearance_m**2)
    shape = 1 / bearing.length_m**2 + 1 / (2 * bearing.radius_m) ** 2
    root = np.sqrt(16 * ratio**2 + np.pi**2 * (1 - ratio**2))
    carried = scale * bearing.length_m / shape * ratio / (1 - ratio**2) ** 2 * root
    eps = float(np.interp(np.hypot(*load), carried, ratio))
    attitude = np.arctan2(np.pi * np.sqrt(1 - eps**2), 4 * eps)
    sense = -1.0 if bearing.speed_rad_s < 0 else 1.0
    return eps * bearing.clearance_m * _direction(np.arctan2(load[1], load[0]) + sense * attitude)


def _describe(bearing: Bearing, position: Floats, load_angle: float) -> Equilibrium:
    film = evaluate(bearing, position, _REST)
    c, omega = bearing.clearance_m, abs(bearing.speed_rad_s)
    sense = -1.0 if bearing.speed_rad_s < 0 else 1.0
    load = float(np.hypot(*film.force_N))
    along = _direction(load_angle)
    axes = np.array([along, sense * np.array([-along[1], along[0]])])
    stiffness, damping = linear_coefficients(bearing, position, axes)
    whirl_ratio, threshold = whirl_threshold(stiffness * c / load, damping * c * omega / load)
    return Equilibrium(
        eccentricity_ratio=float(np.hypot(*position) / c),
        attitude_rad=_wrapped(sense * (np.arctan2(position[1], position[0]) - load_angle)),
        position_m=position,
        load_N=load,
        sommerfeld=bearing.viscosity_Pa_s * omega / (2 * np.pi) * bearing.length_m * 2 * bearing.radius_m / load
        * (bearing.radius_m / c) ** 2,
        friction_variable=float(film.friction_torque_N_m) / (load * c),
        film=film,
        stiffness_N_m=stiffness,
        damping_N_s_m=damping,
        stiffness=stiffness * c / load,
        damping=damping * c * omega / load,
        whirl_ratio=whirl_ratio,
        threshold=threshold,
    )  # fmt: skip
