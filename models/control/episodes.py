"""Judged episodes: what a policy does in the rotors of many seeds, with the shield or without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from models.control.shielded import Observation, ShieldedRotor, ShieldedRotors, actions_of, column
from sim_hil.control_task import CONTROL_S, Limits
from sim_hil.environment import RotorEnv
from sim_hil.vector_environment import RotorVectorEnv

Floats = NDArray[np.float64]


class Policy(Protocol):
    """Chooses radial clearances for many rotors at once."""

    def start(self, count: int) -> None:
        """A new episode of ``count`` rotors begins."""

    def __call__(self, observation: Observation) -> Floats:
        """Observations (count, 11), SI, to the clearances wished for (count,), m."""


@dataclass(frozen=True)
class Fixed:
    """The same clearance all the time, m."""

    clearance_m: float

    def start(self, count: int) -> None:
        """Nothing to forget."""

    def __call__(self, observation: Observation) -> Floats:
        """As :class:`Policy`."""
        return np.full(len(observation), self.clearance_m)


@dataclass(frozen=True)
class Score:
    """What a policy did, one entry an episode.

    Parameters
    ----------
    power_W, violation_s, min_film_m, swing_share
        Mean shaft power, time with a limit broken, smallest film, largest peak-to-peak over clearance.
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

    def kept(self, counted: NDArray[np.bool_]) -> Score:
        """Only the counted episodes."""
        return Score(*(getattr(self, name)[counted] for name in self.__dataclass_fields__))

    def summary(self, seconds: float) -> dict[str, float]:
        """Means and worst over the episodes, in the units that the names say."""
        figures = {
            "power_W": self.power_W.mean(), "violation_s": self.violation_s.sum(),
            "episodes_in_violation": float((self.violation_s > 0).sum()), "min_film_um": 1e6 * self.min_film_m.min(),
            "swing_share": self.swing_share.max(), "intervention_share": self.intervened.mean(),
            "travel_um_per_s": 1e6 * self.travel_m.mean() / seconds,
        }  # fmt: skip
        return {name: float(f"{value:.4g}") for name, value in figures.items()}


def play(policy: Policy, seeds: Sequence[int], seconds: float, *, shielded: bool, rig: str = "bench") -> Score:
    """Run ``policy`` once in the episode of each seed, rotors alone on the table film, all side by side."""
    rotors = RotorVectorEnv(len(seeds), rig, seconds, limits=UNTRIPPED)
    environment = ShieldedRotors(rotors, shielded=shielded)
    observation, _ = environment.reset(seed=list(seeds))
    policy.start(len(seeds))
    record = _Record(observation)
    for _ in range(round(seconds / CONTROL_S)):
        observation, _, _, _, info = environment.step(actions_of(rotors.rig, policy(observation)))
        record.add(info)
    return record.score()


def play_machine(policy: Policy, seeds: Sequence[int], seconds: float, *, rig: str = "bench") -> Score:
    """The same behind the shield on the whole machine with its sensors, one episode after another."""
    environment = ShieldedRotor(RotorEnv(rig, episode_s=seconds, limits=UNTRIPPED))
    scores = []
    for seed in seeds:
        observation, _ = environment.reset(seed=seed)
        policy.start(1)
        record = _Record(observation[None])
        for _ in range(round(seconds / CONTROL_S)):
            wish_m = policy(observation[None])
            observation, _, _, _, info = environment.step(actions_of(environment.rotor.rig, wish_m)[0])
            record.add({name: np.array([value]) for name, value in info.items()})
        scores.append(record.score())
    return Score(*(np.concatenate([getattr(s, name) for s in scores]) for name in Score.__dataclass_fields__))


UNTRIPPED = Limits(trip_film_m=-1.0)
"""A film thin enough to trip is a violation that ends nothing: every episode is as long as the others."""


class _Record:
    """Gathers the steps of episodes that run side by side."""

    def __init__(self, observation: Observation) -> None:
        self._before_m = observation[:, column("clearance_m")].astype(np.float64)
        self._rows: list[list[Floats]] = []

    def add(self, info: Mapping[str, Floats]) -> None:
        """One step."""
        clearance_m = info["clearance_m"]
        self._rows.append([
            info["power_W"], CONTROL_S * info["violated"], info["min_film_m"], info["peak_to_peak_m"] / clearance_m,
            info["intervened"], np.abs(clearance_m - self._before_m),
        ])  # fmt: skip
        self._before_m = clearance_m

    def score(self) -> Score:
        """Over the steps so far."""
        power, violation, film, share, intervened, moved = np.array(self._rows, dtype=np.float64).transpose(1, 2, 0)
        return Score(power.mean(axis=1), violation.sum(axis=1), film.min(axis=1), share.max(axis=1),
                     intervened.mean(axis=1), moved.sum(axis=1))  # fmt: skip
