"""Deep deterministic policy gradient (Lillicrap et al. 2016), equations (9) and (10), with TD3 by
switches.

Equation (9) is the target ``v = r + gamma q'(s', mu'(s'))`` and (10) the critic's loss; the paper
leaves out the actor's objective, which is its reference [8]'s: ``mean q(s, mu(s))`` to be raised.
The three switches ``twin_critics``, ``policy_delay`` and ``target_noise`` are those of TD3
(Fujimoto et al. 2018).
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from torch import Tensor, nn

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


class DdpgSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Plain DDPG: ``twin_critics=False, policy_delay=1, target_noise=0``."""

    steps: int = 8_000
    warm_up: int = 1_600
    batch: int = 64
    hidden: tuple[int, ...] = (64, 64)
    actor_rate: float = 3e-4
    critic_rate: float = 1e-3
    discount: float = 0.95
    tau: float = 0.005
    exploration_noise: float = 0.15
    buffer: int = 200_000
    updates_per_step: int = 4
    """Gradient steps for each step of all rotors together."""
    twin_critics: bool = False
    policy_delay: int = 1
    target_noise: float = 0.0


class Scale(nn.Module):
    """``(x - middle) / half``, clipped to a few ranges so that a strange reading stays a finite
    input."""

    def __init__(self, low: Floats, high: Floats) -> None:
        super().__init__()
        self.size = len(low)
        self.middle: Tensor
        self.half_range: Tensor
        self.register_buffer("middle", torch.from_numpy((high + low) / 2.0))
        self.register_buffer("half_range", torch.from_numpy((high - low) / 2.0))

    def forward(self, x: Tensor) -> Tensor:
        """Observation in units of its declared range."""
        return torch.clamp((x - self.middle) / self.half_range, -3.0, 3.0)


class Actor(nn.Module):
    """Deterministic policy: observation (SI) to actions in ``[-1, 1]``."""

    def __init__(self, scale: Scale, actions: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.scale = scale
        last = nn.Linear(hidden[-1], actions)
        # A first policy near the middle of the range: a saturated tanh has no gradient to leave by.
        nn.init.uniform_(last.weight, -3e-3, 3e-3)
        self.net = nn.Sequential(*hidden_layers(scale.size, hidden), last)

    def forward(self, observation: Tensor) -> Tensor:
        """Actions ``(m, actions)``."""
        return torch.tanh(self.net(self.scale(observation)))


class Critic(nn.Module):
    """Value of an action in a state."""

    def __init__(self, scale: Scale, actions: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.scale = scale
        self.net = nn.Sequential(
            *hidden_layers(scale.size + actions, hidden), nn.Linear(hidden[-1], 1)
        )

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """``q(s, a)`` of shape ``(m, 1)``."""
        value: Tensor = self.net(torch.cat([self.scale(observation), action], dim=1))
        return value


class Replay:
    """The newest ``size`` transitions."""

    def __init__(self, size: int, observations: int, actions: int) -> None:
        self._rows = np.zeros((size, 2 * observations + actions + 2), np.float32)
        self._split = np.cumsum([observations, actions, 1, observations])
        self._count = 0

    def __len__(self) -> int:
        return min(self._count, len(self._rows))

    def add(self, s: Floats, a: Floats, reward: Floats, s_next: Floats, terminated: Flags) -> None:
        """Keep transitions, one a row; a truncated episode is not a terminated one."""
        rows = np.column_stack([s, a, reward, s_next, terminated])
        self._rows[(self._count + np.arange(len(rows))) % len(self._rows)] = rows
        self._count += len(rows)

    def sample(self, batch: int, rng: np.random.Generator) -> list[Tensor]:
        """``s, a, r, s', terminated`` of a random batch."""
        rows = self._rows[rng.integers(0, len(self), batch)]
        return [torch.from_numpy(part) for part in np.split(rows, self._split, axis=1)]


class Learner:
    """Networks, their targets and optimisers; :meth:`update` is the algorithm."""

    def __init__(self, scale: Scale, actions: int, settings: DdpgSettings, seed: int) -> None:
        torch.manual_seed(seed)
        self.settings = settings
        self.noise = torch.Generator().manual_seed(seed)
        self.actor = Actor(scale, actions, settings.hidden)
        self.critics = nn.ModuleList(
            Critic(scale, actions, settings.hidden) for _ in range(1 + settings.twin_critics)
        )
        self.actor_target = copy.deepcopy(self.actor)
        self.critics_target = copy.deepcopy(self.critics)
        self.actor_optimiser = torch.optim.Adam(self.actor.parameters(), settings.actor_rate)
        self.critic_optimiser = torch.optim.Adam(self.critics.parameters(), settings.critic_rate)
        self.updates = 0

    def update(self, batch: list[Tensor]) -> None:
        """One gradient step of the critics, every ``policy_delay`` of them one of the actor."""
        s, a, reward, s_next, terminated = batch
        with torch.no_grad():
            a_next = self.actor_target(s_next)
            if self.settings.target_noise > 0.0:
                noise = self.settings.target_noise * torch.randn(a_next.shape, generator=self.noise)
                a_next = torch.clamp(a_next + torch.clamp(noise, -0.5, 0.5), -1.0, 1.0)
            q_next = torch.min(
                torch.stack([q(s_next, a_next) for q in self.critics_target]), dim=0
            ).values
            target = reward + self.settings.discount * (1.0 - terminated) * q_next  # equation (9)
        critic_loss = torch.stack(
            [torch.mean((target - q(s, a)) ** 2) for q in self.critics]
        ).sum()  # (10)
        self.critic_optimiser.zero_grad()
        critic_loss.backward()
        self.critic_optimiser.step()
        self.updates += 1
        if self.updates % self.settings.policy_delay:
            return
        actor_loss = -self.critics[0](s, self.actor(s)).mean()
        self.actor_optimiser.zero_grad()
        actor_loss.backward()
        self.actor_optimiser.step()
        self._follow(self.actor_target, self.actor)
        self._follow(self.critics_target, self.critics)

    def _follow(self, target: nn.Module, source: nn.Module) -> None:
        with torch.no_grad():
            for slow, fast in zip(target.parameters(), source.parameters(), strict=True):
                slow.lerp_(fast, self.settings.tau)


def train_ddpg(
    environment: VectorEnv[Any, Any, Any],
    scale: Scale,
    settings: DdpgSettings,
    seed: int,
    on_step: Callable[[int], None] | None = None,
    on_episode: Callable[[int, float], None] | None = None,
) -> Actor:
    """Learn a policy for ``environment`` (actions in ``[-1, 1]``) in one pass.

    Parameters
    ----------
    environment
        Ended episodes start anew in the same step and show their last state as ``final_obs``.
    scale
        Ranges of the observation.
    seed
        Decides weights, noise, batches and every episode.
    on_step, on_episode
        Called with the steps done; with the step and the mean return of the episodes that ended in
        it.
    """
    rng = np.random.default_rng(seed)
    actions = int(np.prod(environment.single_action_space.shape or (1,)))
    learner = Learner(scale, actions, settings, seed)
    replay = Replay(settings.buffer, scale.size, actions)
    s, _ = environment.reset(seed=seed)
    total = np.zeros(environment.num_envs)
    for step in range(environment.num_envs, settings.steps + 1, environment.num_envs):
        a = _explore(learner.actor, s, settings, rng, random=step <= settings.warm_up)
        seen, reward, terminated, truncated, info = environment.step(a)
        ended = terminated | truncated
        s_next = np.where(ended[:, None], info["final_obs"], seen) if ended.any() else seen
        replay.add(s, a, reward, s_next, terminated)
        s, total = seen, total + reward
        if step > settings.warm_up:
            for _ in range(settings.updates_per_step):
                learner.update(replay.sample(settings.batch, rng))
        if ended.any():
            if on_episode is not None:
                on_episode(step, float(total[ended].mean()))
            total[ended] = 0.0
        if on_step is not None:
            on_step(step)
    return learner.actor


def act(actor: Actor, observation: Floats) -> Floats:
    """The policy's actions ``(m, actions)`` for observations ``(m, observations)``."""
    with torch.no_grad():
        actions: Floats = actor(torch.from_numpy(np.asarray(observation, np.float32))).numpy()
    return actions


def _explore(
    actor: Actor, s: Floats, settings: DdpgSettings, rng: np.random.Generator, *, random: bool
) -> Floats:
    policy = act(actor, s)
    if random:
        return rng.uniform(-1.0, 1.0, policy.shape).astype(np.float32)
    noisy = policy + rng.normal(0.0, settings.exploration_noise, policy.shape)
    return np.clip(noisy, -1.0, 1.0).astype(np.float32)


def hidden_layers(inputs: int, hidden: tuple[int, ...]) -> list[nn.Module]:
    """Linear layers, each followed by a rectifier."""
    parts: list[nn.Module] = []
    for n, m in pairwise((inputs, *hidden)):
        parts += [nn.Linear(n, m), nn.ReLU()]
    return parts
