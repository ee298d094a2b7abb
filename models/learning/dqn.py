"""Deep Q-learning (Mnih et al. 2015) over fixed choices, the later choice of the paper's group."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from torch import Tensor, nn

from models.learning.ddpg import DdpgSettings, Floats, Replay, Scale, hidden_layers


class Values(nn.Module):
    """Observation (SI) to the value of each of ``choices`` actions."""

    def __init__(self, scale: Scale, choices: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.scale, self.choices = scale, choices
        self.net = nn.Sequential(*hidden_layers(scale.size, hidden), nn.Linear(hidden[-1], choices))

    def forward(self, s: Tensor) -> Tensor:
        """Values ``(m, choices)``."""
        value: Tensor = self.net(self.scale(s))
        return value

    def best(self, observation: Floats) -> NDArray[np.intp]:
        """Number of the choice of highest value, shape (m,)."""
        with torch.no_grad():
            chosen: NDArray[np.intp] = self(torch.from_numpy(observation)).argmax(dim=1).numpy()
        return chosen


def train_dqn(
    environment: VectorEnv[Any, Any, Any],
    scale: Scale,
    settings: DdpgSettings,
    choices: Floats,
    seed: int,
    on_step: Callable[[int], None] | None = None,
) -> Values:
    """Learn the values of ``choices`` (n, actions), in ``[-1, 1]``, in one pass.

    What both algorithms have is taken from ``settings``; exploration falls to 5 %.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    values = Values(scale, len(choices), settings.hidden)
    target = copy.deepcopy(values)
    optimiser = torch.optim.Adam(values.parameters(), settings.critic_rate)
    replay = Replay(settings.buffer, scale.size, 1)
    s, _ = environment.reset(seed=seed)
    for step in range(environment.num_envs, settings.steps + 1, environment.num_envs):
        random = rng.random(len(s)) < max(0.05, 1.0 - 2.0 * step / settings.steps)
        chosen = np.where(random, rng.integers(0, len(choices), len(s)), values.best(s))
        seen, reward, terminated, truncated, info = environment.step(choices[chosen])
        ended = terminated | truncated
        s_next = np.where(ended[:, None], info["final_obs"], seen) if ended.any() else seen
        replay.add(s, chosen.astype(np.float32)[:, None], reward, s_next, terminated)
        s = seen
        if step > settings.warm_up:
            for _ in range(settings.updates_per_step):
                _update(values, target, optimiser, replay.sample(settings.batch, rng), settings)
        if on_step is not None:
            on_step(step)
    return values


def _update(
    values: Values,
    target: Values,
    optimiser: torch.optim.Optimizer,
    batch: list[Tensor],
    settings: DdpgSettings,
) -> None:
    s, chosen, reward, s_next, terminated = batch
    with torch.no_grad():
        best = target(s_next).max(dim=1, keepdim=True).values
        wanted = reward + settings.discount * (1.0 - terminated) * best
    loss = torch.mean((wanted - values(s).gather(1, chosen.long())) ** 2)
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    with torch.no_grad():
        for slow, fast in zip(target.parameters(), values.parameters(), strict=True):
            slow.lerp_(fast, settings.tau)
