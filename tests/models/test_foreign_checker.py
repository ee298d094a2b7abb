"""The environment beside another project's checker (development only: Stable-Baselines3)."""

import warnings

import pytest

from sim_hil.gym.environment import RotorEnv

checker = pytest.importorskip(
    "stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed"
)


@pytest.mark.parametrize("pressure", [False, True])
def test_stable_baselines_accepts_the_environment(pressure: bool) -> None:
    with warnings.catch_warnings():
        # its advice on the scale of observations: ours are SI by intent, the trained graph scales
        # them
        warnings.simplefilter("ignore", UserWarning)
        checker.check_env(RotorEnv(episode_s=1.0, pressure=pressure))
