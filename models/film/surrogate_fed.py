"""Trainer of the fed film surrogate: supply pressure, groove and temperature (through the
viscosity) as inputs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from models import ARTIFACTS, card, export
from models.film import figures, surrogate
from models.film.cache import kept
from models.film.fed_data import SUPPLY_DRAWN, VELOCITY_DRAWN, FedSamples, draw_fed, solve_fed
from models.film.fed_judge import RANGE, draw_fed_states, judge, tables, unseen
from models.film.fed_network import FED_STATE, INPUT_SIGNS, OUTPUT_SIGNS, FedFilm, features
from models.film.fit import Fit, Search, Targets, fit, spread
from models.film.judge import of_file, of_module, verdict
from models.film.reduced_network import ReducedFilm, layers_of_file
from models.film.surrogate import SurrogateSettings
from models.learning.network import Mlp
from models.runs import Count, TrainerSettings, TrainingRun, progress_bar
from models.workers import map_in_order

Floats = NDArray[np.float64]

FLOOR = 0.05
"""Below this share of ``|f0| + s`` the training counts the force error against that share, not the
force itself."""

FLOW_WEIGHT = 0.3
"""Of the flow's error beside the force's."""


class FedSettings(TrainerSettings, frozen=True):
    """What ``orbitd train surrogate_fed`` does; every key may stand in the ``--config`` file."""

    length_over_diameter: float = 0.5
    eccentricity_max: float = 0.97
    train_points: Count = 10_000
    judge_points: Count = 100
    grid: tuple[int, int] = (240, 48)
    judge_grid: tuple[int, int] = (480, 96)
    hidden: tuple[int, ...] = (24, 24)
    l2: tuple[float, ...] = (1e-6,)
    restarts: Count = 1
    iterations: Count = 200
    seeds: Count = 5
    workers: Count = 2

    def smoked(self) -> FedSettings:
        """The same training in some seconds."""
        return FedSettings(
            train_points=120,
            judge_points=16,
            grid=(72, 12),
            judge_grid=(96, 16),
            hidden=(6,),
            iterations=20,
            seeds=2,
            workers=1,
        )


SETTINGS = FedSettings


def train(run: TrainingRun, settings: FedSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    samples = _samples(run, settings)
    unfed = ReducedFilm(
        layers_of_file(ARTIFACTS / "surrogate.onnx"),
        settings.length_over_diameter,
        settings.eccentricity_max,
    )
    net = Mlp((len(INPUT_SIGNS), *settings.hidden, len(OUTPUT_SIGNS)))
    targets, search = (
        targets_of(samples, unfed),
        Search(settings.l2, settings.restarts, settings.iterations),
    )
    fits = _fits(run, settings, partial(_fit, net, targets, search, run.folder.parent, run.seed))
    modules = [FedFilm(net.layers(one.theta), unfed) for one in fits]
    best, module = min(zip(fits, modules, strict=True), key=lambda pair: pair[0].score)
    shape = settings.length_over_diameter
    judged = unseen(run.seed, settings.judge_points, shape, settings.judge_grid, run.folder.parent)
    errors = [judge(of_module(one), judged)[0].value for one in modules]
    report: dict[str, object] = {
        **verdict(judge(of_module(module), judged)),
        "range": RANGE,
        "network": {"sizes": net.sizes, "weights": net.count, "lambda": best.l2},
        "seeds": spread(errors, fits),
        "training": {
            "points": settings.train_points,
            "starts": [row for one in fits for row in one.starts],
        },
        "reproduce": run.command,
    }
    _export(module, run, samples, settings, report)
    report["tables"] = tables(of_file(run.model), judged, shape)
    run.write_json("surrogate_fed.json", report)
    card.write(run, report, CARD)
    figures.film(run.folder, judged.state, judged.force, of_module(module)(judged.state)[0], fits)
    return report


def _fits(run: TrainingRun, settings: FedSettings, one: Callable[[int], Fit]) -> list[Fit]:
    """The fits of all seeds, side by side; their starts go to the run's metrics."""
    fits = []
    with progress_bar("fed film: networks", settings.seeds) as bar:
        for done, found in enumerate(map_in_order(one, range(settings.seeds), settings.workers), 1):
            fits.append(found)
            for row in found.starts:
                run.log(row)
            bar(done)
    return fits


def _fit(net: Mlp, targets: Targets, search: Search, folder: Path, run_seed: int, seed: int) -> Fit:
    return fit(
        net,
        targets,
        search,
        np.random.default_rng([run_seed, 3, seed]),
        f"fed film, seed {seed}",
        folder,
    )


def evaluate(path: Path, seed: int, points: int | None, out: Path) -> dict[str, object]:
    """Bars of an exported file on fed films that follow from ``seed``, with the tables beside."""
    settings, film = FedSettings(), of_file(path)
    shape = settings.length_over_diameter
    judged = unseen(seed, points or settings.judge_points, shape, settings.judge_grid, out)
    return {**verdict(judge(film, judged)), "range": RANGE, "tables": tables(film, judged, shape)}


def targets_of(samples: FedSamples, unfed: ReducedFilm) -> Targets:
    """Inputs and targets of the network, weighted to give the relative errors: of the force down to
    :data:`FLOOR`."""
    with torch.no_grad():
        z, gain, flow_gain = (
            tensor.numpy() for tensor in features(torch.from_numpy(samples.points), unfed)
        )
    y = samples.force / gain
    weight = 1.0 / np.maximum(np.hypot(*y.T), FLOOR)
    flow = np.log(samples.side_flow / flow_gain[:, 0])
    return Targets(
        z,
        np.column_stack([y, flow]),
        np.column_stack([weight, weight, FLOW_WEIGHT * np.ones_like(flow)]),
        (np.array(INPUT_SIGNS), np.array(OUTPUT_SIGNS)),
    )


def _samples(run: TrainingRun, settings: FedSettings) -> FedSamples:
    def make() -> FedSamples:
        points = draw_fed(
            settings.train_points, settings.eccentricity_max, np.random.default_rng(run.seed)
        )
        return solve_fed(
            points, length_over_diameter=settings.length_over_diameter, grid=settings.grid
        )

    key = (
        run.seed,
        settings.train_points,
        settings.eccentricity_max,
        settings.length_over_diameter,
        settings.grid,
        SUPPLY_DRAWN,
        VELOCITY_DRAWN,
    )
    return kept(run.folder.parent, "fed-films", key, FedSamples, make)


def _export(
    module: FedFilm,
    run: TrainingRun,
    samples: FedSamples,
    settings: FedSettings,
    report: dict[str, object],
) -> None:
    shape = settings.length_over_diameter
    metadata = export.Metadata(
        kind="surrogate_fed",
        version="0.3.0",
        inputs=FED_STATE,
        outputs=("force", "friction_torque", "side_flow", "inside"),
        units=(
            "m",
            "m",
            "m/s",
            "m/s",
            "rad/s",
            "m",
            "Pa s",
            "m",
            "m",
            "Pa",
            "rad",
            "-> N",
            "N m",
            "m3/s",
            "1",
        ),
        channels=(),
        rate_hz=(),
        rigs=("bench",),
        data_hash=export.data_hash(samples.points, samples.force, samples.side_flow),
        domain={
            "eccentricity_ratio": (0.0, settings.eccentricity_max),
            "length_over_diameter": (shape, shape),
            "supply_share": (0.0, 1.0),
        },
        metrics=report,
    )
    example = torch.zeros((2, len(FED_STATE)), dtype=torch.float64)
    example[:, 5:9] = torch.tensor([6e-5, 0.01, 0.02, 0.02], dtype=torch.float64)
    export.export(
        module,
        example,
        run.model,
        input_name="state",
        output_names=metadata.outputs,
        metadata=metadata,
    )
    report["export_parity"] = export.parity(
        module, run.model, random_states(10_000, settings, run.seed)
    )


def random_states(count: int, settings: FedSettings, seed: int) -> Floats:
    """States over and beyond the domain: as :func:`models.film.surrogate.random_states`, no supply,
    one below ambient.

    Grooves lie at both ends of the turn as well.
    """
    state = surrogate.random_states(count, SurrogateSettings(), seed)
    fed = draw_fed_states(count, settings.length_over_diameter, np.random.default_rng(seed))
    fed[:, : state.shape[1]] = state
    fed[1::10, 9], fed[2::40, 9], fed[3::40, 10], fed[4::40, 10] = 0.0, -1e5, np.pi, -np.pi
    return fed


CARD = card.Prose(
    "Fed film-force surrogate",
    "Force, friction torque and side flow of the film with one axial groove under supply pressure "
    "(Reynolds rupture), "
    "for studies of supply pressure.  Temperature is an input through the viscosity, and exactly: "
    "the film of one "
    "viscosity is that of another at the supply number `p_s (c/R)^2 / (mu omega)` and the force "
    "over `mu`.",
    (
        "One length over diameter and one groove (20 degrees wide, 0.8 of the length, as on rig "
        "bench).",
        "Accuracy is stated for the range of the supply number in `range`; the supply may not be "
        "below ambient.",
        "Where supply and squeeze nearly cancel, the error of the small net force is larger "
        "(`force_relative_p95`).",
        "No tilt, wear or film memory, one viscosity over the whole film; a moving clearance is "
        "not among its inputs.",
    ),
)
