"""Where the film carries a given load, or at a given eccentricity a load of given direction."""

from collections.abc import Callable

import numpy as np

from .bearing import Bearing
from .force import evaluate
from .records import FilmError, FilmNotConverged, Floats

REST = np.zeros(2)
_MAX_STEPS = 60
_RING_STARTS = 36
_TOLERANCE = 1e-8


def direction(angle: float) -> Floats:
    """Unit vector."""
    return np.array([np.cos(angle), np.sin(angle)])


def bracketed_root(
    function: Callable[[float], float], low: float, high: float, tolerance: float = _TOLERANCE
) -> float:
    """Root between two points of different sign (regula falsi, Illinois variant)."""
    f_low, f_high = function(low), function(high)
    while abs(high - low) > tolerance and f_low != f_high:
        middle = high - f_high * (high - low) / (f_high - f_low)
        value = function(middle)
        if value == 0 or abs(middle - high) < tolerance:
            return middle
        if value * f_high < 0:
            low, f_low = high, f_high
        else:
            f_low /= 2
        high, f_high = middle, value
    return high


def position_of_ratio(bearing: Bearing, ratio: float, load_angle: float) -> Floats:
    """Turn the journal around the ring until the film opposes the load.

    Unfed in a round bore the force turns with the journal: one turn. Feeds and pads break that;
    then every attitude of the ring is tried and of several the one that carries most is taken.
    """

    def place(angle: float) -> Floats:
        return ratio * bearing.clearance_m * direction(angle)

    def along_and_across(angle: float) -> Floats:
        force = evaluate(bearing, place(angle), REST).force_N
        if not np.any(force):
            raise FilmError("the film carries no load: it has neither speed nor feed")
        x, y = direction(load_angle)
        return np.array([[-x, -y], [-y, x]]) @ force

    if not bearing.feed and bearing.pads is None:
        carried, across = along_and_across(load_angle)
        return place(load_angle + np.arctan2(across, carried))
    angles = load_angle + np.linspace(0, 2 * np.pi, _RING_STARTS + 1)
    across = [along_and_across(a)[1] for a in angles]
    roots = [
        bracketed_root(lambda a: float(along_and_across(a)[1]), angles[i], angles[i + 1])
        for i in range(_RING_STARTS)
        if across[i] * across[i + 1] <= 0
    ]
    carried, angle = max(((along_and_across(a)[0], a) for a in roots), default=(0.0, 0.0))
    if carried <= 0:
        raise FilmNotConverged(
            f"no attitude carries a load at eccentricity ratio {ratio}: the feeds outweigh it"
        )
    return place(angle)


def position_of_load(bearing: Bearing, load: Floats) -> Floats:
    """Damped Newton iteration on the balance of film force and load."""
    c = bearing.clearance_m
    size = float(np.hypot(*load))
    position = _short_bearing_guess(bearing, load)
    balance = evaluate(bearing, position, REST).force_N + load
    for _ in range(_MAX_STEPS):
        if np.hypot(*balance) < _TOLERANCE * size:
            return position
        axes = np.eye(2)
        reach = 1e-4 * bearing.gap_m(position)
        columns = [
            evaluate(bearing, position + reach * a, REST).force_N + load - balance for a in axes
        ]
        step = _solved(np.column_stack(columns) / reach, -balance)
        gap = bearing.gap_m(position)
        step *= min(1.0, 0.6 * gap / max(np.hypot(*step), 1e-300))
        for _ in range(12):
            trial = evaluate(bearing, position + step, REST).force_N + load
            if np.hypot(*trial) < np.hypot(*balance):
                break
            step = step / 2
        position, balance = position + step, trial
    raise FilmNotConverged(
        f"no equilibrium found for a load of {size:.6g} N: {np.hypot(*balance):.3g} N out of "
        f"balance at "
        f"eccentricity ratio {np.hypot(*position) / c:.6g}; near 1 the load is more than this film "
        f"carries"
    )


def _solved(jacobian: Floats, right: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.solve(jacobian, right), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise FilmError("the film carries no load: it has neither speed nor feed") from error


def _short_bearing_guess(bearing: Bearing, load: Floats) -> Floats:
    """Equilibrium of the short bearing with pi film, a start for any length (Ocvirk 1952)."""
    ratio = np.linspace(0.01, 0.97, 97)
    scale = (
        bearing.viscosity_Pa_s
        * abs(bearing.speed_rad_s)
        * bearing.radius_m
        / (4 * bearing.clearance_m**2)
    )
    shape = 1 / bearing.length_m**2 + 1 / (2 * bearing.radius_m) ** 2
    root = np.sqrt(16 * ratio**2 + np.pi**2 * (1 - ratio**2))
    carried = scale * bearing.length_m / shape * ratio / (1 - ratio**2) ** 2 * root
    eps = float(np.interp(np.hypot(*load), carried, ratio))
    attitude = np.arctan2(np.pi * np.sqrt(1 - eps**2), 4 * eps)
    sense = -1.0 if bearing.speed_rad_s < 0 else 1.0
    return eps * bearing.clearance_m * direction(np.arctan2(load[1], load[0]) + sense * attitude)
