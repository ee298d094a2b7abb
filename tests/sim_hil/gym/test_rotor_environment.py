"""The Gymnasium environment: its checker, its seeds, its reward, its observation."""

import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from sim_hil.gym.environment import (
    CONTROL_S,
    ENVIRONMENT_ID,
    OBSERVATIONS,
    RotorEnv,
    shaft_xy,
    subsynchronous_share,
)
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.rigs import load_rig

RIG = load_rig("bench")
ROOT = Path(__file__).resolve().parents[3]
NAMES = list(OBSERVATIONS)


def test_gymnasium_accepts_it() -> None:
    check_env(gymnasium.make(ENVIRONMENT_ID).unwrapped, skip_render_check=True)


def test_the_readme_makes_it_in_a_fresh_interpreter(tmp_path: Path) -> None:
    (call,) = re.findall(r"gymnasium\.make\([^)]*\)", (ROOT / "README.md").read_text())
    said = subprocess.run(
        [sys.executable, "-c", f"import gymnasium; print({call}.spec.id)"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (said.returncode, said.stdout.strip()) == (0, ENVIRONMENT_ID), said.stderr


def rollout(seed: int, steps: int = 5) -> list[tuple[list[float], float]]:
    env = RotorEnv()
    env.reset(seed=seed)
    out = []
    for k in range(steps):
        observation, reward, *_ = env.step(np.array([0.3 * np.sin(k)], dtype=np.float32))
        out.append((observation.tolist(), reward))
    return out


def test_seeds_repeat_and_differ() -> None:
    assert rollout(1) == rollout(1)
    assert rollout(1) != rollout(2)


def settled(action: float, duty: Duty, steps: int = 40) -> tuple[RotorEnv, dict[str, float], float]:
    env = RotorEnv(duty=duty, build=Build.nominal(RIG), episode_s=10.0)
    env.reset(seed=3)
    total = 0.0
    info: dict[str, float] = {}
    for k in range(steps):
        observation, reward, terminated, _, info = env.step(np.array([action], dtype=np.float32))
        total += reward if k > steps // 2 else 0.0
        assert not terminated
    return env, info | dict(zip(NAMES, observation.tolist(), strict=True)), total


def test_observation_is_what_is_true_within_the_sensors_errors() -> None:
    env, seen, _ = settled(-0.5, Duty.hold(6000, 100))
    assert seen["clearance_m"] == pytest.approx(env.clearance_of(-0.5), abs=2e-6)
    assert seen["shaft_power_W"] == pytest.approx(seen["power_W"], abs=6)
    assert seen["load_estimate_N"] == pytest.approx(100, rel=0.15)
    assert seen["speed_rad_s"] == pytest.approx(628.3, rel=1e-3)
    assert seen["supply_pressure_bar"] == pytest.approx(1.0, abs=0.05)
    assert seen["eccentricity_y_m"] < 0 < seen["eccentricity_x_m"]


def test_wider_is_cheaper_until_whirl_costs_more() -> None:
    returns = [settled(action, Duty.hold(12000, 30))[2] for action in (-1.0, -0.75, -0.4)]
    assert returns[1] > returns[0]
    assert returns[1] > returns[2]


def test_whirl_shows_in_the_observation_and_is_a_violation() -> None:
    _, calm, _ = settled(-0.8, Duty.hold(12000, 30))
    _, whirling, _ = settled(-0.4, Duty.hold(12000, 30))
    assert calm["subsync_share"] < 0.1 < 0.5 < whirling["subsync_share"]
    assert whirling["violated"]
    assert not calm["violated"]


def test_episode_ends_after_its_time() -> None:
    env = RotorEnv(duty=Duty.hold(3000, 100), episode_s=3 * CONTROL_S)
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, dtype=np.float32))[3] for _ in range(3)]
    assert ends == [False, False, True]


def test_probe_geometry_and_half_order_share() -> None:
    np.testing.assert_allclose(
        shaft_xy(RIG.probes, np.array([[np.sqrt(0.5), np.sqrt(0.5)]])), [[0.0, 1.0]], atol=1e-12
    )
    np.testing.assert_allclose(
        shaft_xy(RIG.probes, np.array([[np.sqrt(0.5), -np.sqrt(0.5)]])), [[1.0, 0.0]], atol=1e-12
    )
    t = np.arange(2000) / 5000
    wave = np.column_stack([np.sin(2 * np.pi * 50 * t), np.cos(2 * np.pi * 50 * t)])
    assert subsynchronous_share(wave, 5000, 2 * np.pi * 100) > 0.95
    assert subsynchronous_share(wave, 5000, 2 * np.pi * 50) < 0.05
