"""Many rotors alone in one call: their motion, and what their probes show.

Parameters stand in arrays of records, one a rotor, so that every rotor may be another build.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_hil.jit import allocating
from sim_hil.rotor.film_law import Law, film_law
from sim_hil.rotor.parameters import Floats
from sim_hil.rotor.rigid import RENEW_STEPS, advance_rotor

STEP_S: Final = 200e-6

FIGURES: Final = (
    "eccentricity_x_m", "eccentricity_y_m", "peak_to_peak_x_m", "peak_to_peak_y_m",
    "true_swing_m", "min_film_m", "clearance_m", "shaft_power_W",
)  # fmt: skip
"""Of a control step: mean and peak-to-peak as measured; true swing (larger axis), smallest film,
mean gap and power."""

Records = NDArray[np.void]
Numbers = NDArray[np.intp]


def records(fields: tuple[str, ...], count: int) -> Records:
    """Zeros for ``count`` records of these numbers."""
    return np.zeros(count, [(name, np.float64) for name in fields])


@allocating
def advance_fleet(
    shaft: Records, film: Records, act: Records, law: Law, w: Floats, scalar: Floats, drive: Floats,
    target: Floats, which: Numbers, out: Floats,
) -> None:  # fmt: skip
    """:func:`advance_rotor` for each of ``which``: one row of ``out`` a step of STEP_S."""
    for r in which:
        advance_rotor(
            shaft[r],
            film[r],
            act[r],
            law,
            w[r],
            scalar[r],
            drive[r],
            target[r],
            STEP_S,
            1,
            RENEW_STEPS,
            out[r],
        )


@allocating
def _runout(probe: Floats, c1: float, s1: float) -> float:
    """Runout of orders 1 to 3 at the shaft angle of that cosine and sine, m."""
    c2, s2 = c1 * c1 - s1 * s1, 2 * s1 * c1
    c3, s3 = c2 * c1 - s2 * s1, s2 * c1 + c2 * s1
    wobble: float = (
        probe[2] * c1
        + probe[3] * c2
        + probe[4] * c3
        - probe[5] * s1
        - probe[6] * s2
        - probe[7] * s3
    )
    return wobble


@allocating
def measure_orbits(
    out: Floats,
    look: Floats,
    probe: Floats,
    noise: Floats,
    which: Numbers,
    orbit: Floats,
    figures: Floats,
) -> None:
    """Journals as their probes show them, and the true figures of their step.

    Parameters
    ----------
    out
        What :func:`advance_fleet` wrote, shape (n, periods, 11).
    look
        Directions of the two probes, a row each, shape (2, 2).
    probe
        Of the two probes: gain, zero, m, and runout of orders 1 to 3, m, real then imaginary parts
        of ``R exp(i k angle)``, shape (n, 2, 8).
    noise
        Of the two probes for ``which``, m, shape (len(which), periods, 2).
    orbit
        Written for ``which``: x, y as measured, m, shape (n, periods, 2).
    figures
        Written for ``which``: FIGURES, shape (n, 8).
    """
    n = out.shape[1]
    across = look[0, 0] * look[1, 1] - look[0, 1] * look[1, 0]
    for k, r in enumerate(which):
        first, second, rows, to = probe[r, 0], probe[r, 1], out[r], figures[r]
        low, high = (
            (math.inf, math.inf, math.inf, math.inf),
            (-math.inf, -math.inf, -math.inf, -math.inf),
        )
        sum_x = sum_y = clearance = power = 0.0
        film = math.inf
        for i in range(n):
            x, y, angle = rows[i, 0], rows[i, 1], rows[i, 8]
            film, clearance, power = (
                min(film, rows[i, 4]),
                clearance + rows[i, 5],
                power + rows[i, 6],
            )
            c1, s1 = math.cos(angle), math.sin(angle)
            true_a, true_b = look[0, 0] * x + look[0, 1] * y, look[1, 0] * x + look[1, 1] * y
            a = first[0] * (true_a + _runout(first, c1, s1)) + first[1] + noise[k, i, 0]
            b = second[0] * (true_b + _runout(second, c1, s1)) + second[1] + noise[k, i, 1]
            sx = (look[1, 1] * a - look[0, 1] * b) / across
            sy = (look[0, 0] * b - look[1, 0] * a) / across
            orbit[r, i, 0], orbit[r, i, 1] = sx, sy
            sum_x, sum_y = sum_x + sx, sum_y + sy
            low = (min(low[0], sx), min(low[1], sy), min(low[2], x), min(low[3], y))
            high = (max(high[0], sx), max(high[1], sy), max(high[2], x), max(high[3], y))
        to[0], to[1], to[2], to[3] = sum_x / n, sum_y / n, high[0] - low[0], high[1] - low[1]
        to[4], to[5], to[6] = max(high[2] - low[2], high[3] - low[3]), film, clearance / n
        to[7] = power / n


@allocating
def static_loads(
    law: Law,
    rest: Floats,
    speed: Floats,
    gap: Floats,
    mu: Floats,
    R: float,
    L: float,
    supply_Pa: Floats,
) -> Floats:
    """Film force, N, of journals resting at ``rest`` (n, 2) in a nominal bearing: a load
    estimate."""
    load = np.empty(len(rest))
    for r in range(len(rest)):
        x, y = rest[r, 0], rest[r, 1]
        f = film_law(law, x, y, 0.0, 0.0, speed[r], gap[r], mu[r], R, L, 0.0, supply_Pa[r])
        load[r] = math.hypot(f[0], f[1])
    return load
