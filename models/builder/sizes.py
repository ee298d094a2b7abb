"""How much a build does: a trial of minutes, or the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from models.control.learners import ActorSettings
from models.diagnosis.classifier import ClassifierSettings
from models.diagnosis.judge import JudgeSettings
from models.diagnosis.rungs import LadderSettings
from models.film.surrogate import SurrogateSettings
from models.learning.ddpg import DdpgSettings
from models.prediction.predictor import PredictorSettings

Size = Literal["trial", "full"]
SIZES: Final[tuple[Size, ...]] = ("trial", "full")


@dataclass(frozen=True)
class Sizes:
    """Settings of every trainer, before they are given the machine.

    ``sealed``: whether the frozen evaluation of ``models/bars.toml`` follows; ``sensors``: neurons
    a head and iterations of the networks that tell what a missing sensor costs.
    """

    surrogate: SurrogateSettings
    predictor: PredictorSettings
    classifier: ClassifierSettings
    policies: ActorSettings
    sensors: tuple[int, int]
    sealed: bool


FULL: Final = Sizes(
    surrogate=SurrogateSettings(seeds=3, paper_points=600, paper_iterations=40),
    predictor=PredictorSettings(episodes=960, judged_episodes=80),
    classifier=ClassifierSettings(
        builds=1000,
        raw_builds=0,
        judge=JudgeSettings(
            builds=60,
            unknown_builds=30,
            watched_builds=120,
            held_builds=4,
            onset_builds=20,
            keep_samples=False,
        ),
        ladder=LadderSettings(waveforms=False),
        keep_samples=False,
    ),
    policies=ActorSettings(
        seeds=3, judged_episodes=24, pair=False, predictive=False, elsewhere=False
    ),
    sensors=(8, 400),
    sealed=True,
)
"""Bars of the sealed test hold for a machine like ``bench``."""

TRIAL: Final = Sizes(
    surrogate=SurrogateSettings(
        train_points=500,
        judge_points=24,
        grid=(160, 32),
        judge_grid=(240, 48),
        l2=(1e-8,),
        restarts=1,
        iterations=200,
        seeds=1,
        dissipation_points=20_000,
        paper_points=200,
        paper_iterations=10,
    ),
    predictor=PredictorSettings(episodes=24, judged_episodes=8),
    classifier=ClassifierSettings(
        builds=60,
        raw_builds=0,
        judge=JudgeSettings(
            builds=12,
            unknown_builds=4,
            watched_builds=8,
            held_builds=1,
            onset_builds=4,
            keep_samples=False,
        ),
        ladder=LadderSettings(
            members=2, l2=(3e-4,), iterations=200, paper_iterations=20, waveforms=False
        ),
        folds=3,
        keep_samples=False,
    ),
    policies=ActorSettings(
        seeds=1,
        rotors=4,
        episode_s=5.0,
        ddpg=DdpgSettings(steps=400, warm_up=200, batch=32, hidden=(16, 16)),
        dqn_clearances=5,
        lookup_points=(4, 3, 7),
        validation_episodes=2,
        judged_episodes=4,
        judged_seconds=10.0,
        pair=False,
        predictive=False,
        elsewhere=False,
    ),
    sensors=(6, 100),
    sealed=False,
)
"""The same steps in minutes: its models work, and are provisional whatever they reach."""


def sizes_of(size: Size) -> Sizes:
    """The settings of that name."""
    return FULL if size == "full" else TRIAL
