"""DDPG on a problem with a known best policy: drive a point on a line to the origin."""

import gymnasium
import numpy as np
import pytest

pytestmark = pytest.mark.slow


class PointOnALine(gymnasium.Env):
    """``x' = x + 0.3 a``, reward ``-x'^2``: the best action is ``clip(-x / 0.3)``."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.steps = self.np_random.uniform(-1, 1), 0
        return self._observation(), {}

    def step(self, action):
        self.x, self.steps = self.x + 0.3 * float(action[0]), self.steps + 1
        return self._observation(), -(self.x**2), False, self.steps >= 10, {}

    def _observation(self):
        return np.array([self.x], np.float32)


def mean_return(policy):
    environment, total = PointOnALine(), 0.0
    for episode in range(50):
        s, _ = environment.reset(seed=episode)
        done = False
        while not done:
            s, reward, _, done, _ = environment.step(policy(s))
            total += reward
    return total / 50


def learn(seed=1, **switches):
    from models import ddpg

    one = np.ones(1, np.float32)
    settings = ddpg.DdpgSettings(
        steps=1500, warm_up=300, batch=64, hidden=(32, 32), tau=0.02, actor_rate=1e-3, **switches
    )
    return ddpg.train_ddpg(PointOnALine(), ddpg.Scale(-one, one), settings, seed)


@pytest.mark.parametrize("switches", [{}, {"twin_critics": True, "policy_delay": 2, "target_noise": 0.1}])
def test_learns_nearly_the_best_policy(switches):
    from models.ddpg import act

    actor = learn(**switches)
    best = mean_return(lambda s: np.clip(-s / 0.3, -1, 1))
    idle = mean_return(lambda s: np.zeros(1))
    assert mean_return(lambda s: act(actor, s)) > best + 0.05 * (idle - best)


def test_same_seed_gives_the_same_policy_bit_for_bit():
    first, second = learn(), learn()
    for a, b in zip(first.parameters(), second.parameters(), strict=True):
        assert (a == b).all()


def test_a_strange_observation_gives_an_action_inside_the_range():
    from models.ddpg import act

    actor = learn()
    for value in (1e30, -1e30):
        assert -1.0 <= float(act(actor, np.array([value], np.float32))[0]) <= 1.0
