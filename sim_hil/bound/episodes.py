"""The references of an episode of the environments, found and judged in the environment itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_hil.bound.case import Profile, TargetPlan
from sim_hil.bound.disturbances import RampLimits
from sim_hil.bound.maps import Mapper
from sim_hil.bound.reference import References, references
from sim_hil.gym import control_task
from sim_hil.gym.control_task import CONTROL_S, Episode, EpisodeLimits, actions_of
from sim_hil.gym.vector_environment import RotorVectorEnv
from sim_hil.rigs import load_rig


def episode_references(
    seed: int,
    *,
    rig: str = "bench",
    episode_s: float = 30.0,
    disturbances: control_task.Disturbances | None = None,
    spacing_um: int = 8,
    mapper: Mapper = map,
    pressures_Pa: tuple[float, ...] | None = None,
) -> tuple[Episode, References]:
    """Preview and causal reference of the episode that the environments draw from `seed`, from its
    own start.

    With `pressures_Pa` the supply pressure is chosen too, as where it is a second action.

    Watts and violations are those of `RotorVectorEnv` (the episode of `RotorEnv` is the same):
    every fixed clearance and every schedule runs in it, with drifting inlet and growing faults.
    The causal reference is ready for load and speed ramps as fast as the declared ones; it knows
    the build at its end of the episode, with the warmer inlet. An episode whose `preview` is None
    breaks a limit under any schedule found, and is not to be counted.

    Some 15 s a call on one core: `ProcessPoolExecutor.map(episode_references, seeds)`.
    """
    declared = disturbances or control_task.Disturbances()
    runner = _Runner(seed, rig, episode_s, declared, pressure=pressures_Pa is not None)
    episode, loaded = runner.episode, runner.environment(1).rig
    end = replace(
        episode.build,
        unbalance_kg_m=episode.build.unbalance_kg_m + episode.unbalance_kg_m.at(episode_s),
        clearance_error_m=episode.build.clearance_error_m + episode.wear_m.at(episode_s),
    )
    expected = RampLimits(*declared.ramps(loaded))
    return episode, references(
        loaded,
        episode.duty,
        build=end,
        inlet_C=max(episode.inlet_C),
        seconds=episode_s,
        start_m=episode.clearance_m,
        expected=expected,
        spacing_um=spacing_um,
        mapper=mapper,
        judge=runner,
        held_s=CONTROL_S,
        pressures_Pa=pressures_Pa,
    )


class _Runner:
    """Runs plans side by side in copies of one episode; a thin film ends none of them."""

    def __init__(
        self,
        seed: int,
        rig: str,
        episode_s: float,
        disturbances: control_task.Disturbances,
        *,
        pressure: bool,
    ) -> None:
        self._seed, self._data = seed, load_rig(rig)
        self._disturbances, self._pressure = disturbances, pressure
        self._episode_s, self._steps = episode_s, round(episode_s / CONTROL_S)
        environment = self.environment(1)
        environment.reset(seed=[seed])
        self.episode = environment.episodes[0]

    def environment(self, copies: int) -> RotorVectorEnv:
        """That many rotors."""
        limits = replace(EpisodeLimits.of_rig(self._data), trip_film_m=-1.0)
        return RotorVectorEnv(
            copies,
            self._data,
            self._episode_s,
            limits=limits,
            pressure=self._pressure,
            disturbances=self._disturbances,
        )

    def __call__(self, plans: Sequence[TargetPlan]) -> list[Profile]:
        """What each plan came to."""
        environment = self.environment(len(plans))
        environment.reset(seed=[self._seed] * len(plans))
        rows = []
        for step in range(self._steps):
            now_s = step * CONTROL_S
            setpoints = np.array([[plan.clearance(now_s), plan.pressure(now_s)] for plan in plans])
            infos = environment.step(
                actions_of(environment.rig, setpoints[:, : 1 + self._pressure])
            )[4]
            share = infos["peak_to_peak_m"] / infos["clearance_m"]
            rows.append(
                [infos["power_W"], infos["min_film_m"], share, CONTROL_S * infos["violated"]]
            )
        return [Profile(*figures) for figures in np.array(rows).transpose(2, 1, 0)]
