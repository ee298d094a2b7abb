"""Judged episodes: what a policy does in the rotors of many seeds, with the shield or without."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from models.control.shielded import Observation, ShieldedRotor, ShieldedRotors, column
from models.workers import map_in_order
from sim_hil.film.direct_reynolds import ReynoldsLaw
from sim_hil.film.table import FilmTable
from sim_hil.gym.control_task import CONTROL_S, EpisodeLimits, actions_of
from sim_hil.gym.environment import RotorEnv
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.rigs import RigData, load_rig

Floats = NDArray[np.float64]

SIDE_BY_SIDE = 10
"""Episodes that one process plays at once: with any number of processes the same ones stand
together."""


def untripped(rig: RigData) -> EpisodeLimits:
    """A film thin enough to trip is a violation that ends nothing: every episode is as long as the
    others."""
    return replace(EpisodeLimits.of_rig(rig), trip_film_m=-1.0)


class SettingPolicy(Protocol):
    """Chooses the settings of many rotors at once; travels to other processes before an episode
    starts."""

    def start(self, count: int) -> None:
        """A new episode of ``count`` rotors begins."""

    def __call__(self, observation: Observation) -> Floats:
        """Observations (count, 11), SI, to wishes (count, k): clearance, m, and where it may be set
        pressure, Pa."""


@dataclass(frozen=True)
class FixedSetting:
    """The same setting all the time: clearance, m, and supply pressure, Pa, where that may be
    set."""

    clearance_m: float
    pressure_Pa: float | None = None

    def start(self, count: int) -> None:
        """Nothing to forget."""

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`SettingPolicy`."""
        wish = (
            [self.clearance_m] if self.pressure_Pa is None else [self.clearance_m, self.pressure_Pa]
        )
        return np.tile(wish, (len(observation), 1))


@dataclass(frozen=True)
class Board:
    """A scoreboard: the rig, how long its episodes are, and whether the supply pressure is set with
    the clearance.

    The machines are ``commissioned`` (:mod:`models.control.commissioned`), or known by their
    drawing alone.

    Alone, the clearance stands on the unfed film; with the pressure, on the film fed from the
    groove, the pump's power counts, and so do the limits of flow and outlet
    (:class:`sim_hil.gym.control_task.EpisodeLimits`).  ``direct`` solves Reynolds' equation in
    every step instead of reading the film from its table.
    """

    rig: str
    seconds: float
    pressure: bool = False
    direct: bool = False
    commissioned: bool = True

    @property
    def data(self) -> RigData:
        """The rig's."""
        return load_rig(self.rig)

    @property
    def reach(self) -> Floats:
        """Smallest and largest setting, shape (2, k)."""
        b, supply = self.data.bearing, self.data.supply
        both = np.array([[b.clearance_min_m, supply.min_Pa], [b.clearance_max_m, supply.max_Pa]])
        return both[:, : 1 + self.pressure]

    @property
    def limits(self) -> EpisodeLimits:
        """What the rig's device is to keep."""
        return untripped(self.data)

    def rotors(self, count: int, limits: EpisodeLimits | None = None) -> RotorVectorEnv:
        """That many rotors."""
        law = None
        if self.direct:
            ratio = self.data.bearing.length_m / (2.0 * self.data.bearing.radius_m)
            law = ReynoldsLaw.make(FilmTable.load(ratio).coefficients, ratio)
        return RotorVectorEnv(
            count, self.rig, self.seconds, limits=limits, pressure=self.pressure, law=law
        )


@dataclass(frozen=True)
class Score:
    """What a policy did, one entry an episode.

    Parameters
    ----------
    power_W, violation_s, min_film_m, swing_share
        Mean power (the pump's with it where the pressure is set), time with a limit broken,
        smallest film, largest peak-to-peak over clearance.
    intervened
        Share of the steps in which the shield changed the wish.
    travel_m
        Way of the actuator.
    """

    power_W: Floats
    violation_s: Floats
    min_film_m: Floats
    swing_share: Floats
    intervened: Floats
    travel_m: Floats

    @classmethod
    def joined(cls, parts: Sequence[Score]) -> Score:
        """Episodes of all parts, in their order."""
        return cls(
            *(
                np.concatenate([getattr(s, name) for s in parts])
                for name in cls.__dataclass_fields__
            )
        )

    def depth(self, limits: EpisodeLimits) -> Floats:
        """By how much the worst instant of each episode broke film or swing, as a share of the
        limit."""
        lack = 1.0 - self.min_film_m / limits.min_film_m
        return np.maximum(0.0, np.maximum(lack, self.swing_share / limits.swing_share - 1.0))

    def kept(self, counted: NDArray[np.bool_]) -> Score:
        """Only the counted episodes."""
        return Score(*(getattr(self, name)[counted] for name in self.__dataclass_fields__))

    def summary(self, seconds: float) -> dict[str, float]:
        """Means and worst over the episodes, in the units that the names say."""
        figures = {
            "power_W": self.power_W.mean(),
            "violation_s": self.violation_s.sum(),
            "episodes_in_violation": float((self.violation_s > 0).sum()),
            "min_film_um": 1e6 * self.min_film_m.min(),
            "swing_share": self.swing_share.max(),
            "intervention_share": self.intervened.mean(),
            "travel_um_per_s": 1e6 * self.travel_m.mean() / seconds,
        }
        return {name: float(f"{value:.4g}") for name, value in figures.items()}


def play(board: Board, seeds: Sequence[int], policy: SettingPolicy, *, shielded: bool) -> Score:
    """Run ``policy`` once in the episode of each seed, rotors alone, all side by side."""
    rotors = board.rotors(len(seeds), board.limits)
    environment = ShieldedRotors(rotors, shielded=shielded, commissioned=board.commissioned)
    observation, _ = environment.reset(seed=list(seeds))
    policy.start(len(seeds))
    record = _Record(observation)
    for _ in range(round(board.seconds / CONTROL_S)):
        observation, _, _, _, info = environment.step(actions_of(board.data, policy(observation)))
        record.add(info)
    return record.score()


def play_machine(
    board: Board, seeds: Sequence[int], policy: SettingPolicy, *, shielded: bool
) -> Score:
    """The same behind the shield on the whole machine with its sensors, one episode after
    another."""
    if not shielded:
        raise ValueError(
            "the whole machine is played behind its shield only; use `play` for the rotor alone"
        )
    rotor = RotorEnv(board.rig, board.seconds, limits=board.limits, pressure=board.pressure)
    environment = ShieldedRotor(rotor, commissioned=board.commissioned)
    scores = []
    for seed in seeds:
        observation, _ = environment.reset(seed=seed)
        policy.start(1)
        record = _Record(observation[None])
        for _ in range(round(board.seconds / CONTROL_S)):
            wish = policy(observation[None])
            observation, _, _, _, info = environment.step(actions_of(board.data, wish)[0])
            record.add({name: np.array([value]) for name, value in info.items()})
        scores.append(record.score())
    return Score.joined(scores)


def play_all(
    board: Board,
    seeds: Sequence[int],
    played: Sequence[tuple[SettingPolicy, bool]],
    workers: int,
    progress: Callable[[int], None],
    how: Callable[..., Score] = play,
) -> list[Score]:
    """:func:`play` of every policy, shielded or not, on several processes; or ``how`` else it is
    played."""
    together = SIDE_BY_SIDE if how is play and not board.direct else 1
    parts = [seeds[i : i + together] for i in range(0, len(seeds), together)]
    tasks = list(product(played, parts))
    scores = []
    for done, score in enumerate(map_in_order(partial(_play_part, how, board), tasks, workers), 1):
        scores.append(score)
        progress(done // len(parts))
    return [Score.joined(scores[i : i + len(parts)]) for i in range(0, len(scores), len(parts))]


def _play_part(
    how: Callable[..., Score], board: Board, part: tuple[tuple[SettingPolicy, bool], Sequence[int]]
) -> Score:
    (policy, shielded), seeds = part
    return how(board, seeds, policy, shielded=shielded)


class _Record:
    """Gathers the steps of episodes that run side by side."""

    def __init__(self, observation: Observation) -> None:
        self._before_m = observation[:, column("clearance_m")].astype(np.float64)
        self._rows: list[list[Floats]] = []

    def add(self, info: Mapping[str, Floats]) -> None:
        """One step."""
        clearance_m = info["clearance_m"]
        self._rows.append(
            [
                info["power_W"],
                CONTROL_S * info["violated"],
                info["min_film_m"],
                info["peak_to_peak_m"] / clearance_m,
                info["intervened"],
                np.abs(clearance_m - self._before_m),
            ]
        )
        self._before_m = clearance_m

    def score(self) -> Score:
        """Over the steps so far."""
        power, violation, film, share, intervened, moved = np.array(
            self._rows, dtype=np.float64
        ).transpose(1, 2, 0)
        return Score(
            power.mean(axis=1),
            violation.sum(axis=1),
            film.min(axis=1),
            share.max(axis=1),
            intervened.mean(axis=1),
            moved.sum(axis=1),
        )
