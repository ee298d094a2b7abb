"""Fit normal, then detect, without a fleet: what is normal for one machine, from its own windows.

Of each figure (an amplitude in ``log10``, a place, a part of the first order) speed explains what a
parabola over its logarithm can; the rest, over its scatter, is the residual.  Residuals of a *part*
(the orbit of a bearing, a housing) make one distance, their root mean square, and the largest
distance counts.  The limit of a part is :data:`MARGIN` times the largest that healthy decisions
had, each judged by a fit without its own operating point.

What the machine was not run over is not judged: :func:`within` says whether a speed was.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.brain.normal import LOG_SPEED_STEP, Detector, NormalError, Prior
from firmware_py.records import Baseline, Belonging, Normal
from firmware_py.records.normal import OwnNormal

DECISIONS_LEAST: Final = 20
"""Decisions below which a scatter is not known: 50 s."""
MARGIN: Final = 1.5
LIMIT_LEAST: Final = 4.0
"""Scatters that a part may depart at least."""
REACH: Final = 0.5
"""Share of :data:`LOG_SPEED_STEP` beyond the speeds of the fit that it still holds for."""
TERMS: Final = 3
RIDGE: Final = 1e-3

Floats = NDArray[np.float64]


def fit(
    rows: Floats,
    speeds_rad_s: Floats,
    names: list[str],
    parts: list[str],
    columns: list[int],
    floors: Floats,
    belongs: Belonging,
    minutes: float,
) -> Normal:
    """The normal state of the machine that gave these decisions.

    Parameters
    ----------
    rows
        Figures, ``(n, k)``, in the order of ``names``.
    speeds_rad_s
        ``(n,)``.
    parts, columns
        Names of the parts, and how many figures each has.
    floors
        Least scatter of each figure, ``(k,)``.

    Raises
    ------
    NormalError
        Figures that are not finite, or fewer than :data:`DECISIONS_LEAST` decisions.
    """
    if len(rows) < DECISIONS_LEAST:
        raise NormalError(
            f"{len(rows)} decisions, at least {DECISIONS_LEAST} are needed (one each 2.5 s): let "
            f"the machine run on, then stop again"
        )
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        raise NormalError(
            f"{names[bad[0][1]]}: decision {bad[0][0]} is not finite; it must not be learned from"
        )
    logs = np.log(speeds_rad_s)
    cells = np.floor(logs / LOG_SPEED_STEP).astype(np.intp)
    points = len(np.unique(cells))
    centre, spread = float(logs.mean()), max(float(logs.std()), LOG_SPEED_STEP)
    terms = _terms((logs - centre) / spread, points)
    weights = _solve(terms, rows)
    apart = rows - terms @ weights
    for cell in np.unique(cells) if points > TERMS else ():
        own = cells == cell
        apart[own] = rows[own] - terms[own] @ _solve(terms[~own], rows[~own])
    freedom = max(len(rows) - terms.shape[1], 1) / len(rows)
    scatter = np.maximum(np.sqrt((apart**2).mean(axis=0) / freedom), floors)
    away = _by_part(apart / scatter, columns)
    typical = np.median(away, axis=0)
    limits = np.maximum(np.maximum(MARGIN * away.max(axis=0), LIMIT_LEAST), typical + 1.0)
    padded = np.zeros((TERMS, rows.shape[1]))
    padded[: len(weights)] = weights
    return Normal(
        belongs=belongs,
        minutes=minutes,
        decisions=len(rows),
        points=points,
        ranges={"speed_rad_s": (float(speeds_rad_s.min()), float(speeds_rad_s.max()))},
        offset=[],
        variance=[],
        scale=[],
        quiet=[],
        baseline=Baseline([], [], [], 0.0),
        own=OwnNormal(
            names, parts, columns, centre, spread, padded.tolist(), scatter.tolist(),
            typical.tolist(), limits.tolist(),
        ),
    )  # fmt: skip


def within(normal: Normal, speed_rad_s: float) -> bool:
    """Whether the machine was commissioned at that speed, or near it."""
    low, high = normal.ranges["speed_rad_s"]
    reach = math.exp(REACH * LOG_SPEED_STEP)
    return low / reach <= speed_rad_s <= high * reach


def residuals(own: OwnNormal, row: Floats, speed_rad_s: float) -> Floats:
    """Departures from normal of one decision ``(k,)``, in scatters."""
    u = np.array([(math.log(speed_rad_s) - own.centre) / own.spread])
    expected = (_terms(u, TERMS + 1) @ np.array(own.weights))[0]
    return np.asarray((row - expected) / np.array(own.scatter))


def by_part(own: OwnNormal, departures: Floats) -> dict[str, float]:
    """Distance of each part, 0 at a typical healthy one, 1 at its limit."""
    prior = Prior(own.parts, own.columns, [0.0] * len(own.names), own.limits, own.typical)
    away = Detector(prior).by_part(departures[None, :])[0]
    return dict(zip(own.parts, away.tolist(), strict=True))


def _terms(u: Floats, points: int) -> Floats:
    """Constant, slope, curvature over the speed: no more of them than it has steps."""
    return np.column_stack([np.ones(len(u)), u, u * u])[:, : min(points, TERMS)]


def _solve(terms: Floats, rows: Floats) -> Floats:
    ridge = RIDGE * np.diag([0.0, *np.ones(terms.shape[1] - 1)])
    return np.asarray(np.linalg.solve(terms.T @ terms + ridge, terms.T @ rows))


def _by_part(rows: Floats, columns: list[int]) -> Floats:
    ends = np.cumsum(columns)
    means = [
        (rows[:, end - size : end] ** 2).mean(axis=1)
        for end, size in zip(ends, columns, strict=True)
    ]
    return np.asarray(np.sqrt(np.column_stack(means)))
