"""Trainer and judge of the predictor: factors that make its intervals cover what they say, on
episodes of their own.

Nothing else of the predictor is learned but the film surrogate.  The factors are fitted on training
episodes and ship as ``predictor.json``; judged episodes follow from another seed and see them only
as the device would.
"""

from __future__ import annotations

import math
import os
import time
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from firmware_py import config as configuration
from firmware_py.brain.film import Film
from firmware_py.brain.intervals import IntervalFactors
from firmware_py.brain.made_for import figures_of
from firmware_py.brain.measurement import Errors, Instruments, Measured, information
from firmware_py.brain.prediction import Predictor
from firmware_py.brain.store import Model, load_model, model_of
from firmware_py.config import Config
from firmware_py.machine.contact import contact_volt
from firmware_py.machine.folder import find
from models import PHYSICS_VERSION, card
from models.manifest import commit
from models.prediction.episodes import after_procedure, as_shipped, draw, play
from models.prediction.hearing import Said, join, listen
from models.prediction.scores import conformal, report, rival_widths
from models.runs import SettingsError, TrainerSettings, TrainingRun, progress_bar
from models.workers import map_in_order
from sim_hil.rigs import load_rig

JUDGE_SEED = 1_000_000
"""Added to the seed of judged episodes, so that no training sees them."""
EVALUATED = 900
"""Episodes of an evaluation (5 min on 2 cores).

With factors from 2400 others the coverage of each of the four regimes, all quantities together, was
within 3 points of nominal in 65 of 100 draws of 300 episodes, in 92 of 600 and in 97 of 1200."""
CHUNK = 240
"""Episodes between two checkpoints."""
STATES = ("as_built", "zeroed")
"""Of the probes: see :func:`firmware_py.brain.intervals.state_of`."""


class PredictorSettings(TrainerSettings, frozen=True):
    """What ``orbitd train predictor`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    surrogate: str = ""
    """File of the film surrogate that forecasts; empty: the one that the device uses."""
    episodes: int = 2400
    judged_episodes: int = 80
    workers: int = 2

    def smoked(self) -> PredictorSettings:
        """The same training in some seconds."""
        return PredictorSettings(episodes=4, judged_episodes=4, workers=1)


SETTINGS = PredictorSettings


VERSION = "0.2.0"
"""Of the predictor that ships."""


class Fitted(msgspec.Struct, frozen=True):
    """``predictor.json``: the device reads ``factors`` and the card
    (:class:`firmware_py.brain.intervals.FactorsCard`), the judge also the rivals' half-widths
    (3, 4) by regime."""

    factors: dict[str, dict[str, dict[str, tuple[float, float]]]]
    rival_widths: dict[str, dict[str, list[list[float]]]]
    physics_version: str
    status: str
    surrogate: str
    reproduce: str
    kind: str = "predictor"
    version: str = VERSION
    rigs: tuple[str, ...] = ("bench",)
    machines: dict[str, dict[str, float | str | tuple[float, float]]] = {}
    commit: str = ""


def train(run: TrainingRun, settings: PredictorSettings) -> dict[str, object]:
    """Hear the training episodes, fit, judge on a few others; returns the report that is written
    beside the factors."""
    started = time.monotonic()
    film = Path(settings.surrogate).read_bytes() if settings.surrogate else None
    parts = [
        run.kept(
            f"episodes-{numbers.start}",
            partial(hear, settings.rig, run.seed, numbers, settings.workers, film),
        )
        for numbers in _chunks(settings.episodes)
    ]
    heard = {state: join([part[state] for part in parts]) for state in STATES}
    config, surrogate = brain(settings.rig, film)
    fitted = Fitted(
        factors={state: conformal(said) for state, said in heard.items()},
        rival_widths={
            state: {r: w.tolist() for r, w in rival_widths(said).items()}
            for state, said in heard.items()
        },
        physics_version=PHYSICS_VERSION,
        status="provisional",
        surrogate=surrogate.label,
        reproduce=run.command,
        rigs=(config.machine.name,),
        machines={config.machine.name: dict(figures_of(config.machine))},
        commit=commit(),
    )
    run.write_json("predictor.json", msgspec.to_builtins(fitted))
    run.log(
        {
            f"{state}_{regime}_{name}_high": high
            for state, regimes in fitted.factors.items()
            for regime, names in regimes.items()
            for name, (_, high) in names.items()
        }
    )
    numbers = range(settings.judged_episodes)
    fresh = run.kept(
        "judged",
        partial(hear, settings.rig, JUDGE_SEED + run.seed, numbers, settings.workers, film),
    )
    found = judge(fitted, settings.rig, run.seed, fresh, film)
    found = {
        **found,
        "training": {
            "episodes": settings.episodes,
            "seconds": round(time.monotonic() - started, 1),
        },
        "reproduce": run.command,
    }
    run.write_json("predictor-report.json", found)
    card.write(run, found, card.PREDICTOR)
    return found


def judge(
    fitted: Fitted,
    rig_name: str,
    seed: int,
    heard: dict[str, Said],
    surrogate: bytes | None = None,
) -> dict[str, object]:
    """Every figure of the predictor on episodes ``heard`` by state, which follow from ``seed`` and
    no training saw."""
    rng = np.random.default_rng([JUDGE_SEED, seed])
    episodes = len(np.unique(heard[STATES[0]].episode))
    found: dict[str, object] = {"episodes": episodes, "forecasts_each": 2, "nominal_coverage": 0.9}
    for state, said in heard.items():
        widths = {regime: np.array(rows) for regime, rows in fitted.rival_widths[state].items()}
        found[state] = report(said, fitted.factors[state], widths, rng)
    return {
        **found,
        "fisher_information": fisher(rig_name, surrogate),
        "milliseconds_16_candidates": latency_ms(rig_name, surrogate),
    }


def evaluate(
    path: Path,
    seed: int,
    size: int | None,
    out: Path,
    rig_name: str = "bench",
    surrogate: bytes | None = None,
) -> dict[str, object]:
    """``orbitd evaluate predictor``: the file at ``path`` on ``size`` episodes, every core; keeps
    nothing."""
    heard = _unseen(rig_name, seed, size or EVALUATED, surrogate)
    return judge(of_file(path), rig_name, seed, heard, surrogate)


@cache
def _unseen(rig_name: str, seed: int, size: int, surrogate: bytes | None) -> dict[str, Said]:
    """Episodes that no training saw; heard once, however many files are judged by them."""
    workers = len(os.sched_getaffinity(0))
    return hear(rig_name, JUDGE_SEED + seed, range(size), workers, surrogate)


def of_file(path: Path) -> Fitted:
    """A fitted file."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Fitted)
    except msgspec.DecodeError as error:
        raise SettingsError(
            f"{path}: {error}; fit it again with `orbitd train predictor`"
        ) from error


@cache
def brain(rig_name: str, surrogate: bytes | None = None) -> tuple[Config, Model]:
    """The rig's configuration, and the film surrogate: in those bytes, or that of its device."""
    config, _ = configuration.load(find(rig_name))
    if surrogate is None:
        return config, load_model("surrogate", config)
    return config, model_of("surrogate", surrogate, config)


def _chunks(episodes: int) -> list[range]:
    """An interrupted training resumes after the last whole chunk."""
    return [range(first, min(first + CHUNK, episodes)) for first in range(0, episodes, CHUNK)]


def hear(
    rig_name: str, seed: int, numbers: range, workers: int, surrogate: bytes | None = None
) -> dict[str, Said]:
    """What was said in the episodes ``numbers`` of ``seed``, with sensors as built and after the
    procedure."""
    parts: list[tuple[Said, Said]] = []
    with progress_bar(f"episodes from {numbers.start}", len(numbers)) as bar:
        for done, part in enumerate(
            map_in_order(partial(_hear_one, rig_name, seed, surrogate), numbers, workers), 1
        ):
            parts.append(part)
            bar(done)
    return {state: join([part[i] for part in parts]) for i, state in enumerate(STATES)}


def _hear_one(rig_name: str, seed: int, surrogate: bytes | None, number: int) -> tuple[Said, Said]:
    rig, (config, model) = load_rig(rig_name), brain(rig_name, surrogate)
    episode = draw(rig, seed, number)
    recording = play(rig, episode)
    rng = np.random.default_rng([seed, number, 1])
    config = as_shipped(config, rng)
    zeroed = after_procedure(config, rig, episode.build, rng)
    return listen(rig, episode, recording, model, config), listen(
        rig, episode, recording, model, zeroed
    )


def fisher(rig_name: str, surrogate: bytes | None = None) -> dict[str, Any]:
    """Standard deviations of load, viscosity (shares) and clearance (um) from what each instrument
    adds to the others, at the slowest speed, where the drive starts, and at the fastest and
    lightest.

    Diagonals of the Fisher information of one reading, by instrument, at three operating points.
    """
    config, model = brain(rig_name, surrogate)
    film = Film(
        model.session,
        config.machine.bearing.journal_radius_m,
        config.machine.bearing.length_m,
        config.machine.rotor.mass_at_bearing_kg,
    )
    instruments, found = Instruments(film, config), {}
    rig = load_rig(rig_name)
    for rpm, load_N in (
        (rig.speed_min_rpm, rig.start_load_N),
        (rig.start_rpm, rig.start_load_N),
        (rig.speed_max_rpm, rig.load_min_N),
    ):
        speed = rpm * math.pi / 30.0
        volt = (
            float(contact_volt(config.machine.contact, np.array([2.0 * rig.min_film_m]))[0])
            if config.machine.contact
            else math.nan
        )
        at = Measured(
            speed,
            config.machine.bearing.radial_clearance_nominal_um * 1e-6,
            0.0,
            0.0,
            0.0,
            0.0,
            rig.oil.inlet_C + 5.0,
            volt,
        )
        share = config.machine.contact.film_error_share if config.machine.contact else 0.0
        parts = information(
            instruments,
            Errors.of(config),
            config.machine.lubricant.viscosity_slope_per_K,
            share,
            load_N,
            at,
        )
        names = ("load", "viscosity", "clearance_um")
        found[f"{rpm:g} rpm, {load_N:g} N"] = {
            **{
                name: {q: float(f"{matrix[i, i]:.4g}") for i, q in enumerate(names)}
                for name, matrix in parts.items()
            },
            "load_viscosity_eigenvalues_of_position_alone": [
                float(f"{v:.3g}") for v in np.linalg.eigvalsh(parts["position"][:2, :2])
            ],
        }
    return found


def latency_ms(rig_name: str, surrogate: bytes | None = None, repeats: int = 30) -> float:
    """Best time of synchronising and forecasting 16 candidates: processor time, which other work
    does not stretch."""
    config, model = brain(rig_name, surrogate)
    predictor, rig = Predictor(model, config, IntervalFactors()), load_rig(rig_name)
    speed, gap_m = rig.start_rpm * math.pi / 30.0, rig.bearing.clearance_nominal_m
    best = math.inf
    for i in range(repeats):
        position = 0.13 * gap_m, -0.23 * gap_m, 0.08 * gap_m
        at = Measured(speed, gap_m, *position, 90.0, 45.0, 1.5, t_ns=i * 100_000_000)
        started = time.process_time()
        predictor.forecast(at, predictor.estimate(at), predictor.candidates_m)
        best = min(best, time.process_time() - started)
    return round(1e3 * best, 2)
