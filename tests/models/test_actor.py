"""The agent's graph, and the environment behind the guard's shield."""

import numpy as np
import pytest

from models.shielded import ShieldedRotor, episodes, value
from sim_hil.duty import Duty
from sim_hil.environment import OBSERVATIONS, RotorEnv


def rotor(speed_rpm=12000.0, load_N=30.0):
    return ShieldedRotor(RotorEnv(episode_s=1.0, duty=Duty.hold(speed_rpm, load_N)))


def test_shield_keeps_the_widest_clearance_from_a_fast_light_rotor():
    environment = rotor()
    environment.reset(seed=1)
    assert environment.admitted(160e-6) < 70e-6
    *_, info = environment.step(np.array([1.0], np.float32))
    assert info["intervened"]


def test_action_and_clearance_are_inverse():
    environment = rotor()
    for clearance in (40e-6, 61e-6, 160e-6):
        assert environment.rotor.clearance_of(environment.action_of(clearance)) == pytest.approx(clearance)


def test_same_episodes_give_the_same_score():
    first, second = (episodes(lambda _: 60e-6, range(3, 5), 0.5, shielded=True) for _ in range(2))
    assert first == second
    assert len(first.episode_power_W) == 2


def test_value_reads_by_name():
    observation = np.arange(len(OBSERVATIONS), dtype=np.float32)
    assert value(observation, "clearance_m") == list(OBSERVATIONS).index("clearance_m")


@pytest.mark.slow
def test_one_file_answers_like_the_module_inside_the_bearings_range(tmp_path):
    import torch

    from models import export
    from models.actor import RANGES, Clearance, random_observations
    from models.ddpg import Actor, Scale

    torch.manual_seed(3)
    low, high = np.array([RANGES[name] for name in OBSERVATIONS], np.float32).T
    actor = Actor(Scale(low, high), 1, (32, 32))
    torch.nn.init.normal_(actor.net[-1].weight, std=0.5)
    module = Clearance(actor, 40e-6, 160e-6)
    metadata = export.Metadata("actor", "0", tuple(OBSERVATIONS), ("clearance",), {}, (), "", {}, ())
    path = tmp_path / "actor.onnx"
    export.export(
        module, torch.zeros(2, 11), path, input_name="observation", output_names=("clearance",), metadata=metadata
    )
    observations = random_observations(10_000, 4)
    assert export.parity(module, path, observations) <= 1e-6
    answers = export.session(path).run(None, {"observation": observations})[0]
    assert np.ptp(answers) > 20e-6
    assert answers.min() >= np.float32(40e-6)
    assert answers.max() <= np.float32(160e-6)
