"""Third series: the DDPG agent on rig ``seed``, in watts beside constant clearances."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from models.control.episodes import Board, Fixed, Policy, Score, play
from models.control.learners import ActorSettings, learn
from models.control.policies import OfModule
from models.learning.ddpg import DdpgSettings
from models.reproduce.claims import POWER
from models.reproduce.report import Row, Series
from models.runs import progress_bar
from sim_hil.plots.style import BLUE, GREY, new_figure, plain
from sim_hil.rigs import load_rig

JUDGE_SEED = 2_000_000


def run(quick: bool, seed: int) -> Series:
    """The series; ``quick`` trains for a few steps only, which teaches nothing."""
    bearing = load_rig("seed").bearing
    settings = ActorSettings(
        rig="seed", rotors=4 if quick else 16, episode_s=2.0 if quick else 8.0,
        ddpg=DdpgSettings(steps=160, warm_up=80, batch=32, hidden=(16, 16)) if quick else DdpgSettings(steps=8000),
    )  # fmt: skip
    count, seconds = (2, 1.0) if quick else (24, 12.0)
    board = Board("seed", seconds)
    with progress_bar("DDPG on rig seed", settings.ddpg.steps) as bar:
        agent = OfModule(learn(settings, board, seed, bar)[0])
    seeds = range(JUDGE_SEED + 1000 * seed, JUDGE_SEED + 1000 * seed + count)
    policies: dict[str, Policy] = {
        "agent": agent,
        "constant nominal": Fixed(bearing.clearance_nominal_m),
        "constant widest": Fixed(bearing.clearance_max_m),
    }
    scores = {name: play(board, seeds, policy, shielded=True) for name, policy in policies.items()}
    power = {name: float(score.power_W.mean()) for name, score in scores.items()}
    measured: dict[str, object] = {
        "training_steps": settings.ddpg.steps, "episodes": count,
        "saving_percent_of_nominal": _saving(power, "constant nominal"),
        "saving_percent_of_widest": _saving(power, "constant widest"),
        **{name: score.summary(seconds) for name, score in scores.items()},
    }  # fmt: skip
    row = Row(
        "control", POWER,
        f"DDPG: {power['agent']:.2f} W; {_saving(power, 'constant nominal'):+.1f} % less than the nominal clearance's "
        f"{power['constant nominal']:.2f} W",
        f"constant widest clearance: {power['constant widest']:.2f} W; the agent saves "
        f"{_saving(power, 'constant widest'):+.1f} % of it",
        f"Mean shaft power over {count} unseen episodes behind the guard's shield, {settings.ddpg.steps} training "
        "steps, one seed. No limit binds when the clearance is widened on this rig, so the constant widest clearance "
        "is the baseline to beat; control claims rest on rig bench (`orbitd evaluate actor`).",
    )  # fmt: skip
    return Series("Control", [row], measured, [(_draw(scores), "mean shaft power of every unseen episode")])


def _saving(power: dict[str, float], baseline: str) -> float:
    return round(100.0 * (1.0 - power["agent"] / power[baseline]), 2)


def _draw(scores: dict[str, Score]) -> Figure:
    figure = new_figure((7.0, 3.5), "Shaft power on rig seed", "behind the guard's shield")
    axes = figure.subplots()
    order = np.argsort(scores["constant widest"].power_W)
    for (name, score), colour, mark in zip(scores.items(), (BLUE, GREY, "black"), "ox+", strict=True):
        axes.plot(score.power_W[order], mark, color=colour, label=name)
    plain(axes, "episode", "mean shaft power, W")
    axes.legend(fontsize=8)
    return figure
