"""Unseen fed films that judge the fed network, and the tables beside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.film import fed_table
from models.film.cache import kept
from models.film.fed_data import fed_film
from models.film.judge import JUDGE_SEED, FilmBar, FilmModel, figures_of, rms
from models.film.parallel import each
from models.film.states import ECCENTRICITY_JUDGED, draw_states

Floats = NDArray[np.float64]

SUPPLY_NUMBERS = (0.01, 3.0)
"""Judged range of ``p_s (c/R)^2 / (mu omega)``, even in its logarithm."""

RANGE = {
    "p_s (c/R)^2 / (mu omega)": SUPPLY_NUMBERS,
    "eccentricity_ratio": (0.0, ECCENTRICITY_JUDGED),
}


@dataclass(frozen=True)
class JudgedFed:
    """``state`` ``(m, 11)``, and the Reynolds film's force ``(m, 2)``, torque and side flow
    ``(m,)``."""

    state: Floats
    force: Floats
    torque: Floats
    side_flow: Floats


def unseen(
    seed: int, count: int, length_over_diameter: float, grid: tuple[int, int], out: Path
) -> JudgedFed:
    """Turning journals with random bearings, grooves and supplies on ``grid``; kept in ``out``."""

    def make() -> JudgedFed:
        state = draw_fed_states(
            count, length_over_diameter, np.random.default_rng([JUDGE_SEED, 1 + seed, 4])
        )
        answers = each(partial(_answers, grid), state, "unseen fed films")
        return JudgedFed(state, answers[:, :2], answers[:, 2], answers[:, 3])

    key = (seed, count, length_over_diameter, grid, SUPPLY_NUMBERS)
    return kept(out, "unseen-fed-films", key, JudgedFed, make)


def _answers(grid: tuple[int, int], state: Floats) -> Floats:
    film = fed_film(state, grid)
    return np.array([*film.force_N, float(film.friction_torque_N_m), float(film.side_flow_m3_s)])


def draw_fed_states(count: int, length_over_diameter: float, rng: np.random.Generator) -> Floats:
    """States ``(count, 11)`` of turning journals over the judged range."""
    state = draw_states(count, length_over_diameter, rng)
    state[::8, 4] = rng.uniform(100.0, 1300.0, len(state[::8]))
    low, high = SUPPLY_NUMBERS
    number = low * (high / low) ** rng.uniform(0.0, 1.0, len(state))
    supply = number * state[:, 6] * np.abs(state[:, 4]) * (state[:, 7] / state[:, 5]) ** 2
    return np.column_stack([state, supply, rng.uniform(-np.pi, np.pi, len(state))])


def judge(film: FilmModel, judged: JudgedFed) -> list[FilmBar]:
    """Errors on unseen fed films, percent; of the side flow where the model gives one (force,
    torque, flow, inside)."""
    force, torque, *rest = film(judged.state)
    error, size = np.hypot(*(force - judged.force).T), np.hypot(*judged.force.T)
    c, mu, radius, length = judged.state[:, 5:9].T
    scale = mu * radius * length**3 / c**2 * np.abs(judged.state[:, 4])
    bars = [
        FilmBar("force_relative_rms_percent", 100.0 * rms(error / size), 1.0),
        FilmBar("force_relative_p95_percent", 100.0 * float(np.quantile(error / size, 0.95)), 3.0),
        FilmBar(
            "force_scaled_rms_over_rms_percent", 100.0 * rms(error / scale) / rms(size / scale), 1.0
        ),
        FilmBar(
            "torque_relative_rms_percent", 100.0 * rms(torque[:, 0] / judged.torque - 1.0), 1.0
        ),
    ]
    if len(rest) == 2:
        wrong = np.abs(rest[0][:, 0] / judged.side_flow - 1.0)
        bars.append(
            FilmBar("side_flow_relative_p95_percent", 100.0 * float(np.quantile(wrong, 0.95)), 3.0)
        )
    return bars


def tables(film: FilmModel, judged: JudgedFed, length_over_diameter: float) -> dict[str, object]:
    """The simulator's table and smaller ones on the same films, with the time of a state.

    The network runs as the device runs it (onnxruntime, one thread), the tables compiled, as in the
    simulator.  With each table stands how much the network's force error is below its own, with a
    95 % interval by bootstrap over films.
    """
    found = fed_table.tables(length_over_diameter)
    state = np.resize(judged.state, (1000, judged.state.shape[1]))
    rows: dict[str, object] = {
        "network": {"microseconds_a_state": fed_table.microseconds(film, state)}
    }
    for name, table in found.items():
        rival = fed_table.model(table)
        rows[name] = {
            "numbers": table.groove.size,
            **figures_of(judge(rival, judged)),
            "microseconds_a_state": fed_table.microseconds(rival, state),
            "network_less_percent": _less(film, rival, judged),
        }
    return rows


def _less(film: FilmModel, rival: FilmModel, judged: JudgedFed) -> dict[str, object]:
    """By how much the root-mean-square relative force error of ``film`` is below that of ``rival``,
    percent."""
    size = np.hypot(*judged.force.T)
    ours, theirs = (
        np.hypot(*(one(judged.state)[0] - judged.force).T) / size for one in (film, rival)
    )
    draws = np.random.default_rng(JUDGE_SEED).integers(len(size), size=(2000, len(size)))
    gains = 100.0 * (
        np.sqrt(np.mean(theirs[draws] ** 2, axis=1)) - np.sqrt(np.mean(ours[draws] ** 2, axis=1))
    )
    gain = 100.0 * (rms(theirs) - rms(ours))
    lower, upper = np.quantile(gains, (0.025, 0.975))
    return {
        "gain": round(gain, 3),
        "lower": round(float(lower), 3),
        "upper": round(float(upper), 3),
    }
