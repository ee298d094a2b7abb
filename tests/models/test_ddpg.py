"""DDPG and DQN on a problem with a known best policy: drive points on a line to the origin."""

import gymnasium
import numpy as np
import pytest

pytestmark = pytest.mark.slow


class PointsOnALine(gymnasium.vector.VectorEnv):
    """``x' = x + 0.3 a``, reward ``-x'^2``: the best action is ``clip(-x / 0.3)``; ten steps an
    episode."""

    num_envs = 4
    single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.x, self.steps = self.rng.uniform(-1, 1, self.num_envs), 0
        return self._observation(), {}

    def step(self, actions):
        self.x, self.steps = self.x + 0.3 * actions[:, 0].astype(float), self.steps + 1
        reward, last, over = (
            -(self.x**2),
            self._observation(),
            np.full(self.num_envs, self.steps >= 10),
        )
        if over[0]:
            self.x, self.steps = self.rng.uniform(-1, 1, self.num_envs), 0
        return self._observation(), reward, np.zeros(self.num_envs, bool), over, {"final_obs": last}

    def _observation(self):
        return self.x[:, None].astype(np.float32)


def mean_return(policy):
    environment, total = PointsOnALine(), 0.0
    s, _ = environment.reset(seed=1)
    for _ in range(200):
        s, reward, *_ = environment.step(policy(s))
        total += reward.mean()
    return total / 20


BEST = mean_return(lambda s: np.clip(-s / 0.3, -1, 1))
IDLE = mean_return(lambda s: np.zeros((4, 1)))


def settings(**switches):
    from models.learning import ddpg

    return ddpg.DdpgSettings(
        steps=2000,
        warm_up=400,
        batch=64,
        hidden=(32, 32),
        tau=0.02,
        actor_rate=1e-3,
        updates_per_step=4,
        **switches,
    )


def scale():
    from models.learning import ddpg

    one = np.ones(1, np.float32)
    return ddpg.Scale(-one, one)


def learn(seed=1, **switches):
    from models.learning import ddpg

    return ddpg.train_ddpg(PointsOnALine(), scale(), settings(**switches), seed)


@pytest.mark.parametrize(
    "switches", [{}, {"twin_critics": True, "policy_delay": 2, "target_noise": 0.1}]
)
def test_ddpg_learns_nearly_the_best_policy(switches):
    from models.learning.ddpg import act

    actor = learn(**switches)
    assert mean_return(lambda s: act(actor, s)) > BEST + 0.05 * (IDLE - BEST)


def test_dqn_learns_nearly_the_best_of_its_choices():
    from models.learning.dqn import train_dqn

    choices = np.linspace(-1.0, 1.0, 7, dtype=np.float32)[:, None]
    values = train_dqn(PointsOnALine(), scale(), settings(), choices, 1)
    assert mean_return(lambda s: choices[values.best(s)]) > BEST + 0.1 * (IDLE - BEST)


def test_same_seed_gives_the_same_policy_bit_for_bit():
    first, second = learn(), learn()
    for a, b in zip(first.parameters(), second.parameters(), strict=True):
        assert (a == b).all()


def test_a_strange_observation_gives_an_action_inside_the_range():
    from models.learning.ddpg import act

    actor = learn()
    for value in (1e30, -1e30):
        assert -1.0 <= float(act(actor, np.array([[value]], np.float32))[0, 0]) <= 1.0
