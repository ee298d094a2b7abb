"""Scores of the predictor's forecasts: conformal factors, coverage, interval score, and the same
for its rivals."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.intervals import QUANTITIES, REGIMES
from firmware_py.brain.prediction import LIMIT_TIMES_S
from models.prediction.hearing import LIMIT_S, Said
from models.prediction.rivals import RIVALS

Floats = NDArray[np.float64]
Factors = dict[str, dict[str, tuple[float, float]]]

NOMINAL: Final = 0.9
POWER_BAR: Final = 0.05
FACTOR_LEAST: Final = 0.05
SIDE: Final = 0.5 + 0.5 * NOMINAL
"""Level of one side of a central interval."""
LEVELS: Final = (0.8, 0.995)
"""How far a recognised regime's level may be moved."""
SETTLING: Final = 40
FEWEST: Final = 20
"""Forecasts of a regime below which it takes the factors of all of them."""
BOOTSTRAP: Final = 1000


def conformal(said: Said) -> Factors:
    """Factors by recognised regime and quantity: each side's quantile of error over deviation.

    The device knows the regime that it recognises, coverage is promised in the true one: the level
    of each recognised regime is moved until the true regime of that name is missed as often as
    nominal.
    """
    z = (said.true - said.expected) / said.deviation
    found: Factors = {regime: {} for regime in REGIMES}
    for k, name in enumerate(QUANTITIES):
        low, high = (_factors(said, side * z[:, k]) for side in (-1.0, 1.0))
        for regime in REGIMES:
            found[regime][name] = low[regime], high[regime]
    return found


def _factors(said: Said, errors: Floats) -> dict[str, float]:
    """One side's factor of every recognised regime; a regime hardly ever recognised takes that of
    all forecasts."""
    own = {regime: said.recognised == regime for regime in REGIMES}
    known = [regime for regime, w in own.items() if w.sum() >= FEWEST]
    rows = {
        regime: w if regime in known else np.full(len(errors), True) for regime, w in own.items()
    }
    levels = dict.fromkeys(REGIMES, SIDE)
    for _ in range(SETTLING):
        factor = {
            regime: max(FACTOR_LEAST, _upper(errors[w], levels[regime]))
            for regime, w in rows.items()
        }
        missed = errors > np.array([factor[regime] for regime in said.recognised])
        for regime in known:
            true = said.regime == regime
            if true.any():
                share = (float(missed[true].sum()) + 1.0) / (true.sum() + 1.0)
                level = levels[regime] + 0.5 * (share - (1.0 - SIDE))
                levels[regime] = min(max(level, LEVELS[0]), LEVELS[1])
    return factor


def _upper(errors: Floats, level: float) -> float:
    """The ``ceil((n + 1) level)``-th smallest error: split conformal prediction's quantile."""
    errors = np.sort(errors[np.isfinite(errors)])
    rank = min(math.ceil((len(errors) + 1) * level), len(errors))
    return float(errors[rank - 1])


def intervals(said: Said, factors: Factors) -> tuple[Floats, Floats]:
    """Low and high (n, 4) of the forecasts."""
    pairs = np.array([[factors[r][name] for name in QUANTITIES] for r in said.recognised])
    return said.expected - pairs[:, :, 0] * said.deviation, said.expected + pairs[
        :, :, 1
    ] * said.deviation


def rival_widths(said: Said) -> dict[str, Floats]:
    """Half-widths (3, 4) by *true* regime of the rivals' intervals: relative for power, else
    absolute."""
    error = np.abs(said.rivals - said.true[:, None, :]) / _scale(said)
    found = {}
    for regime in REGIMES:
        own = said.regime == regime
        rows = error[own] if own.any() else error  # one that the machine does not know
        found[regime] = np.array(
            [[_upper(column, NOMINAL) for column in rival.T] for rival in rows.transpose(1, 0, 2)]
        )
    return found


def _scale(said: Said) -> Floats:
    scale = np.ones_like(said.rivals)
    scale[:, :, 0] = np.abs(said.rivals[:, :, 0])
    return scale


def winkler(low: Floats, high: Floats, true: Floats) -> Floats:
    """Interval score (Winkler 1972; Gneiting and Raftery 2007, eq. 43) of central intervals;
    smaller is better."""
    alpha = 1.0 - NOMINAL
    return np.asarray(
        high - low + 2.0 / alpha * (np.maximum(low - true, 0.0) + np.maximum(true - high, 0.0))
    )


def report(
    said: Said, factors: Factors, widths: dict[str, Floats], rng: np.random.Generator
) -> dict[str, object]:
    """Every figure of one set of forecasts."""
    low, high = intervals(said, factors)
    inside = (low <= said.true) & (said.true <= high)
    relative = np.abs(said.expected[:, 0] / said.true[:, 0] - 1.0)
    film_um = 1e6 * np.abs(said.expected[:, 2] - said.true[:, 2])
    return {
        "power_within_5_percent": {r: _share(relative[w] <= POWER_BAR) for r, w in _groups(said)},
        "power_error_percent_p95": {
            r: _figure(100 * np.quantile(relative[w], 0.95)) for r, w in _groups(said)
        },
        "min_film_error_um_p95": {
            r: _figure(np.quantile(film_um[w], 0.95)) for r, w in _groups(said)
        },
        "virtual_sensors": _sensors(said),
        "coverage": {
            r: {q: _share(inside[w, k]) for k, q in enumerate(QUANTITIES)} for r, w in _groups(said)
        },
        "coverage_of_regime": {r: _share(inside[w]) for r, w in _groups(said)},
        "coverage_of_regime_worst_points_off": _figure(
            _worst(inside.mean(axis=1, keepdims=True), said.regime)
        ),
        "coverage_worst_points_off": _figure(_worst(inside, said.regime)),
        "coverage_worst_points_off_by_chance": _by_chance(inside, said, rng),
        "interval_score": _scores(said, winkler(low, high, said.true), widths, rng),
        "skill_against_persistence": _skill(said),
        "time_to_limit": _limits(said),
    }


def _worst(inside: NDArray[np.bool_] | Floats, regime: NDArray[np.str_]) -> float:
    """Furthest coverage from nominal, in points, of all regimes and columns."""
    return max(
        float(np.abs(100.0 * inside[regime == r].mean(axis=0) - 100.0 * NOMINAL).max())
        for r in set(regime)
    )


def _by_chance(inside: NDArray[np.bool_], said: Said, rng: np.random.Generator) -> dict[str, float]:
    """How far the worst coverage of this many episodes is off when every interval covers exactly
    what it says.

    Bootstrap over episodes of the misses less their mean: correlation of quantities and forecasts
    is kept.
    """
    worst = np.zeros(BOOTSTRAP)
    for regime in set(said.regime):
        rows = said.regime == regime
        _, index = np.unique(said.episode[rows], return_inverse=True)
        sums = np.column_stack(
            [np.bincount(index, column) for column in inside[rows].T.astype(float)]
        )
        each = sums / np.bincount(index)[:, None] - inside[rows].mean(axis=0)
        scale = math.sqrt(NOMINAL * (1.0 - NOMINAL)) / np.maximum(inside[rows].std(axis=0), 0.1)
        drawn = np.stack(
            [each[rng.integers(0, len(each), len(each))].mean(axis=0) for _ in range(BOOTSTRAP)]
        )
        worst = np.maximum(worst, 100.0 * np.abs(drawn * scale).max(axis=1))
    return {
        "median": _figure(np.median(worst)),
        "p95": _figure(np.quantile(worst, 0.95)),
        "within_3_points": _share(worst <= 3.0),
    }


def _groups(said: Said) -> list[tuple[str, NDArray[np.bool_]]]:
    named = [(regime, said.regime == regime) for regime in REGIMES]
    return [("all", np.full(len(said.regime), True)), *((r, w) for r, w in named if w.any())]


def _sensors(said: Said) -> dict[str, object]:
    """Errors of the virtual sensors at the time of the forecast, and the film's beside the
    deviation that the filter predicts of it."""
    film, force, friction = (said.now[:, i, 0] - said.now[:, i, 2] for i in range(3))
    static = said.static_film[:, 0] - said.static_film[:, 2]
    predicted = float(np.sqrt(np.mean(said.static_film[:, 1] ** 2)))
    rms = float(np.sqrt(np.mean(static**2)))
    return {
        "min_film_um": {
            "rms": _figure(1e6 * np.sqrt(np.mean(film**2))),
            "p95": _figure(1e6 * np.quantile(np.abs(film), 0.95)),
        },
        "static_film_um": {
            "rms": _figure(1e6 * rms),
            "predicted_deviation": _figure(1e6 * predicted),
            "ratio": _figure(rms / predicted),
            "p95": _figure(1e6 * np.quantile(np.abs(static), 0.95)),
        },
        "bearing_force_percent_p95": _figure(
            100 * np.quantile(np.abs(force / said.now[:, 1, 2]), 0.95)
        ),
        "friction_power_percent_p95": _figure(
            100 * np.quantile(np.abs(friction / said.now[:, 2, 2]), 0.95)
        ),
    }


def _scores(
    said: Said, own: Floats, widths: dict[str, Floats], rng: np.random.Generator
) -> dict[str, object]:
    """Mean interval scores, and whether the predictor's is below each rival's (95 % bootstrap over
    episodes)."""
    half = np.array([widths[r] for r in said.regime]) * _scale(said)
    rival = winkler(said.rivals - half, said.rivals + half, said.true[:, None, :])
    found: dict[str, object] = {}
    for regime, rows in _groups(said):
        table: dict[str, object] = {}
        for k, name in enumerate(QUANTITIES):
            row: dict[str, object] = {"predictor": _figure(np.mean(own[rows, k]))}
            for j, who in enumerate(RIVALS):
                gain = rival[rows, j, k] - own[rows, k]
                row[who] = _figure(np.nanmean(rival[rows, j, k]))
                row[f"beats_{who}"] = _lower(gain, said.episode[rows], rng) > 0.0
            table[name] = row
        found[regime] = table
    return found


def _lower(gain: Floats, episode: NDArray[np.int64], rng: np.random.Generator) -> float:
    """Lower 95 % limit of the mean gain by bootstrap over episodes."""
    gain = np.where(np.isfinite(gain), gain, 0.0)
    _, index = np.unique(episode, return_inverse=True)
    means = np.bincount(index, gain) / np.bincount(index)
    drawn = means[rng.integers(0, len(means), (BOOTSTRAP, len(means)))].mean(axis=1)
    return float(np.quantile(drawn, 0.025))


def _skill(said: Said) -> dict[str, dict[str, float]]:
    """``1 - mean absolute error / persistence's`` on transients and growing faults."""
    found = {}
    for regime in ("ramp", "fault"):
        rows = said.regime == regime
        if not rows.any():
            continue
        own = np.abs(said.expected - said.true)[rows].mean(axis=0)
        held = np.abs(said.rivals[:, 0] - said.true)[rows].mean(axis=0)
        found[regime] = {name: _figure(1.0 - own[k] / held[k]) for k, name in enumerate(QUANTITIES)}
    return found


def _limits(said: Said) -> dict[str, object]:
    """How the announced time to a limit compares with the true one, :data:`LIMIT_S`."""
    times = said.limit_s[np.isfinite(said.limit_s[:, 1])]
    if not len(times):
        return {"faults": 0}
    never_s = LIMIT_TIMES_S[-1]
    return {
        "faults": len(times),
        "true_s": LIMIT_S,
        "foreseen": _share(times[:, 1] < never_s),
        "inside_interval": _share((times[:, 0] <= LIMIT_S) & (times[:, 2] >= LIMIT_S)),
        "expected_s_quartiles": [_figure(q) for q in np.quantile(times[:, 1], [0.25, 0.5, 0.75])],
    }


def _share(flags: NDArray[np.bool_]) -> float:
    return round(float(np.mean(flags)), 4)


def _figure(value: float | np.floating) -> float:
    return float(f"{float(value):.4g}")
