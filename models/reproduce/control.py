"""Third series: the DDPG agent on rig ``seed``, in watts beside constant clearances; as the
paper's, and shielded."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from models.control.episodes import Board, FixedSetting, Score, SettingPolicy, play
from models.control.learners import ActorSettings, learn
from models.control.policies import OfModule
from models.learning.ddpg import DdpgSettings
from models.reproduce.claims import POWER
from models.reproduce.report import ClaimRow, Series
from models.runs import progress_bar
from sim_hil.plots.style import BLUE, GREY, new_figure, plain
from sim_hil.rigs import load_rig

JUDGE_SEED = 2_000_000

AGENT, NOMINAL, WIDEST = "DDPG agent", "constant nominal", "constant widest"


def run(quick: bool, seed: int) -> Series:
    """The series; ``quick`` trains for a few steps only, which teaches nothing."""
    settings = ActorSettings(
        rig="seed",
        rotors=4 if quick else 16,
        episode_s=2.0 if quick else 8.0,
        ddpg=DdpgSettings(steps=160, warm_up=80, batch=32, hidden=(16, 16))
        if quick
        else DdpgSettings(steps=8000),
    )
    count, seconds = (2, 1.0) if quick else (24, 12.0)
    seeds = range(JUDGE_SEED + 1000 * seed, JUDGE_SEED + 1000 * seed + count)
    free, behind = (
        _scores(settings, Board("seed", seconds), seed, seeds, shielded)
        for shielded in (False, True)
    )
    row = ClaimRow(
        "control",
        POWER,
        _told(free),
        f"behind the guard's shield: {_told(behind)}",
        f"Mean shaft power over {count} unseen episodes, {settings.ddpg.steps} training steps, one "
        f"seed. Power falls "
        "with clearance on this rig, so the constant widest is the baseline to beat, at equal "
        "seconds in violation. "
        "Where no clearance is admissible the shield holds the safe one whatever is wished: "
        "violations that all share.",
        "orbitd evaluate actor --qualify (control on rig bench, where limits bind)",
    )
    measured: dict[str, object] = {"training_steps": settings.ddpg.steps, "episodes": count}
    drawings = []
    for title, scores in (("without the shield", free), ("behind the guard's shield", behind)):
        savings = {f"saving_percent_of_{name}": _saving(scores, name) for name in (NOMINAL, WIDEST)}
        measured[title] = savings | {name: score.summary(seconds) for name, score in scores.items()}
        drawings.append(
            (_draw(scores, title), f"mean shaft power of every unseen episode, {title}")
        )
    return Series("Control", [row], measured, drawings)


def _scores(
    settings: ActorSettings, board: Board, seed: int, seeds: range, shielded: bool
) -> dict[str, Score]:
    """The agent, trained as it is judged, and the constant clearances on the same episodes."""
    bearing = load_rig("seed").bearing
    with progress_bar(
        f"DDPG on rig seed{', shielded' if shielded else ''}", settings.ddpg.steps
    ) as bar:
        agent = OfModule(learn(settings, board, seed, bar, shielded=shielded)[0])
    policies: dict[str, SettingPolicy] = {
        AGENT: agent,
        NOMINAL: FixedSetting(bearing.clearance_nominal_m),
        WIDEST: FixedSetting(bearing.clearance_max_m),
    }
    return {
        name: play(board, seeds, policy, shielded=shielded) for name, policy in policies.items()
    }


def _told(scores: dict[str, Score]) -> str:
    """Watts and seconds of violation of all three, and what the agent saves."""
    watts = ", ".join(
        f"{name} {score.power_W.mean():.2f} W ({score.violation_s.sum():.0f} s in violation)"
        for name, score in scores.items()
    )
    return (
        f"{watts}; the agent's saving is {_saving(scores, NOMINAL):.1f} % of the nominal's power "
        f"and "
        f"{_saving(scores, WIDEST):.1f} % of the widest's"
    )


def _saving(scores: dict[str, Score], baseline: str) -> float:
    return round(
        100.0 * (1.0 - float(scores[AGENT].power_W.mean() / scores[baseline].power_W.mean())), 2
    )


def _draw(scores: dict[str, Score], title: str) -> Figure:
    figure = new_figure((7.0, 3.5), "Shaft power on rig seed", title)
    axes = figure.subplots()
    order = np.argsort(scores[WIDEST].power_W)
    for (name, score), colour, mark in zip(
        scores.items(), (BLUE, GREY, "black"), "ox+", strict=True
    ):
        axes.plot(score.power_W[order], mark, color=colour, label=name)
    plain(axes, "episode", "mean shaft power, W")
    axes.legend(fontsize=8)
    return figure
