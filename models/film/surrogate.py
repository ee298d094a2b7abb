"""Trainer of the film-force surrogate: the reduced network by Levenberg-Marquardt, with its bars
and rivals."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from models import card, export
from models.film import dynamics as film_dynamics
from models.film import figures
from models.film import judge as film_judge
from models.film.cache import kept
from models.film.data import FilmSamples, draw_points, solve_points
from models.film.fit import Fit, Search, Targets, fit, spread
from models.film.judge import JUDGE_SEED, FilmModel, figures_of, of_file, of_module
from models.film.reduced_network import ReducedFilm, half_film_integrals, layers_of_file
from models.film.rivals import RawNetwork, TrainedBearing, raw_network, table_model
from models.film.states import STATE, JudgedFilms, draw_states, solve_states
from models.learning.network import Mlp
from models.runs import Count, TrainerSettings, TrainingRun
from sim_hil.rigs import RIGS, load_rig
from sim_hil.rotor.network_law import ReducedNetworkLaw

Floats = NDArray[np.float64]


class SurrogateSettings(TrainerSettings, frozen=True):
    """What ``orbitd train surrogate`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    """On whose rotor the film is judged; the network itself knows no rig."""
    length_over_diameter: float = 0.5
    eccentricity_max: float = 0.97
    train_points: Count = 1200
    judge_points: Count = 100
    grid: tuple[int, int] = (240, 48)
    judge_grid: tuple[int, int] = (480, 96)
    hidden: tuple[int, ...] = (8, 8)
    l2: tuple[float, ...] = (1e-9, 1e-7)
    restarts: Count = 2
    iterations: Count = 400
    seeds: Count = 5
    dissipation_points: Count = 1_000_000
    paper_points: Count = 4000
    paper_iterations: Count = 250

    def smoked(self) -> SurrogateSettings:
        """The same training in some seconds."""
        return SurrogateSettings(
            train_points=240,
            judge_points=24,
            grid=(96, 12),
            judge_grid=(128, 16),
            restarts=1,
            iterations=80,
            l2=(1e-8,),
            seeds=2,
            dissipation_points=10_000,
            paper_points=300,
            paper_iterations=20,
        )


SETTINGS = SurrogateSettings


def train(run: TrainingRun, settings: SurrogateSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model."""
    samples = _samples(run, settings)
    net = Mlp((2, *settings.hidden, 3))
    targets, fits = targets_of(samples), []
    for seed in range(settings.seeds):
        rng = np.random.default_rng([run.seed, seed])
        one = partial(
            fit, net, targets, _search(settings), rng, f"seed {seed}", run.folder.parent, run.log
        )
        fits.append(run.kept(f"fit-{seed}", one))
    best = min(fits, key=lambda one: one.score)
    module = _module(net, best, settings)
    judged = unseen(settings, run.seed, run.folder.parent)
    law = ReducedNetworkLaw.make(best.theta, net.sizes)
    report = {
        **judge(of_module(module), law, judged, settings, run.seed),
        "network": {"sizes": net.sizes, "weights": net.count, "lambda": best.l2},
        "seeds": spread(
            [_error_percent(_module(net, one, settings), judged) for one in fits], fits
        ),
        "rivals": rivals(judged, settings, run.seed, run.folder.parent),
        "training": {
            "points": settings.train_points,
            "starts": [row for one in fits for row in one.starts],
        },
        "reproduce": run.command,
    }
    _export(module, run, samples, settings, report)
    figures.film(run.folder, judged.state, judged.force, of_module(module)(judged.state)[0], fits)
    return report


def judge(
    film: FilmModel,
    law: ReducedNetworkLaw,
    judged: JudgedFilms,
    settings: SurrogateSettings,
    seed: int,
) -> dict[str, object]:
    """Every bar of the reduced network with its verdict."""
    rng, shape = np.random.default_rng([JUDGE_SEED, 1 + seed, 1]), settings.length_over_diameter
    bars = [
        *film_judge.accuracy(film, judged),
        *film_judge.symmetry(film, shape, rng),
        *film_judge.dissipation(
            film, shape, settings.eccentricity_max, rng, settings.dissipation_points
        ),
        *film_dynamics.whirl(film, shape, settings.grid),
        *film_dynamics.orbits(load_rig(settings.rig), law),
    ]
    return film_judge.verdict(bars)


def evaluate(
    path: Path,
    seed: int,
    points: int | None,
    out: Path,
    settings: SurrogateSettings | None = None,
) -> dict[str, object]:
    """Bars of an exported file on films that follow from ``seed``, with the spline table and K, C
    beside."""
    settings = settings or SurrogateSettings()
    settings = msgspec.structs.replace(settings, judge_points=points or settings.judge_points)
    judged = unseen(settings, seed, out)
    shape = settings.length_over_diameter
    return {
        **judge(of_file(path), law_of(path), judged, settings, seed),
        "spline_table": figures_of(film_judge.accuracy(table_model(shape), judged)),
        "linear_orbit_error_percent_of_clearance": film_dynamics.linear_orbits(
            load_rig(settings.rig)
        ),
    }


def rivals(
    judged: JudgedFilms, settings: SurrogateSettings, seed: int, out: Path
) -> dict[str, object]:
    """The spline table, the paper's two networks and the linear model, on the same measures."""
    rng = np.random.default_rng([seed, 2])
    search = Search((1e-8, 1e-4), settings.restarts, settings.paper_iterations)
    rig = load_rig(settings.rig)
    bearing = rig.bearing

    def raw(clearances_m: tuple[float, float] | None) -> RawNetwork:
        return raw_network(
            TrainedBearing.of_rig(settings.rig, rig.start_rpm, clearances_m),
            rng,
            search,
            out,
            settings.paper_points,
        )

    return {
        "spline_table": figures_of(
            film_judge.accuracy(table_model(settings.length_over_diameter), judged)
        ),
        "paper_4_n_2_at_one_clearance": raw(None).report(),
        "paper_5_n_2_with_the_clearance": raw(
            (bearing.clearance_min_m, bearing.clearance_max_m)
        ).report(),
        "linear_orbit_error_percent_of_clearance": film_dynamics.linear_orbits(
            load_rig(settings.rig)
        ),
    }


def unseen(settings: SurrogateSettings, seed: int, out: Path) -> JudgedFilms:
    """Films of new states on the finer grid, up to the judged eccentricity; kept in ``out``."""

    def make() -> JudgedFilms:
        rng = np.random.default_rng([JUDGE_SEED, 1 + seed])
        states = draw_states(settings.judge_points, settings.length_over_diameter, rng)
        return solve_states(states, settings.judge_grid)

    key = (seed, settings.judge_points, settings.length_over_diameter, settings.judge_grid)
    return kept(out, "unseen-films", key, JudgedFilms, make)


def targets_of(samples: FilmSamples) -> Targets:
    """Inputs ``(a, b^2)``; logarithms of film over short film (along, across) and of the side flow.

    The weights are each part's share in the force, so that the first two errors are the relative
    force error.
    """
    a, b = samples.ab[:, :1], samples.ab[:, 1:]
    along, across = (j.numpy()[:, 0] for j in half_film_integrals(torch.tensor(a), torch.tensor(b)))
    size = np.hypot(samples.force[:, 0], samples.force[:, 1])
    ratio = np.ones_like(along)
    np.divide(-samples.force[:, 1], across, out=ratio, where=b[:, 0] > 1e-9)
    y = np.log(np.stack([-samples.force[:, 0] / along, ratio, samples.side_flow], axis=1))
    share = np.abs(samples.force) / size[:, None]
    share[b[:, 0] <= 1e-9, 1] = 0.0
    return Targets(np.hstack([a, b * b]), y, np.column_stack([share, np.ones(len(size))]))


def law_of(path: Path) -> ReducedNetworkLaw:
    """An exported file as the film of a rotor."""
    layers = layers_of_file(path)
    sizes = (len(layers[0]) - 1, *(matrix.shape[1] for matrix in layers))
    return ReducedNetworkLaw.make(np.concatenate([matrix.ravel() for matrix in layers]), sizes)


def _samples(run: TrainingRun, settings: SurrogateSettings) -> FilmSamples:
    def make() -> FilmSamples:
        points = draw_points(
            settings.train_points, settings.eccentricity_max, np.random.default_rng(run.seed)
        )
        return solve_points(
            points, length_over_diameter=settings.length_over_diameter, grid=settings.grid
        )

    key = (
        run.seed,
        settings.train_points,
        settings.eccentricity_max,
        settings.length_over_diameter,
        settings.grid,
    )
    return kept(run.folder.parent, "films", key, FilmSamples, make)


def _search(settings: SurrogateSettings) -> Search:
    return Search(settings.l2, settings.restarts, settings.iterations)


def _module(net: Mlp, fitted: Fit, settings: SurrogateSettings) -> ReducedFilm:
    return ReducedFilm(
        net.layers(fitted.theta), settings.length_over_diameter, settings.eccentricity_max
    )


def _error_percent(module: ReducedFilm, judged: JudgedFilms) -> float:
    return film_judge.accuracy(of_module(module), judged)[0].value


def _export(
    module: ReducedFilm,
    run: TrainingRun,
    samples: FilmSamples,
    settings: SurrogateSettings,
    report: dict[str, object],
) -> None:
    shape = settings.length_over_diameter
    bearings = {name: load_rig(name).bearing for name in RIGS}
    metadata = export.Metadata(
        kind="surrogate",
        version="0.2.0",
        inputs=STATE,
        outputs=("force", "friction_torque", "side_flow", "inside"),
        units=("m", "m", "m/s", "m/s", "rad/s", "m", "Pa s", "m", "m", "-> N", "N m", "m3/s", "1"),
        channels=(),
        rate_hz=(),
        rigs=[n for n, b in bearings.items() if abs(b.length_m / (2.0 * b.radius_m) - shape) < 1e-9]
        or [settings.rig],
        data_hash=export.data_hash(samples.ab, samples.force, samples.side_flow),
        domain={
            "eccentricity_ratio": (0.0, settings.eccentricity_max),
            "length_over_diameter": (shape, shape),
        },
        metrics=report,
    )
    example = torch.zeros((2, len(STATE)), dtype=torch.float64)
    example[:, 5:] = torch.tensor([6e-5, 0.01, 0.02, 0.02], dtype=torch.float64)
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
    run.write_json("surrogate.json", report)
    card.write(run, report, card.SURROGATE)


def random_states(count: int, settings: SurrogateSettings, seed: int) -> Floats:
    """States over and beyond the domain: corners, zero speed, both senses, journal outside the
    clearance.

    The outer corners lie a hair inside the domain: on its very edge rounding decides.
    """
    rng = np.random.default_rng(seed)
    state = draw_states(count, settings.length_over_diameter, rng)
    eps, angle = rng.uniform(0.0, 1.1, count), rng.uniform(-np.pi, np.pi, count)
    eps[:100], eps[100:200] = 0.0, settings.eccentricity_max * (1.0 - 1e-9)
    state[:, 0], state[:, 1] = eps * state[:, 5] * np.cos(angle), eps * state[:, 5] * np.sin(angle)
    state[::10, 4], state[::20, 2:4] = 0.0, 0.0
    return state
