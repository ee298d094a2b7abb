"""Trainer of the clearance agent: DDPG over several seeds behind the guard's shield, beside what
could replace it.

Two scoreboards: the clearance alone, which the device sets, and the clearance with the supply
pressure.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from torch import nn

from models import card, export, figures
from models.control.episodes import Board, SettingPolicy
from models.control.judge import Bench, beats
from models.control.learners import ActorSettings, LearnedActor, board_name, learn_all
from models.control.policies import (
    OUTPUTS,
    Columns,
    OfFile,
    OfModule,
    random_observations,
    ranges_of,
)
from models.control.scoreboard import as_drawn, directly, judge, on_machine, predictive, rivals
from models.runs import TrainingRun
from sim_hil.gym.control_task import OBSERVATIONS

SETTINGS = ActorSettings

JUDGE_SEED = 1_001_000
"""Added to the seed of judged episodes, so that no training sees them."""

ELSEWHERE = ("agent", "ddpg", "lookup", "widest")
"""Policies that are also played on the whole machine and on direct Reynolds."""


def train(run: TrainingRun, settings: ActorSettings) -> dict[str, object]:
    """Train, judge and export; returns the report that is written beside the model.

    The agent of the seed that did best on validation episodes stands for DDPG.  It ships as the
    actor if it needs less power than the lookup table at no more violation; otherwise the table
    does, and DDPG stands beside it.
    """
    report: dict[str, Any] = {"reproduce": run.command}
    for pressure in (False, True)[: 1 + settings.pair]:
        board = settings.board(pressure=pressure)
        learned, found = learned_and_judged(run, settings, board)
        report[board_name(board)] = found
        parity = _export_all(run, board, learned, found)
        report["export_parity"] = max(parity, report.get("export_parity", 0.0))
    run.write_json("actor.json", report)
    card.write(run, report, card.ACTOR)
    figures.actor(run.folder, report)
    return report


def learned_and_judged(
    run: TrainingRun, settings: ActorSettings, board: Board
) -> tuple[LearnedActor, dict[str, Any]]:
    """What was learned on a board, and its report; each part is done once where a training is
    resumed."""
    name, started = board_name(board), time.monotonic()
    learned = learn_all(run, settings, board)
    trained_s = run.kept(f"{name}-seconds", lambda: round(time.monotonic() - started, 1))
    agents: list[SettingPolicy] = [OfModule(agent) for agent in learned.agents]
    policies = {**learned.policies(), **rivals(board)}
    if settings.predictive:
        policies |= predictive(board)
    near = {name: policy for name, policy in policies.items() if name in ELSEWHERE}
    bench = run.kept(f"{name}-bench", partial(_bench, board, settings, run.seed, run.folder.parent))
    bench = replace(bench, board=board)  # the folder of the rig may have moved since
    report = run.kept(f"{name}-judged", partial(judge, bench, policies, agents, settings.workers))
    if settings.elsewhere:
        report |= _elsewhere(run, settings, bench, near)
    training = {"steps": settings.ddpg.steps, "agents": settings.seeds, "seconds": trained_s}
    return learned, report | {
        "shipped": _better(report),
        "ddpg_seed": learned.best,
        "training": training,
    }


def _elsewhere(
    run: TrainingRun, settings: ActorSettings, bench: Bench, near: dict[str, SettingPolicy]
) -> dict[str, Any]:
    """Policies where machines are known by their drawing alone, and on nearer plants."""
    board, report = bench.board, {}
    name = board_name(board)
    report["as_drawn"] = run.kept(f"{name}-drawn", partial(as_drawn, bench, near, settings.workers))
    machine = partial(on_machine, bench, near, settings.machine_episodes, settings.workers)
    report["whole_machine"] = run.kept(f"{name}-machine", machine)
    if not board.pressure:
        direct = partial(directly, bench, near, settings.direct_episodes, settings.workers)
        report["direct_reynolds"] = run.kept(f"{name}-direct", direct)
    return report


def evaluate(
    path: Path, seed: int, size: int | None, out: Path, settings: ActorSettings | None = None
) -> dict[str, object]:
    """The policy in ``path``, and those in the files beside it, with their rivals on the episodes
    of ``seed``.

    The machines are commissioned; what the same is worth where they are known by their drawing
    alone stands beside it. A file that sets the pressure as well is judged on that scoreboard.  The
    model-predictive choice, which takes longer than everything else together, stands in the report
    of the training.
    """
    settings = settings or ActorSettings()
    settings = settings if size is None else msgspec.structs.replace(settings, judged_episodes=size)
    board = settings.board(pressure=len(OfFile(path).outputs) > 1)
    beside = {name: path.with_name(f"{path.stem}_{name}.onnx") for name in ("ddpg", "lookup")}
    learned: dict[str, SettingPolicy] = {"agent": OfFile(path)}
    learned |= {name: OfFile(file) for name, file in beside.items() if file.is_file()}
    bench = _bench(board, settings, seed, out)
    policies = {**learned, **rivals(board)}
    return {
        "unseen_episodes": judge(bench, policies, [], settings.workers),
        "as_drawn": as_drawn(
            bench, {name: p for name, p in policies.items() if name in ELSEWHERE}, settings.workers
        ),
        "whole_machine": on_machine(bench, learned, settings.machine_episodes, settings.workers),
    }


def _bench(board: Board, settings: ActorSettings, seed: int, out: Path) -> Bench:
    seeds = range(JUDGE_SEED + 1000 * seed, JUDGE_SEED + 1000 * seed + settings.judged_episodes)
    return Bench.of(board, seeds, out, settings.workers)


def _better(report: dict[str, Any]) -> str:
    """Which of DDPG and lookup table ships."""
    times = [report["policies"][name]["violation_s"] for name in ("ddpg", "lookup")]
    return "ddpg" if times[0] <= times[1] and beats(report["ddpg_less_lookup"]) else "lookup"


def _export_all(
    run: TrainingRun, board: Board, learned: LearnedActor, report: dict[str, Any]
) -> float:
    """Write DDPG, lookup table and what ships; returns the largest distance of a file from its
    module."""
    stem = run.model.with_name("actor_pair.onnx") if board.pressure else run.model
    modules: dict[str, nn.Module] = {"ddpg": learned.agents[learned.best], "lookup": learned.table}
    files = {stem.with_name(f"{stem.stem}_{name}.onnx"): name for name in modules} | {
        stem: report["shipped"]
    }
    return max(
        _export(modules[name], path, name, run, board, report) for path, name in files.items()
    )


def _export(
    module: nn.Module,
    path: Path,
    policy: str,
    run: TrainingRun,
    board: Board,
    report: dict[str, Any],
) -> float:
    """Write one file; returns how far it is from the module."""
    names, outputs = tuple(OBSERVATIONS), OUTPUTS[: board.reach.shape[1]]
    units = (
        "rad/s",
        "m",
        "m",
        "m",
        "m",
        "m",
        "bar",
        "W",
        "degC",
        "N",
        "1",
        *("-> m", "-> Pa")[: len(outputs)],
    )
    metadata = export.Metadata(
        kind="actor",
        version="0.3.0",
        inputs=names,
        outputs=outputs,
        rate_hz=(10,),
        channels=(),
        units=units,
        rigs=(board.rig,),
        domain=ranges_of(board.data),
        data_hash=export.data_hash(np.array([run.seed])),
        settings={"policy": policy},
        metrics={"policies": report["policies"], "reproduce": run.command},
    )
    columns = Columns(module, len(outputs))
    export.export(
        columns,
        torch.zeros(2, len(names)),
        path,
        input_name="observation",
        output_names=outputs,
        metadata=metadata,
    )
    return export.parity(columns, path, random_observations(board.data, 10_000, run.seed))
