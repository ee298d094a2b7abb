"""One scoreboard played: every policy in the same unseen episodes, and some of them on nearer
plants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from models.control.episodes import (
    Board,
    FixedSetting,
    Score,
    SettingPolicy,
    play_all,
    play_machine,
)
from models.control.judge import Bench
from models.control.predictive import ModelPredictive
from models.control.rivals import AdaptivePI, EccentricityPI, Fed
from models.runs import progress_bar

PI = (0.45, 40e-6, 60e-6)
"""Set point of the eccentricity ratio, gain and integral gain of both controllers."""


def judge(
    bench: Bench, policies: dict[str, SettingPolicy], agents: list[SettingPolicy], workers: int
) -> dict[str, Any]:
    """Figures of every policy behind the shield and without it, and of all agents together."""
    everything = [*policies.values(), *agents]
    played = [(policy, shielded) for shielded in (True, False) for policy in everything]
    scores = bench.play([*played, (nominal(bench.board), False)], workers)
    behind, alone = scores[: len(everything)], scores[len(everything) : -1]
    shielded = dict(zip(policies, behind, strict=False))
    rows = {name: bench.figures(score) for name, score in shielded.items()}
    rows |= {
        f"{name}_without_shield": bench.figures(s) for name, s in zip(policies, alone, strict=False)
    }
    report: dict[str, Any] = {
        **bench.header(),
        "policies": rows | {"nominal_fixed": bench.figures(scores[-1])},
    }
    if agents:
        report["ddpg_all_seeds"] = bench.over_seeds(behind[len(policies) :])
        report["ddpg_all_seeds_without_shield"] = bench.over_seeds(alone[len(policies) :])
    first, *others = policies
    return report | {
        f"{first}_less_{name}": bench.paired(shielded[first], shielded[name]) for name in others
    }


def rivals(board: Board) -> dict[str, SettingPolicy]:
    """What needs no training; ``widest`` wishes for the largest clearance always, and shows what
    the shield gives.

    Where the pressure may be set they leave it at its least.
    """
    low, high = board.reach[:, 0].tolist()
    rivals: dict[str, SettingPolicy] = {
        "pi": EccentricityPI(*PI, (low, high)),
        "adaptive_pi": AdaptivePI(*PI, (low, high)),
        "widest": FixedSetting(high),
    }
    if board.pressure:
        return {name: Fed(policy, float(board.reach[0, 1])) for name, policy in rivals.items()}
    return rivals


def predictive(board: Board) -> dict[str, SettingPolicy]:
    """The model-predictive choice, twenty times slower than the others; its predictor knows the
    unfed film only."""
    return {} if board.pressure else {"model_predictive": ModelPredictive(board.rig)}


def nominal(board: Board) -> FixedSetting:
    """The rig's nominal setting."""
    return FixedSetting(
        board.data.bearing.clearance_nominal_m,
        board.data.supply.nominal_Pa if board.pressure else None,
    )


def on_machine(
    bench: Bench, policies: dict[str, SettingPolicy], episodes: int, workers: int
) -> dict[str, dict[str, float]]:
    """Behind the shield on the whole machine with its sensors."""
    board, seeds = bench.board, bench.seeds[:episodes]
    with progress_bar("whole machine", len(policies)) as bar:
        scores = play_all(
            board,
            seeds,
            [(policy, True) for policy in policies.values()],
            workers,
            bar,
            play_machine,
        )
    return {
        name: score.summary(board.seconds) for name, score in zip(policies, scores, strict=True)
    }


def as_drawn(bench: Bench, policies: dict[str, SettingPolicy], workers: int) -> dict[str, Any]:
    """Behind the shield of machines of which no more is known than their drawing."""
    drawn = replace(bench, board=replace(bench.board, commissioned=False))
    scores = drawn.play([(policy, True) for policy in policies.values()], workers)
    return {name: drawn.figures(score) for name, score in zip(policies, scores, strict=True)}


def directly(
    bench: Bench, policies: dict[str, SettingPolicy], episodes: int, workers: int
) -> dict[str, Any]:
    """Policies behind the shield and fixed settings with Reynolds' equation solved in every step,
    less the table's."""
    board, seeds = bench.board, bench.seeds[:episodes]
    fixed = {"best_fixed": bench.setting, "nominal_fixed": nominal(board)}
    played = [(policy, True) for policy in policies.values()] + [
        (policy, False) for policy in fixed.values()
    ]
    with progress_bar("direct Reynolds", len(played)) as bar:
        direct = play_all(replace(board, direct=True), seeds, played, workers, bar)
    with progress_bar("the same from the table", len(played)) as bar:
        table = play_all(board, seeds, played, workers, bar)
    rows = zip((*policies, *fixed), direct, table, strict=True)
    return {
        "episodes": len(seeds),
        **{name: _difference(a, b, board.seconds) for name, a, b in rows},
    }


def _difference(direct: Score, table: Score, seconds: float) -> dict[str, float]:
    """What the direct film gives, and its largest differences in an episode from the table's."""
    off_W, off_m = direct.power_W - table.power_W, direct.min_film_m - table.min_film_m
    return direct.summary(seconds) | {
        "less_table_W": round(float(off_W.mean()), 4),
        "less_table_W_worst": round(float(np.abs(off_W).max()), 4),
        "less_table_film_um_worst": round(1e6 * float(np.abs(off_m).max()), 3),
    }
