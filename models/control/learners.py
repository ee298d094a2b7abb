"""The learned policies of one board: DDPG over several seeds behind the guard's shield, DQN, and a
table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch

from models.control.episodes import Board, SettingPolicy, play_all
from models.control.policies import (
    BoundedSettings,
    OfModule,
    OfValues,
    actions_of_choices,
    choices,
    scale,
)
from models.control.rivals import Lookup, lookup
from models.control.shielded import ShieldedRotors
from models.learning.ddpg import DdpgSettings, train_ddpg
from models.learning.dqn import Values, train_dqn
from models.runs import TrainerSettings, TrainingRun, progress_bar
from models.workers import map_in_order

VALIDATION_SEED = 500_000
"""Added to the seed of the episodes that choose among the agents: none of training, none of
judgement."""


class ActorSettings(TrainerSettings, frozen=True):
    """What ``orbitd train actor`` does; every key may stand in the ``--config`` file."""

    rig: str = "bench"
    seeds: int = 10
    rotors: int = 16
    episode_s: float = 15.0
    ddpg: DdpgSettings = DdpgSettings(steps=16_000)
    dqn_clearances: int = 13
    lookup_points: tuple[int, int, int] = (7, 6, 13)
    validation_episodes: int = 16
    judged_episodes: int = 50
    judged_seconds: float = 20.0
    machine_episodes: int = 10
    direct_episodes: int = 10
    workers: int = 2
    pair: bool = True
    """Whether the supply pressure is learned beside the clearance, on a second board."""
    predictive: bool = True
    """Whether the model-predictive choice is played, twenty times slower than the others."""
    elsewhere: bool = True
    """Whether some are also played on the whole machine, on direct Reynolds, and as drawn."""

    def smoked(self) -> ActorSettings:
        """The same training in some seconds."""
        return ActorSettings(
            seeds=2,
            rotors=4,
            episode_s=2.0,
            ddpg=DdpgSettings(steps=240, warm_up=80, batch=32, hidden=(16, 16)),
            lookup_points=(2, 2, 3),
            validation_episodes=2,
            judged_episodes=1,
            judged_seconds=1.0,
            machine_episodes=1,
            direct_episodes=1,
            workers=1,
        )

    def board(self, *, pressure: bool) -> Board:
        """Where policies are judged."""
        return Board(self.rig, self.judged_seconds, pressure)


Curve = list[tuple[int, float]]
"""Steps done, and the mean return of the episodes that ended there."""


@dataclass(frozen=True)
class LearnedActor:
    """What was learned on a board: agents of all seeds, the number of the best, values of choices,
    the table."""

    agents: list[BoundedSettings]
    best: int
    values: OfValues
    table: Lookup

    def policies(self) -> dict[str, SettingPolicy]:
        """By name; the best agent stands for DDPG."""
        return {
            "ddpg": OfModule(self.agents[self.best]),
            "lookup": OfModule(self.table),
            "dqn": self.values,
        }


def learn(
    settings: ActorSettings,
    board: Board,
    seed: int,
    on_step: Callable[[int], None] | None = None,
    *,
    shielded: bool = True,
) -> tuple[BoundedSettings, Curve]:
    """One DDPG agent, trained behind the shield or, as the paper's, without."""
    torch.set_num_threads(1)
    curve: Curve = []
    actor = train_ddpg(
        _environment(settings, board, shielded),
        scale(board.data),
        settings.ddpg,
        seed,
        on_step,
        lambda step, total: curve.append((step, total)),
    )
    return BoundedSettings(actor, board.reach), curve


def learn_all(run: TrainingRun, settings: ActorSettings, board: Board) -> LearnedActor:
    """Everything that is learned on ``board``, agents side by side; done once where a training is
    resumed."""
    name = board_name(board)
    agents = _agents(run, settings, board)
    values = run.kept(f"{name}-dqn", partial(_values, settings, board, run.seed))
    with progress_bar(f"{name}: lookup table", settings.lookup_points[0]) as bar:
        table = run.kept(
            f"{name}-lookup", partial(lookup, board, settings.lookup_points, settings.workers, bar)
        )
    best = run.kept(f"{name}-best", partial(_choose, agents, settings, board, run.seed))
    return LearnedActor(
        agents, best, OfValues(values, choices(board, settings.dqn_clearances)), table
    )


def board_name(board: Board) -> str:
    """Of a board in files and reports."""
    return "pair" if board.pressure else "clearance"


def _environment(settings: ActorSettings, board: Board, shielded: bool = True) -> ShieldedRotors:
    rotors = replace(board, seconds=settings.episode_s).rotors(settings.rotors)
    return ShieldedRotors(rotors, shielded=shielded, commissioned=board.commissioned)


def _agents(run: TrainingRun, settings: ActorSettings, board: Board) -> list[BoundedSettings]:
    names = [f"{board_name(board)}-agent{number}" for number in range(settings.seeds)]
    missing = [number for number, name in enumerate(names) if not run.has(name)]
    seeds = [1000 * run.seed + number for number in missing]
    learned = zip(
        missing, map_in_order(partial(learn, settings, board), seeds, settings.workers), strict=True
    )
    found = []
    with progress_bar(f"{board_name(board)}: DDPG", settings.seeds) as bar:
        for done, name in enumerate(names, 1):
            found.append(run.kept(name, lambda: _logged(run, board, *next(learned))))
            bar(done)
    return found


def _logged(
    run: TrainingRun, board: Board, number: int, learned: tuple[BoundedSettings, Curve]
) -> BoundedSettings:
    """The agent; its returns go to the run's metrics."""
    agent, curve = learned
    for step, total in curve:
        run.log(
            {"board": board_name(board), "agent": number, "step": step, "return": round(total, 3)}
        )
    return agent


def _values(settings: ActorSettings, board: Board, seed: int) -> Values:
    with progress_bar(f"{board_name(board)}: DQN", settings.ddpg.steps) as bar:
        actions = actions_of_choices(board, settings.dqn_clearances)
        return train_dqn(
            _environment(settings, board), scale(board.data), settings.ddpg, actions, seed, bar
        )


def _choose(agents: list[BoundedSettings], settings: ActorSettings, board: Board, seed: int) -> int:
    """Number of the agent with least violation, then least power, on validation episodes."""
    seeds = range(
        VALIDATION_SEED + 1000 * seed, VALIDATION_SEED + 1000 * seed + settings.validation_episodes
    )
    with progress_bar(f"{board_name(board)}: validation", len(agents)) as bar:
        scores = play_all(
            board, seeds, [(OfModule(agent), True) for agent in agents], settings.workers, bar
        )
    return min(
        range(len(agents)),
        key=lambda i: (float(scores[i].violation_s.sum()), float(scores[i].power_W.mean())),
    )
