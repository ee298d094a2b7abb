"""Trainer of the fed film surrogate: supply pressure, groove and temperature (through the viscosity) as inputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from models import ARTIFACTS, card, export
from models.film.cache import kept
from models.film.fed_data import FedSamples, draw_fed, fed_film, solve_fed
from models.film.fed_network import FED_STATE, INPUT_SIGNS, OUTPUT_SIGNS, FedFilm, features
from models.film.fed_table import shipped_table
from models.film.fit import Search, Targets, fit
from models.film.judge import Bar, FilmModel, figures_of, rms, verdict
from models.film.reduced_network import ReducedFilm, layers_of_file
from models.film.states import draw_states
from models.film.surrogate import JUDGE_SEED, of_file, of_module
from models.learning.network import Mlp
from models.runs import Run, Settings, progress_bar

Floats = NDArray[np.float64]

FLOOR = 0.05
"""Below this share of ``|f0| + s`` the training counts the force error against that share, not the force itself."""

SUPPLY_NUMBERS = (0.01, 3.0)
"""Judged range of ``p_s (c/R)^2 / (mu omega)``, even in its logarithm."""


class FedSettings(Settings, frozen=True):
    """What ``orbitd train surrogate_fed`` does; every key may stand in the ``--config`` file."""

    length_over_diameter: float = 0.5
    eccentricity_max: float = 0.97
    train_points: int = 5000
    judge_points: int = 30
    grid: tuple[int, int] = (240, 48)
    judge_grid: tuple[int, int] = (320, 64)
    hidden: tuple[int, ...] = (24, 24)
    l2: tuple[float, ...] = (1e-6,)
    restarts: int = 1
    iterations: int = 160

    def smoked(self) -> FedSettings:
        """The same training in some seconds."""
        return FedSettings(
            train_points=120, judge_points=16, grid=(72, 12), judge_grid=(96, 16), hidden=(6,), restarts=1,
            iterations=20,
        )  # fmt: skip


SETTINGS = FedSettings


@dataclass(frozen=True)
class JudgedFed:
    """``state`` ``(m, 11)``, and the Reynolds film's force ``(m, 2)`` and torque ``(m,)``."""

    state: Floats
    force: Floats
    torque: Floats


def train(run: Run, settings: FedSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    rng = np.random.default_rng([run.seed, 3])
    samples = _samples(run, settings)
    unfed = ReducedFilm(
        layers_of_file(ARTIFACTS / "surrogate.onnx"), settings.length_over_diameter, settings.eccentricity_max
    )
    net = Mlp((len(INPUT_SIGNS), *settings.hidden, 2))
    fitted = fit(net, targets_of(samples, unfed), Search(settings.l2, settings.restarts, settings.iterations), rng,
                 "fed film", run.folder.parent, run.log)  # fmt: skip
    module = FedFilm(net.layers(fitted.theta), unfed)
    judged = unseen(settings, run.seed, run.folder.parent)
    shipped, numbers = shipped_table(settings.length_over_diameter)
    bars = judge(of_module(module), judged)
    report: dict[str, object] = {
        **verdict(bars),
        "range": {"p_s (c/R)^2 / (mu omega)": SUPPLY_NUMBERS, "eccentricity_ratio": (0.0, 0.95)},
        "network": {"sizes": net.sizes, "weights": net.count, "lambda": fitted.l2},
        "shipped_table": {"numbers": numbers, **figures_of(judge(shipped, judged))},
        "training": {"points": settings.train_points, "starts": fitted.starts},
        "reproduce": run.command,
    }  # fmt: skip
    _export(module, run, samples, settings, report)
    return report


def judge(film: FilmModel, judged: JudgedFed) -> list[Bar]:
    """Errors on unseen fed films, percent."""
    force, torque = film(judged.state)[:2]
    error, size = np.hypot(*(force - judged.force).T), np.hypot(*judged.force.T)
    c, mu, radius, length = judged.state[:, 5:9].T
    scale = mu * radius * length**3 / c**2 * np.abs(judged.state[:, 4])
    return [
        Bar("force_relative_rms_percent", 100.0 * rms(error / size), 1.0),
        Bar("force_relative_p95_percent", 100.0 * float(np.quantile(error / size, 0.95)), 3.0),
        Bar("force_scaled_rms_over_rms_percent", 100.0 * rms(error / scale) / rms(size / scale), 1.0),
        Bar("torque_relative_rms_percent", 100.0 * rms(torque[:, 0] / judged.torque - 1.0), 1.0),
    ]


def evaluate(path: Path, seed: int, points: int | None, out: Path) -> dict[str, object]:
    """Bars of an exported file on fed films that follow from ``seed``."""
    settings = FedSettings(judge_points=points or FedSettings().judge_points)
    bars = judge(of_file(path), unseen(settings, seed, out))
    return {**verdict(bars), "range": {"p_s (c/R)^2 / (mu omega)": SUPPLY_NUMBERS}}


def unseen(settings: FedSettings, seed: int, out: Path) -> JudgedFed:
    """Turning journals with random bearings, grooves and supplies on the finer grid; kept in ``out``."""

    def make() -> JudgedFed:
        state = draw_fed_states(settings, np.random.default_rng([JUDGE_SEED, 1 + seed, 4]))
        force, torque = np.empty((len(state), 2)), np.empty(len(state))
        with progress_bar("unseen fed films", len(state)) as bar:
            for i, row in enumerate(state):
                film = fed_film(row, settings.judge_grid)
                force[i], torque[i] = film.force_N, film.friction_torque_N_m
                bar(i + 1)
        return JudgedFed(state, force, torque)

    key = (seed, settings.judge_points, settings.length_over_diameter, settings.judge_grid, SUPPLY_NUMBERS)
    return kept(out, "unseen-fed-films", key, JudgedFed, make)


def draw_fed_states(settings: FedSettings, rng: np.random.Generator) -> Floats:
    """States ``(m, 11)`` of turning journals over the judged range."""
    state = draw_states(settings.judge_points, settings.length_over_diameter, rng)
    state[::8, 4] = rng.uniform(100.0, 1300.0, len(state[::8]))
    low, high = SUPPLY_NUMBERS
    number = low * (high / low) ** rng.uniform(0.0, 1.0, len(state))
    supply = number * state[:, 6] * np.abs(state[:, 4]) * (state[:, 7] / state[:, 5]) ** 2
    return np.column_stack([state, supply, rng.uniform(-np.pi, np.pi, len(state))])


def targets_of(samples: FedSamples, unfed: ReducedFilm) -> Targets:
    """Inputs and targets of the network, weighted to give the relative force error (down to :data:`FLOOR`)."""
    with torch.no_grad():
        z, gain = (tensor.numpy() for tensor in features(torch.from_numpy(samples.points), unfed))
    y = samples.force / gain
    weight = 1.0 / np.maximum(np.hypot(*y.T), FLOOR)
    return Targets(z, y, np.column_stack([weight, weight]), (np.array(INPUT_SIGNS), np.array(OUTPUT_SIGNS)))


def _samples(run: Run, settings: FedSettings) -> FedSamples:
    def make() -> FedSamples:
        points = draw_fed(settings.train_points, settings.eccentricity_max, np.random.default_rng(run.seed))
        with progress_bar("fed film solutions", len(points)) as bar:
            shape = settings.length_over_diameter
            return solve_fed(points, length_over_diameter=shape, grid=settings.grid, progress=bar)

    key = (run.seed, settings.train_points, settings.eccentricity_max, settings.length_over_diameter, settings.grid)
    return kept(run.folder.parent, "fed-films", key, FedSamples, make)


def _export(
    module: FedFilm, run: Run, samples: FedSamples, settings: FedSettings, report: dict[str, object]
) -> None:
    shape = settings.length_over_diameter
    metadata = export.Metadata(
        kind="surrogate_fed", version="0.2.0", inputs=FED_STATE, outputs=("force", "friction_torque", "inside"),
        units=("m", "m", "m/s", "m/s", "rad/s", "m", "Pa s", "m", "m", "Pa", "rad", "-> N", "N m", "1"), channels=(),
        rate_hz=(), rigs=("bench",), data_hash=export.data_hash(samples.points, samples.force),
        domain={"eccentricity_ratio": (0.0, settings.eccentricity_max), "length_over_diameter": (shape, shape),
                "supply_number": SUPPLY_NUMBERS},
        metrics=report,
    )  # fmt: skip
    example = torch.zeros((2, len(FED_STATE)), dtype=torch.float64)
    example[:, 5:9] = torch.tensor([6e-5, 0.01, 0.02, 0.02], dtype=torch.float64)
    export.export(module, example, run.model, input_name="state", output_names=metadata.outputs, metadata=metadata)
    many = FedSettings(judge_points=10_000, length_over_diameter=shape)
    states = draw_fed_states(many, np.random.default_rng(run.seed))
    report["export_parity"] = export.parity(module, run.model, states)
    run.write_json("surrogate_fed.json", report)
    card.write(run, report, CARD)


CARD = card.Prose(
    "Fed film-force surrogate",
    "Force and friction torque of the film with one axial groove under supply pressure (Reynolds rupture), for "
    "studies of supply pressure; temperature enters exactly, through the viscosity.",
    (
        "One length over diameter and one groove (20 degrees wide, 0.8 of the length, as on rig bench).",
        "Accuracy is stated for the range of the supply number in `range`; the supply may not be below ambient.",
        "No flow, tilt, wear or film memory; a moving clearance is not among its inputs.",
    ),
)
