"""The bars of a film model: accuracy on unseen films, symmetry, dissipation, orbits and whirl
threshold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from models import export
from models.film.states import JudgedFilms, draw_states, squeeze_velocity

Floats = NDArray[np.float64]
FilmModel = Callable[[Floats], Sequence[Floats]]
"""State ``(m, 9)`` in SI to force ``(m, 2)``, friction torque, side flow and ``inside`` ``(m,
1)``."""

JUDGE_SEED = 99
"""Stands before the seed of judged films, so that they are never those of a training seed."""

_CHUNK = 20_000


def of_module(module: torch.nn.Module) -> FilmModel:
    """A torch module as a :data:`FilmModel`."""

    def film(state: Floats) -> Sequence[Floats]:
        with torch.no_grad():
            return [output.numpy() for output in module(torch.from_numpy(state))]

    return film


def of_file(path: Path) -> FilmModel:
    """An exported file as a :data:`FilmModel`."""
    run = export.session(path)
    return lambda state: run.run(None, {run.get_inputs()[0].name: state})


@dataclass(frozen=True)
class FilmBar:
    """One figure against its bar; at most ``limit`` passes."""

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """True at or below the limit."""
        return self.value <= self.limit

    def row(self) -> dict[str, object]:
        """The bar for a report."""
        return {
            "bar": self.name,
            "value": float(f"{self.value:.4g}"),
            "limit": self.limit,
            "pass": self.passed,
        }


def verdict(bars: Sequence[FilmBar]) -> dict[str, object]:
    """Figures, rows and the whole verdict, for a report."""
    rows = [bar.row() for bar in bars]
    return {
        "unseen_films": figures_of(bars),
        "bars": rows,
        "all_passed": all(bar.passed for bar in bars),
    }


def figures_of(bars: Sequence[FilmBar]) -> dict[str, float]:
    """Value of every bar by its name."""
    return {bar.name: float(f"{bar.value:.4g}") for bar in bars}


def accuracy(film: FilmModel, judged: JudgedFilms) -> list[FilmBar]:
    """Relative errors of force, torque (of turning journals) and side flow on unseen films,
    percent."""
    force, torque, flow = film(judged.state)[:3]
    error = np.hypot(*(force - judged.force).T) / np.hypot(*judged.force.T)
    turning = judged.state[:, 4] != 0.0
    wrong = {
        "torque_relative_rms_percent": (torque[:, 0] / judged.torque - 1.0)[turning],
        "side_flow_relative_rms_percent": flow[:, 0] / judged.side_flow - 1.0,
    }
    return [
        FilmBar("force_relative_rms_percent", 100.0 * rms(error), 0.5),
        FilmBar("force_relative_p95_percent", 100.0 * float(np.quantile(error, 0.95)), 1.5),
        FilmBar("force_scaled_rms_over_rms_percent", 100.0 * _scaled(force, judged), 0.5),
        *(FilmBar(name, 100.0 * rms(e), 0.5) for name, e in wrong.items()),
    ]


def rms(error: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(error**2)))


def _scaled(force: Floats, judged: JudgedFilms) -> float:
    """Error over force, both as dimensionless forces, so that heavily loaded films count most."""
    scale = force_scale(judged.state)[:, None]
    error, truth = (force - judged.force) / scale, judged.force / scale
    return rms(np.hypot(*error.T)) / rms(np.hypot(*truth.T))


def force_scale(state: Floats) -> Floats:
    """``mu R L^3 |v_s| / c^3`` of each state, N."""
    c, mu, radius, length = state[:, 5:].T
    return np.asarray(mu * radius * length**3 / c**3 * np.hypot(*squeeze_velocity(state).T))


def symmetry(
    film: FilmModel, length_over_diameter: float, rng: np.random.Generator, count: int = 10_000
) -> list[FilmBar]:
    """Largest departures from rotation, mirror and homogeneity, relative to the force; float
    tolerance."""
    state = draw_states(count, length_over_diameter, rng)
    force = film(state)[0]
    size = np.hypot(*force.T)

    def departure(changed: Floats, expected: Floats) -> float:
        return float(np.max(np.hypot(*(film(changed)[0] - expected).T) / size))

    angle = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    rotated = state.copy()
    rotated[:, :2], rotated[:, 2:4] = state[:, :2] @ turn, state[:, 2:4] @ turn
    mirrored = state * np.array([1, -1, 1, -1, -1, 1, 1, 1, 1])
    faster = state * np.array([1, 1, 3, 3, 3, 1, 1, 1, 1])
    wider = state * np.array(
        [2, 2, 2, 2, 1, 2, 1, 1, 1]
    )  # v scales with c: the force falls as 1 / c^2
    thicker = state * np.array([1, 1, 1, 1, 1, 1, 7, 1, 1])
    larger = state * np.array([1, 1, 1, 1, 1, 1, 1, 1.5, 1.5])
    scaled = [(faster, 3.0), (wider, 0.25), (thicker, 7.0), (larger, 1.5**4)]
    return [
        FilmBar("rotation_departure", departure(rotated, force @ turn), 1e-9),
        FilmBar("mirror_departure", departure(mirrored, force * [1, -1]), 1e-9),
        FilmBar("homogeneity_departure", max(departure(s, k * force) for s, k in scaled), 1e-9),
    ]


def dissipation(
    film: FilmModel,
    length_over_diameter: float,
    eccentricity_max: float,
    rng: np.random.Generator,
    points: int,
) -> list[FilmBar]:
    """Of ``points`` inside and outside the domain: those with ``F . v_s > 0``, and those with a
    wrong domain flag."""
    driven = mistaken = 0
    for first in range(0, points, _CHUNK):
        state = draw_states(
            min(_CHUNK, points - first), length_over_diameter, rng, eccentricity_max=0.999
        )
        answers = film(state)
        force, inside = answers[0], answers[3]
        driven += int(np.sum(np.sum(force * squeeze_velocity(state), axis=1) > 0.0))
        mistaken += int(
            np.sum(
                (inside[:, 0] > 0.5)
                != (np.hypot(*state[:, :2].T) / state[:, 5] <= eccentricity_max)
            )
        )
    return [
        FilmBar("points_driven", float(driven), 0.0),
        FilmBar("points_with_wrong_domain", float(mistaken), 0.0),
    ]
