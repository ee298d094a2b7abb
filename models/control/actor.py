"""Trainer of the clearance agent: DDPG over several seeds behind the guard's shield, beside what could replace it.

Two scoreboards: the clearance alone, which the device sets, and the clearance with the supply pressure.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from torch import nn

from models import card, export, figures
from models.control.episodes import Board, Fixed, Policy, Score, play_all, play_machine
from models.control.judge import Bench, beats
from models.control.learners import ActorSettings, Learned, board_name, learn_all
from models.control.policies import OUTPUTS, RANGES, Columns, OfFile, OfModule, random_observations
from models.control.predictive import ModelPredictive
from models.control.rivals import AdaptivePI, EccentricityPI, Fed
from models.runs import Run, progress_bar
from sim_hil.control_task import OBSERVATIONS

SETTINGS = ActorSettings

T = TypeVar("T")

JUDGE_SEED = 1_001_000
"""Added to the seed of judged episodes, so that no training sees them."""

PI = (0.45, 40e-6, 60e-6)
"""Set point of the eccentricity ratio, gain and integral gain of both controllers."""

ELSEWHERE = ("agent", "ddpg", "lookup", "widest")
"""Policies that are also played on the whole machine and on direct Reynolds."""


def train(run: Run, settings: ActorSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model.

    The agent of the seed that did best on validation episodes stands for DDPG.  It ships as the actor if it needs
    less power than the lookup table at no more violation; otherwise the table does, and DDPG stands beside it.
    """
    report: dict[str, Any] = {"reproduce": run.command}
    for pressure in (False, True):
        board = settings.board(pressure=pressure)
        learned, found = learned_and_judged(run, settings, board)
        report[board_name(board)] = found
        parity = _export_all(run, board, learned, found)
        report["export_parity"] = max(parity, report.get("export_parity", 0.0))
    run.write_json("actor.json", report)
    card.write(run, report, card.ACTOR)
    figures.actor(run.folder, report)
    return report


def learned_and_judged(run: Run, settings: ActorSettings, board: Board) -> tuple[Learned, dict[str, Any]]:
    """What was learned on a board, and its report; each part is done once where a training is resumed."""
    started = time.monotonic()
    learned = learn_all(run, settings, board)
    trained_s = run.kept(f"{board_name(board)}-seconds", lambda: round(time.monotonic() - started, 1))
    agents: list[Policy] = [OfModule(agent) for agent in learned.agents]
    report = _judged(board, learned.policies(), settings, run.seed, run.folder.parent, agents, run.kept)
    training = {"steps": settings.ddpg.steps, "agents": settings.seeds, "seconds": trained_s}
    return learned, report | {"shipped": _better(report), "ddpg_seed": learned.best, "training": training}


def evaluate(path: Path, seed: int, size: int | None, out: Path) -> dict[str, object]:
    """The policy in ``path``, and those in the files beside it, with their rivals on the episodes of ``seed``."""
    settings = ActorSettings()
    settings = settings if size is None else _sized(settings, size)
    report: dict[str, object] = {}
    for pressure, key in ((False, "unseen_episodes"), (True, "unseen_episodes_pair")):
        stem = path.with_name(f"{path.stem}_pair.onnx") if pressure else path
        files = {"agent": stem} | {name: stem.with_name(f"{stem.stem}_{name}.onnx") for name in ("ddpg", "lookup")}
        policies: dict[str, Policy] = {name: OfFile(file) for name, file in files.items() if file.is_file()}
        if policies:
            report[key] = _judged(settings.board(pressure=pressure), policies, settings, seed, out, [], _anew)
    return report


def _anew(name: str, work: Callable[[], T]) -> T:
    """Keeps nothing."""
    return work()


def _sized(settings: ActorSettings, size: int) -> ActorSettings:
    values = {name: getattr(settings, name) for name in settings.__struct_fields__}
    return ActorSettings(**values | {"judged_episodes": size})


class Keep(Protocol):
    """Does a named part of the work, or knows it from before: :meth:`models.runs.Run.kept`."""

    def __call__(self, name: str, work: Callable[[], T], /) -> T:
        """The result of ``work``."""


def _judged(
    board: Board, learned: dict[str, Policy], settings: ActorSettings, seed: int, out: Path, agents: list[Policy],
    kept: Keep,
) -> dict[str, Any]:  # fmt: skip
    """Report of a board: policies in unseen episodes, and some of them on other plants."""
    name, workers = board_name(board), settings.workers
    seeds = range(JUDGE_SEED + 1000 * seed, JUDGE_SEED + 1000 * seed + settings.judged_episodes)
    bench = kept(f"{name}-bench", lambda: Bench.of(board, seeds, out, workers))
    policies = {**learned, **_rivals(board)}
    report = kept(f"{name}-judged", lambda: judge(bench, policies, agents, workers))
    named = {name: policy for name, policy in policies.items() if name in ELSEWHERE}
    report["whole_machine"] = kept(
        f"{name}-machine", lambda: _on_machine(board, named, seeds[: settings.machine_episodes], workers))
    if not board.pressure:
        fixed = {"best_fixed": bench.setting, "nominal_fixed": _nominal(board)}
        report["direct_reynolds"] = kept(
            f"{name}-direct", lambda: _directly(board, named, fixed, seeds[: settings.direct_episodes], workers))
    return report


def judge(bench: Bench, policies: dict[str, Policy], agents: list[Policy], workers: int) -> dict[str, Any]:
    """Figures of every policy behind the shield and without it, and of all agents together."""
    everything = [*policies.values(), *agents]
    played = [(policy, shielded) for shielded in (True, False) for policy in everything]
    scores = bench.play([*played, (_nominal(bench.board), False)], workers)
    behind, alone = scores[: len(everything)], scores[len(everything) : -1]
    shielded = dict(zip(policies, behind, strict=False))
    rows = {name: bench.figures(score) for name, score in shielded.items()}
    rows |= {f"{name}_without_shield": bench.figures(s) for name, s in zip(policies, alone, strict=False)}
    report: dict[str, Any] = {**bench.header(), "policies": rows | {"nominal_fixed": bench.figures(scores[-1])}}
    if agents:
        report["ddpg_all_seeds"] = bench.over_seeds(behind[len(policies) :])
        report["ddpg_all_seeds_without_shield"] = bench.over_seeds(alone[len(policies) :])
    first, *others = policies
    return report | {f"{first}_less_{name}": bench.paired(shielded[first], shielded[name]) for name in others}


def _rivals(board: Board) -> dict[str, Policy]:
    """What needs no training; ``widest`` wishes for the largest clearance always, and shows what the shield gives.

    Where the pressure may be set they leave it at its least; the predictor knows the unfed film only.
    """
    low, high = board.reach[:, 0].tolist()
    rivals: dict[str, Policy] = {
        "pi": EccentricityPI(*PI, (low, high)), "adaptive_pi": AdaptivePI(*PI, (low, high)), "widest": Fixed(high),
    }  # fmt: skip
    if board.pressure:
        return {name: Fed(policy, float(board.reach[0, 1])) for name, policy in rivals.items()}
    return rivals | {"model_predictive": ModelPredictive(board.rig)}


def _nominal(board: Board) -> Fixed:
    return Fixed(board.data.bearing.clearance_nominal_m, board.data.supply.nominal_Pa if board.pressure else None)


def _better(report: dict[str, Any]) -> str:
    """Which of DDPG and lookup table ships."""
    times = [report["policies"][name]["violation_s"] for name in ("ddpg", "lookup")]
    return "ddpg" if times[0] <= times[1] and beats(report["ddpg_less_lookup"]) else "lookup"


def _on_machine(
    board: Board, policies: dict[str, Policy], seeds: range, workers: int
) -> dict[str, dict[str, float]]:  # fmt: skip
    """Behind the shield on the whole machine with its sensors."""
    with progress_bar(f"{board_name(board)}: whole machine", len(policies)) as bar:
        scores = play_all(board, seeds, [(policy, True) for policy in policies.values()], workers, bar, play_machine)
    return {name: score.summary(board.seconds) for name, score in zip(policies, scores, strict=True)}


def _directly(
    board: Board, policies: dict[str, Policy], fixed: dict[str, Fixed], seeds: range, workers: int
) -> dict[str, Any]:  # fmt: skip
    """Policies behind the shield and fixed settings with Reynolds' equation solved in every step, less the table's."""
    played = [(policy, True) for policy in policies.values()] + [(policy, False) for policy in fixed.values()]
    with progress_bar("direct Reynolds", len(played)) as bar:
        direct = play_all(replace(board, direct=True), seeds, played, workers, bar)
    with progress_bar("the same from the table", len(played)) as bar:
        table = play_all(board, seeds, played, workers, bar)
    rows = zip((*policies, *fixed), direct, table, strict=True)
    return {"episodes": len(seeds), **{name: _difference(a, b, board.seconds) for name, a, b in rows}}


def _difference(direct: Score, table: Score, seconds: float) -> dict[str, float]:
    """What the direct film gives, and its largest differences in an episode from the table's."""
    off_W, off_m = direct.power_W - table.power_W, direct.min_film_m - table.min_film_m
    return direct.summary(seconds) | {
        "less_table_W": round(float(off_W.mean()), 4), "less_table_W_worst": round(float(np.abs(off_W).max()), 4),
        "less_table_film_um_worst": round(1e6 * float(np.abs(off_m).max()), 3),
    }  # fmt: skip


def _export_all(run: Run, board: Board, learned: Learned, report: dict[str, Any]) -> float:
    """Write DDPG, lookup table and what ships; returns the largest distance of a file from its module."""
    stem = run.model.with_name("actor_pair.onnx") if board.pressure else run.model
    modules: dict[str, nn.Module] = {"ddpg": learned.agents[learned.best], "lookup": learned.table}
    files = {stem.with_name(f"{stem.stem}_{name}.onnx"): name for name in modules} | {stem: report["shipped"]}
    return max(_export(modules[name], path, name, run, board, report) for path, name in files.items())


def _export(module: nn.Module, path: Path, policy: str, run: Run, board: Board, report: dict[str, Any]) -> float:
    """Write one file; returns how far it is from the module."""
    names, outputs = tuple(OBSERVATIONS), OUTPUTS[: board.reach.shape[1]]
    units = ("rad/s", "m", "m", "m", "m", "m", "bar", "W", "degC", "N", "1", *("-> m", "-> Pa")[: len(outputs)])
    metadata = export.Metadata(
        kind="actor", version="0.3.0", inputs=names, outputs=outputs, rate_hz=(10,), channels=(), units=units,
        rigs=(board.rig,), domain={name: RANGES[name] for name in names},
        data_hash=export.data_hash(np.array([run.seed])), settings={"policy": policy},
        metrics={"policies": report["policies"], "reproduce": run.command},
    )  # fmt: skip
    columns = Columns(module, len(outputs))
    export.export(
        columns, torch.zeros(2, len(names)), path, input_name="observation", output_names=outputs, metadata=metadata
    )
    return export.parity(columns, path, random_observations(10_000, run.seed))
